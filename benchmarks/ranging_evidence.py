r"""What a trained network's ranges are worth: every estimator, the attitude as measured and disturbed, as one page.

The network runs once over the validation and the test split; everything after that is geometry. The validation split
calibrates: keypoint noise first, then how well sizes are drawn, then the intervals. Since a test split of a few dozen
boats knows a coverage badly, both splits together are cross-calibrated as well. Sigmas of the attitude and of the waves
are stated here, for what a camera file says need not be true.

python benchmarks/ranging_evidence.py --checkpoint best.ckpt --root sixscenes-v0 --output out \
    --attitude_std_deg 0.05 --wave_std_m 0.014
"""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jsonargparse import auto_cli

from usvnet.checkpoints import load_model, sha256
from usvnet.data import read_dataset
from usvnet.data.dataset import BoatDataset
from usvnet.data.records import Frame
from usvnet.evaluation.conformal import fit_intervals
from usvnet.evaluation.cross_calibration import coverage_std, cross_calibrate
from usvnet.evaluation.evaluator import frame_truths, prediction_meta
from usvnet.evaluation.floor import pixel_noise, score_floor
from usvnet.evaluation.integrity import shares_caught
from usvnet.evaluation.interval_metrics import interval_errors, score_intervals
from usvnet.evaluation.keypoint_calibration import fit_keypoint_share
from usvnet.evaluation.predictions import predict_dataset, read_predictions
from usvnet.evaluation.range_metrics import RangedBoat, group_boats, range_errors, ranged_boats
from usvnet.evaluation.records import ESTIMATORS
from usvnet.evaluation.reranging import Cases, native_cases, range_anew
from usvnet.evaluation.size_calibration import fit_size_std
from usvnet.evaluation.tables import Cell, Column, Table
from usvnet.evaluation.uncertainty_report import floor_table, interval_table
from usvnet.files import atomic_write
from usvnet.geometry.ranging import RangingLayer
from usvnet.intervals import IntervalFactors


def main(
    checkpoint: Path,
    root: Path,
    output: Path,
    image_size: int = 640,
    attitude_std_deg: float | None = None,
    wave_std_m: float | None = None,
    disturbances_deg: list[float] | None = None,
    draws: int = 5,
    folds: int = 10,
    batch_size: int = 8,
    native_size: int | None = None,
) -> None:
    """Write ``ranging.md``.

    Args:
        checkpoint: written by train.py; its calibration is left aside and made anew.
        root: dataset folder with the splits val and test.
        output: folder for predictions and the page.
        image_size: side of the square picture that the network sees.
        attitude_std_deg: standard deviation of pitch and roll as measured; as the camera files say by default.
        wave_std_m: standard deviation of the water at a boat; as the camera files say by default.
        disturbances_deg: standard deviations of what is added to pitch and roll, which the sigmas are told [0, 0.3].
        draws: how often each boat that is scored is disturbed.
        folds: of the cross-calibration over both splits.
        batch_size: pictures a batch.
        native_size: side of the pictures that keypoints are refined on, where the network does that.
    """
    model = load_model(checkpoint)
    model.noise.set_share(0.0)
    model.noise.set_size_std(0.0)
    model.intervals.set_factors({})
    frames, ranged = {}, {}
    for split in ("val", "test"):
        dataset = BoatDataset(read_dataset(root, split), image_size, native_px=native_size)
        path = output / f"{split}.jsonl"
        meta = prediction_meta(model, dataset, split) | {"checkpoint_sha256": sha256(checkpoint)}
        if not path.is_file():
            predict_dataset(model, dataset, path, meta, batch_size)
        records = [picture.boats for picture in read_predictions(path, meta)]
        ranged[split] = ranged_boats(records, [frame_truths(frame) for frame in dataset.frames])
        frames[split] = [with_sigmas(frame, attitude_std_deg, wave_std_m) for frame in dataset.frames]
    doubts = fit_doubts(ranged["val"], frames["val"], model.ranging.curved_water)
    size_px = max(frames["test"][0].size_px)
    ranging = RangingLayer(model.ranging.curved_water, box_bottom_std_px=size_px / image_size)
    lines = [
        f"Keypoints of val stray by {100 * doubts.share:.1f} % of a boat's size beyond what their heatmaps say, "
        f"and boats are drawn larger or smaller than they are by {100 * doubts.size_std:.1f} %.",
        "",
    ]
    for disturbance in disturbances_deg or [0.0, 0.3]:
        seen = {
            split: disturbed(ranged[split], frames[split], doubts, disturbance, times, ranging)
            for split, times in (("val", 1), ("test", draws if disturbance else 1))
        }
        factors = fit_intervals(seen["val"])
        calibrated = with_factors(seen["test"], factors)
        told = [with_sigmas(frame, None, None, disturbance) for frame in frames["test"]]
        lines += [f"# Attitude disturbed by {disturbance:g} degrees" if disturbance else "# Attitude as measured", ""]
        intervals = score_intervals(calibrated, {name: found.boats for name, found in factors.items()})
        by_scene, by_distance = group_boats(calibrated)
        crossed = cross_scored(*pooled(ranged, frames), disturbance, draws if disturbance else 1, ranging, folds)
        for table in (
            range_table(calibrated, by_scene, "Scene"),
            range_table(calibrated, by_distance, "Distance"),
            interval_table(intervals, "distance"),
            coverage_table(crossed, folds),
            floor_table(score_floor(calibrated, told, model.ranging.curved_water)),
        ):
            lines.append(table.to_markdown())
    lines += ["# Integrity", "", integrity_table(ranged["test"], frames["test"], ranging).to_markdown()]
    text = "\n".join(lines)
    with atomic_write(output / "ranging.md") as temporary:
        temporary.write_text(text, encoding="utf-8")
    print(text)


def with_sigmas(frame: Frame, attitude_std_deg: float | None, wave_std_m: float | None, more_deg: float = 0.0) -> Frame:
    """The frame with other standard deviations of its camera; ``more_deg`` comes on top of the attitude's."""
    camera, one = frame.camera, torch.ones_like(frame.camera.pitch_rad)
    if attitude_std_deg is not None:
        std_rad = math.radians(attitude_std_deg) * one
        camera = camera._replace(pitch_std_rad=std_rad, roll_std_rad=std_rad)
    if wave_std_m is not None:
        camera = camera._replace(wave_std_m=wave_std_m * one)
    more_rad = math.radians(more_deg) * one
    pitch_std_rad, roll_std_rad = (
        torch.hypot(camera.pitch_std_rad, more_rad),
        torch.hypot(camera.roll_std_rad, more_rad),
    )
    return dataclasses.replace(frame, camera=camera._replace(pitch_std_rad=pitch_std_rad, roll_std_rad=roll_std_rad))


class Doubts(NamedTuple):
    """What is not to be believed of a boat (see :mod:`usvnet.keypoint_noise`)."""

    share: float = 0.0
    size_std: float = 0.0


def fit_doubts(ranged: Sequence[RangedBoat], frames: Sequence[Frame], curved_water: bool) -> Doubts:
    """What the labels and lasers of these boats say of it."""
    share = fit_keypoint_share([(item.boat, item.truth) for item in ranged if item.boat is not None])
    return Doubts(share, fit_size_std(ranged, frames, share, curved_water))


def found_cases(ranged: Sequence[RangedBoat], frames: Sequence[Frame]) -> Cases:
    """The boats that were found, in native pixels."""
    return native_cases([(item.boat, frames[item.picture]) for item in ranged if item.boat is not None])


def disturbed(
    ranged: Sequence[RangedBoat],
    frames: Sequence[Frame],
    doubts: Doubts,
    std_deg: float,
    times: int,
    ranging: RangingLayer,
    generator: torch.Generator | None = None,
) -> list[RangedBoat]:
    """Every boat ``times`` over, each time with another error of pitch and roll, which their sigmas are told."""
    cases = found_cases(ranged, [with_sigmas(frame, None, None, std_deg) for frame in frames]).with_noise(*doubts)
    cases = cases.repeat(times)
    generator = generator or torch.Generator().manual_seed(0)
    error_rad = math.radians(std_deg) * torch.randn(2, cases.count, dtype=torch.float64, generator=generator)
    camera = cases.camera._replace(
        pitch_rad=cases.camera.pitch_rad + error_rad[0], roll_rad=cases.camera.roll_rad + error_rad[1]
    )
    cases = dataclasses.replace(cases, camera=camera)
    return range_anew([item for _ in range(times) for item in ranged], cases, ranging)


def with_factors(ranged: Sequence[RangedBoat], factors: dict[str, IntervalFactors]) -> list[RangedBoat]:
    """The same boats with calibrated standard deviations."""
    calibrated = []
    for item in ranged:
        boat = item.boat
        if boat is not None:
            ranges = {
                name: dataclasses.replace(
                    boat.ranges[name],
                    slant_std_m=boat.ranges[name].raw_std_m * factors[name].factor_90,
                    factors=factors[name],
                )
                for name in ESTIMATORS
            }
            boat = dataclasses.replace(boat, ranges=ranges)
        calibrated.append(dataclasses.replace(item, boat=boat))
    return calibrated


def pooled(ranged: dict[str, list[RangedBoat]], frames: dict[str, list[Frame]]) -> tuple[list[RangedBoat], list[Frame]]:
    """All splits as one."""
    boats: list[RangedBoat] = []
    pictures: list[Frame] = []
    for split, members in ranged.items():
        boats += [dataclasses.replace(item, picture=item.picture + len(pictures)) for item in members]
        pictures += frames[split]
    return boats, pictures


def cross_scored(
    ranged: Sequence[RangedBoat],
    frames: Sequence[Frame],
    std_deg: float,
    times: int,
    ranging: RangingLayer,
    folds: int,
) -> list[RangedBoat]:
    """Every boat ``times`` over, with keypoint noise and intervals that were fitted on the other folds."""
    generator = torch.Generator().manual_seed(0)

    def calibrate(others: Sequence[RangedBoat], held_out: Sequence[RangedBoat]) -> list[RangedBoat]:
        doubts = fit_doubts(others, frames, ranging.curved_water)
        factors = fit_intervals(disturbed(others, frames, doubts, std_deg, 1, ranging, generator))
        return with_factors(disturbed(held_out, frames, doubts, std_deg, times, ranging, generator), factors)

    return cross_calibrate(ranged, calibrate, folds)


def coverage_table(ranged: Sequence[RangedBoat], folds: int) -> Table:
    """Coverage of the 90 % interval by distance and estimator, and how well it is known."""
    rows: list[list[Cell]] = []
    for key, members in [*group_boats(ranged)[1].items(), ("all", ranged)]:
        for name in ESTIMATORS:
            errors = interval_errors(members, name)
            boats = {id(item.truth) for item in members if item.boat is not None and item.boat.ranges[name].usable}
            before, after = errors.before, errors.after
            rows.append([key, name, len(boats), before.coverage_90, after.coverage_90, coverage_std(members, name)])
            rows[-1] += [before.width_90_m, after.width_90_m]
            rows[-1] += [before.negative_log_likelihood, after.negative_log_likelihood]
    return Table(
        title=f"90 % intervals cross-calibrated in {folds} folds over val and test, metres",
        columns=[
            *(Column(name) for name in ("Distance", "Estimator", "boats")),
            *(Column(name, digits=1, percent=True) for name in ("raw hit", "calibrated hit", "std. error")),
            *(Column(name, digits=2) for name in ("raw width", "calibrated width", "raw NLL", "calibrated NLL")),
        ],
        rows=rows,
        strong=frozenset(range(len(rows) - len(ESTIMATORS), len(rows))),
        note="Keypoint noise, doubt of sizes and factors fitted on other folds. All boats together hit 90 % nearly by "
        "construction, bins need not. std. error: of the calibrated hit, pictures being independent.",
    )


def range_table(ranged: Sequence[RangedBoat], groups: dict[str, list[RangedBoat]], title: str) -> Table:
    """Errors of every estimator by group, and how they compare to the waterline's."""
    rows: list[list[Cell]] = []
    for key, members in [*groups.items(), ("all", ranged)]:
        waterline_m = range_errors(members, "waterline").rmse_m
        for name in ESTIMATORS:
            e = range_errors(members, name)
            ratio = e.rmse_m / waterline_m
            rows.append([key, name, e.n, e.missed, e.rmse_m, ratio, e.mae_m, e.median_relative_error, e.bias_m])
    return Table(
        title=f"Slant range by {title.lower()}, metres",
        columns=[
            *(Column(name) for name in (title, "Estimator", "n", "missed", "RMSE")),
            Column("of waterline's", digits=2),
            Column("MAE"),
            Column("rel. error", digits=2, percent=True),
            Column("bias"),
        ],
        rows=rows,
        strong=frozenset(range(len(rows) - len(ESTIMATORS), len(rows))),
        note="of waterline's: RMSE over that of waterline; rel. error: median of |error| / reading.",
    )


def integrity_table(ranged: Sequence[RangedBoat], frames: Sequence[Frame], ranging: RangingLayer) -> Table:
    """Share of boats made wrong on purpose that the fit of the hull refuses, by distance and in all."""
    rows: list[list[Cell]] = []
    for key, members in group_boats(ranged)[1].items():
        seven = [item for item in members if item.boat is not None and (item.truth.visibility > 0).all()]
        if not seven:
            continue
        covariance_px2, _ = pixel_noise(seven)
        cases = found_cases(seven, frames)
        labels_px = torch.from_numpy(np.stack([item.truth.keypoints_px for item in seven]))
        noise_px2 = torch.from_numpy(covariance_px2).expand_as(cases.covariance_px2)
        cases = dataclasses.replace(cases, keypoints_px=labels_px, covariance_px2=noise_px2)
        noise_px = math.sqrt(float(torch.diagonal(noise_px2, dim1=-2, dim2=-1).mean()))
        limit, caught = shares_caught(cases, ranging)
        rows.append([key, cases.count, noise_px, limit, *(float(found.mean()) for found in caught.values())])
    return Table(
        title="Boats made wrong, share refused at 1 % false alarms",
        columns=[
            *(Column(name) for name in ("Distance", "n")),
            Column("noise px", digits=2),
            Column("limit", digits=2),
            *(Column(name, digits=1, percent=True) for name in ("reflection", "swapped ends", "swapped sides")),
        ],
        rows=rows,
        note="Labelled keypoints with the network's own noise (robust, by distance); limit: of the misfit, which is "
        "refused beyond 0.9.",
    )


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
