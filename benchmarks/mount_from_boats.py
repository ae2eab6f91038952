r"""What finding the mount from the boats themselves is worth: a fixed camera whose pitch and roll are wrong throughout.

Predictions are those that benchmarks/ranging_evidence.py left in its output folder; no network runs. The mount of a
tripod is drawn anew, wrong by one pitch and one roll for all pictures, which its sigmas are told. The boats are parted
into folds; those of one are ranged with the mount that the others tell (``usvnet calibrate-mount``), whose hull is
known and whose ranges are not looked at.

python benchmarks/mount_from_boats.py --predictions out/test.jsonl --root sixscenes-v0 --output out \
    --keypoint_share 0.016 --wave_std_m 0.014
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jsonargparse import auto_cli
from ranging_evidence import with_sigmas
from rich.console import Console
from rich.progress import track
from torch import Tensor

from usvnet.data import read_dataset
from usvnet.evaluation.evaluator import frame_truths
from usvnet.evaluation.predictions import read_predictions
from usvnet.evaluation.range_metrics import RangedBoat, range_errors, ranged_boats
from usvnet.evaluation.reranging import Cases, native_cases, range_anew
from usvnet.evaluation.tables import Cell, Column, Table
from usvnet.files import atomic_write
from usvnet.geometry.camera import with_attitude
from usvnet.geometry.mount_hulls import SIZE_STD, HullMount, fit_mount_to_hulls
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import Camera, Hull

ESTIMATORS = ("waterline", "hull", "fused")
RIGHT, WRONG, FOUND = "right mount", "wrong mount", "mount found from the other boats"


def main(
    predictions: Path,
    root: Path,
    output: Path,
    split: str = "test",
    keypoint_share: float = 0.0,
    drawn_size_std: float = 0.0,
    attitude_std_deg: float = 0.02,
    wave_std_m: float | None = None,
    disturbance_deg: float = 0.3,
    draws: int = 40,
    folds: int = 2,
    size_std: float = SIZE_STD,
) -> None:
    """Write ``mount_from_boats.md``.

    Args:
        predictions: of that split, with the covariances of the heatmaps alone.
        root: dataset folder; the split must be of one fixed camera and one hull.
        output: folder of the page.
        split: the split.
        keypoint_share: doubt of the keypoints as a share of the boat's size, as ranging_evidence.py tells it.
        drawn_size_std: how much larger or smaller each boat is drawn, as ranging_evidence.py tells it; for its range.
        attitude_std_deg: how far the tripod moves from picture to picture.
        wave_std_m: standard deviation of the water at a boat; as the camera files say by default.
        disturbance_deg: standard deviation of the mount's pitch and roll.
        draws: of the mount, and of the folds.
        folds: 2 finds the mount from half of the boats, 5 from four fifths.
        size_std: how much larger or smaller all boats may be drawn.
    """
    frames = [with_sigmas(frame, 0.0, wave_std_m) for frame in read_dataset(root, split)]
    records = [picture.boats for picture in read_predictions(predictions)]
    boats = [item for item in ranged_boats(records, list(map(frame_truths, frames))) if item.boat is not None]
    cases = native_cases([(item.boat, frames[item.picture]) for item in boats if item.boat is not None])
    cases = cases.with_noise(keypoint_share)
    doubted = cases.with_noise(0.0, drawn_size_std)
    camera, hull = only_one(cases, root, split)
    own_rad, std_rad = math.radians(attitude_std_deg), math.radians(disturbance_deg)
    ranged: dict[str, list[RangedBoat]] = {RIGHT: [], WRONG: [], FOUND: []}
    pitches: list[tuple[float, float]] = []
    random = np.random.default_rng(0)
    for _ in track(range(draws), "Finding mounts", console=Console(stderr=True), transient=True):
        wrong_rad = std_rad * torch.from_numpy(random.normal(size=2))
        told = with_attitude(camera, camera.pitch_rad + wrong_rad[0], camera.roll_rad + wrong_rad[1], std_rad, std_rad)
        parts = torch.from_numpy(random.permutation(cases.count)).tensor_split(folds)
        for number, asked in enumerate(parts):
            known = torch.cat([part for other, part in enumerate(parts) if other != number])
            found = fit_mount_to_hulls(cases.keypoints_px[known], cases.covariance_px2[known], told, hull, size_std)
            pitches.append(pitch_error(found, camera))
            for name, mount in ((RIGHT, camera), (WRONG, told), (FOUND, found.camera)):
                ranged[name] += range_boats(boats, doubted, asked, moving(mount, own_rad))
    table = range_table(ranged, pitches, cases.count, draws)
    with atomic_write(output / "mount_from_boats.md") as temporary:
        temporary.write_text(table.to_markdown(), encoding="utf-8")
    print(table.to_markdown())


def only_one(cases: Cases, root: Path, split: str) -> tuple[Camera, Hull]:
    """The camera with the mean of its pictures' attitudes, and the hull.

    Raises:
        ValueError: there are several.
    """
    lens, hulls = cases.camera.K.flatten(1), cases.hull.points_m.flatten(1)
    if len(lens.unique(dim=0)) > 1 or len(hulls.unique(dim=0)) > 1:
        raise ValueError(f"{root}: {split} is of several cameras or hulls, expected one of each")
    one = Camera(*(field[:1] for field in cases.camera))
    mean = (cases.camera.pitch_rad.mean(), cases.camera.roll_rad.mean())
    return with_attitude(one, *mean), Hull(*(field[:1] for field in cases.hull))


def moving(camera: Camera, std_rad: float) -> Camera:
    """A camera that moves by so much about its mount."""
    stds = (torch.hypot(std, torch.full_like(std, std_rad)) for std in (camera.pitch_std_rad, camera.roll_std_rad))
    return with_attitude(camera, camera.pitch_rad, camera.roll_rad, *stds)


def pitch_error(found: HullMount, true: Camera) -> tuple[float, float]:
    """Error of the pitch and its sigma, degrees."""
    error = found.camera.pitch_rad - true.pitch_rad
    return math.degrees(error.item()), math.degrees(found.camera.pitch_std_rad.item())


def range_boats(boats: Sequence[RangedBoat], cases: Cases, asked: Tensor, camera: Camera) -> list[RangedBoat]:
    """The boats ``asked`` for, ranged by one camera."""
    chosen = Cases(
        keypoints_px=cases.keypoints_px[asked],
        covariance_px2=cases.covariance_px2[asked],
        boxes_px=cases.boxes_px[asked],
        camera=Camera(*(field.expand(len(asked), *field.shape[1:]) for field in camera)),
        hull=Hull(*(field[asked] for field in cases.hull)),
    )
    return range_anew([boats[n] for n in asked.tolist()], chosen, RangingLayer())


def range_table(
    ranged: dict[str, list[RangedBoat]], pitches: list[tuple[float, float]], boats: int, draws: int
) -> Table:
    """Errors of every estimator with each mount."""
    wrong_m = range_errors(ranged[WRONG], "waterline").rmse_m
    rows: list[list[Cell]] = []
    for mount, group in ranged.items():
        for name in ESTIMATORS:
            e = range_errors(group, name)
            rows.append([mount, name, e.rmse_m, e.rmse_m / wrong_m, e.median_relative_error, e.coverage_90])
    errors, stds = np.array(pitches).T
    return Table(
        title="Slant range of a fixed camera, metres",
        columns=[
            *(Column(name) for name in ("Mount", "Estimator", "RMSE")),
            Column("of waterline's with the wrong mount", digits=2),
            Column("rel. error", digits=2, percent=True),
            Column("raw 90 % hit", digits=0, percent=True),
        ],
        rows=rows,
        note=f"{boats} boats, {draws} draws. Found pitch: {math.sqrt((errors**2).mean()):.3f} degrees off (RMS), "
        f"{errors.mean():+.3f} in the mean, claimed {math.sqrt((stds**2).mean()):.3f}.",
    )


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
