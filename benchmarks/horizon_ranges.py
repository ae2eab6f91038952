r"""What the horizon is worth to a disturbed camera: ranges of a network's boats without and with it, where it is seen.

Predictions are those that benchmarks/ranging_evidence.py left in its output folder; no network runs. Pitch and roll of
every picture with a laser-ranged boat are disturbed, which their sigmas are told, the horizon is looked for where that
leaves it, and joined with them by inverse variance.

python benchmarks/horizon_ranges.py --predictions out/test.jsonl --root sixscenes-v0 --output out \
    --keypoint_share 0.016 --attitude_std_deg 0.05 --wave_std_m 0.014 --edge_m 6000
"""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import torch
from jsonargparse import auto_cli
from ranging_evidence import with_sigmas
from rich.console import Console
from rich.progress import track

from usvnet.data import read_dataset
from usvnet.data.horizon_detector import find_horizon
from usvnet.data.pictures import read_picture
from usvnet.data.records import Frame
from usvnet.evaluation.evaluator import frame_truths
from usvnet.evaluation.predictions import read_predictions
from usvnet.evaluation.range_metrics import RangedBoat, range_errors, ranged_boats
from usvnet.evaluation.reranging import native_cases, range_anew
from usvnet.evaluation.tables import Cell, Column, Table
from usvnet.files import atomic_write
from usvnet.geometry.attitude import camera_attitude, combine
from usvnet.geometry.camera import camera_to, with_attitude
from usvnet.geometry.horizon import flat_edge
from usvnet.geometry.ranging import RangingLayer

ESTIMATORS = ("waterline", "hull", "fused")


def main(
    predictions: Path,
    root: Path,
    output: Path,
    split: str = "test",
    keypoint_share: float = 0.0,
    drawn_size_std: float = 0.0,
    attitude_std_deg: float | None = None,
    wave_std_m: float | None = None,
    disturbance_deg: float = 0.3,
    draws: int = 5,
    edge_m: float | None = None,
) -> None:
    """Write ``horizon_ranges.md``.

    Args:
        predictions: of that split, with the covariances of the heatmaps alone.
        root: dataset folder.
        output: folder of the page.
        split: the split.
        keypoint_share: doubt of the keypoints as a share of the boat's size, as ranging_evidence.py tells it.
        drawn_size_std: how much larger or smaller a boat is drawn, as ranging_evidence.py tells it.
        attitude_std_deg: standard deviation of pitch and roll as measured; as the camera files say by default.
        wave_std_m: standard deviation of the water at a boat; as the camera files say by default.
        disturbance_deg: standard deviation of what is added to pitch and roll.
        draws: how often each picture is disturbed.
        edge_m: where the drawn water, which is flat, ends; by default it is the curved earth's.
    """
    frames = [with_sigmas(frame, attitude_std_deg, wave_std_m, disturbance_deg) for frame in read_dataset(root, split)]
    records = [picture.boats for picture in read_predictions(predictions)]
    found = [item for item in ranged_boats(records, list(map(frame_truths, frames))) if item.boat is not None]
    generator = torch.Generator().manual_seed(0)
    boats: list[RangedBoat] = []
    without: list[Frame] = []
    joined: list[Frame] = []
    pictures = sorted({item.picture for item in found})
    for picture in track(pictures, "Looking for horizons", console=Console(stderr=True), transient=True):
        frame = frames[picture]
        for error_rad in math.radians(disturbance_deg) * torch.randn(draws, 2, 1, generator=generator):
            camera = frame.camera
            camera = camera._replace(pitch_rad=camera.pitch_rad + error_rad[0], roll_rad=camera.roll_rad + error_rad[1])
            disturbed = dataclasses.replace(frame, camera=camera)
            if (turned := joined_with_horizon(disturbed, edge_m)) is not None:
                here = [item for item in found if item.picture == picture]
                boats += here
                without += [disturbed] * len(here)
                joined += [turned] * len(here)
    if not boats:
        raise ValueError(f"{root}: {split}: no horizon was seen in {len(pictures)} pictures with a laser-ranged boat")
    both = {
        "without": range_boats(boats, without, keypoint_share, drawn_size_std),
        "with": range_boats(boats, joined, keypoint_share, drawn_size_std),
    }
    table = range_table(both, len(pictures), draws)
    with atomic_write(output / "horizon_ranges.md") as temporary:
        temporary.write_text(table.to_markdown(), encoding="utf-8")
    print(table.to_markdown())


def joined_with_horizon(frame: Frame, edge_m: float | None) -> Frame | None:
    """The frame with the attitude that its camera and the horizon in its picture give together; None where none is."""
    camera = camera_to(frame.camera, dtype=torch.float64)
    edge = None if edge_m is None else flat_edge(camera, edge_m)
    sight = find_horizon(read_picture(frame.image_path), camera, edge)
    if sight.attitude is None:
        return None
    attitude = combine([camera_attitude(camera), sight.attitude]).attitude
    return dataclasses.replace(frame, camera=with_attitude(camera, *attitude))


def range_boats(
    boats: Sequence[RangedBoat], frames: Sequence[Frame], share: float, size_std: float
) -> list[RangedBoat]:
    """Boats ranged with the cameras of these frames, one for each."""
    cases = native_cases([(item.boat, frame) for item, frame in zip(boats, frames) if item.boat is not None])
    return range_anew(boats, cases.with_noise(share, size_std), RangingLayer())


def range_table(both: dict[str, list[RangedBoat]], pictures: int, draws: int) -> Table:
    """Errors of every estimator without and with the horizon."""
    rows: list[list[Cell]] = []
    disturbed_m = range_errors(both["without"], "waterline").rmse_m
    for horizon, ranged in both.items():
        for name in ESTIMATORS:
            e = range_errors(ranged, name)
            ratio = e.rmse_m / disturbed_m
            rows.append([horizon, name, e.n, e.missed, e.rmse_m, ratio, e.median_relative_error, e.coverage_90])
    seen = {id(item.truth) for item in both["with"]}
    return Table(
        title="Slant range of a disturbed camera, metres",
        columns=[
            *(Column(name) for name in ("Horizon", "Estimator", "n", "missed", "RMSE")),
            Column("of waterline's without", digits=2),
            Column("rel. error", digits=2, percent=True),
            Column("raw 90 % hit", digits=0, percent=True),
        ],
        rows=rows,
        note=f"{len(seen)} boats whose horizon was seen in at least one of {draws} draws, of {pictures} pictures.",
    )


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
