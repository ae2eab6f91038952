"""What a second look at native pixels is worth: keypoints and ranges with and without it, as Markdown.

usvnet simulate --config configs/simulator/far.yaml --out datasets/far --quality preview
python benchmarks/refinement.py --checkpoint runs/refinement/checkpoints/last.ckpt --root datasets/far --output out
"""

import copy
import itertools
import statistics
import time
from pathlib import Path

import numpy as np
from jsonargparse import auto_cli

from usvnet.checkpoints import load_model, sha256
from usvnet.data import read_dataset
from usvnet.data.dataset import BoatDataset
from usvnet.data.pictures import read_picture
from usvnet.data.records import Frame
from usvnet.deploy.predictor import Predictor
from usvnet.evaluation.evaluator import frame_truths, prediction_meta
from usvnet.evaluation.predictions import predict_dataset, read_predictions
from usvnet.evaluation.range_metrics import RangedBoat, ranged_boats
from usvnet.evaluation.records import FloatArray
from usvnet.files import atomic_write
from usvnet.model import USVNet
from usvnet.types import WATERLINE_KEYPOINTS

EDGES_M = (0.0, 25.0, 40.0, 60.0, 100.0)
ESTIMATORS = ("waterline", "fused")
HEADER = """| Boats | keypoints from | found | keypoint median px | 95 % px | waterline points, rows, median px \
| waterline RMSE m | median rel. error | fused RMSE m | median rel. error |
| :--- | :--- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"""


def main(
    checkpoint: Path,
    root: Path,
    output: Path,
    image_size: int = 640,
    native_size: int = 1920,
    split: str = "test",
    batch_size: int = 4,
) -> None:
    """Predict the same pictures with and without refinement and score them by distance.

    Args:
        checkpoint: of a model with ``refine: native``.
        root: dataset folder.
        output: folder for predictions and ``table.md``.
        image_size: side of the square picture that the detector sees.
        native_size: side of the square that it is shrunk from.
        split: of the dataset.
        batch_size: pictures a batch.

    Raises:
        ValueError: the checkpoint has no refinement.
    """
    refined = load_model(checkpoint)
    if refined.refiner is None:
        raise ValueError(f"{checkpoint}: got a model without refinement, expected one trained with refine: native")
    coarse = copy.deepcopy(refined)
    coarse.refiner = None
    models = {"detector": coarse, "refinement": refined}
    frames = read_dataset(root, split)
    dataset = BoatDataset(frames, image_size, native_px=native_size)
    boats = {}
    for name, model in models.items():
        path = output / f"{name}.jsonl"
        meta = prediction_meta(model, dataset, split) | {"checkpoint_sha256": sha256(checkpoint)}
        if not path.is_file():
            predict_dataset(model, dataset, path, meta, batch_size)
        records = [picture.boats for picture in read_predictions(path, meta)]
        boats[name] = ranged_boats(records, [frame_truths(frame) for frame in frames])
    lines = [HEADER]
    for low, high in [*itertools.pairwise(EDGES_M), (EDGES_M[0], EDGES_M[-1])]:
        for name, found in boats.items():
            group = [boat for boat in found if low <= boat.truth.range_m < high]
            if group:
                lines.append(f"| {low:.0f} to {high:.0f} m | {name} | {row(group)} |")
    lines += ["", f"Milliseconds a picture of {frames[0].size_px[0]} x {frames[0].size_px[1]}, picture to ranges:"]
    lines += [f"{name} {speed_ms(model, frames[0], image_size):.0f}" for name, model in models.items()]
    with atomic_write(output / "table.md") as temporary:
        temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")
    print("\n".join(lines))


def row(group: list[RangedBoat]) -> str:
    """The figures of some laser-ranged boats; errors are over those that were found and have a range."""
    errors_px = [keypoint_errors_px(boat) for boat in group if boat.boat is not None]
    figures = [f"{len(errors_px)} of {len(group)}"]
    if not errors_px:
        return " | ".join([*figures, *["-"] * 7])
    distances_px = np.linalg.norm(np.concatenate(errors_px), axis=-1)
    rows_px = np.concatenate([np.abs(error[list(WATERLINE_KEYPOINTS), 1]) for error in errors_px])
    figures += [f"{np.nanmedian(distances_px):.2f}", f"{np.nanquantile(distances_px, 0.95):.2f}"]
    figures.append(f"{np.nanmedian(rows_px):.2f}")
    for estimator in ESTIMATORS:
        figures += range_figures(group, estimator)
    return " | ".join(figures)


def keypoint_errors_px(found: RangedBoat) -> FloatArray:
    """(7, 2) found less labelled keypoints in native pixels; nan where there is no label."""
    assert found.boat is not None
    error_px = found.boat.keypoints_px - found.truth.keypoints_px
    return np.where((found.truth.visibility > 0)[:, None], error_px, np.nan)


def range_figures(group: list[RangedBoat], estimator: str) -> list[str]:
    """RMSE and median relative error of the boats with a range."""
    pairs = [(found.truth.range_m, found.boat.ranges[estimator]) for found in group if found.boat is not None]
    usable = [(range_m, estimate.slant_m) for range_m, estimate in pairs if estimate.usable]
    if not usable:
        return ["-"] * 2
    range_m, slant_m = np.array(usable).T
    relative = float(np.median(np.abs(slant_m - range_m) / range_m))
    return [f"{np.sqrt(np.mean((slant_m - range_m) ** 2)):.2f}", f"{100 * relative:.1f} %"]


def speed_ms(model: USVNet, frame: Frame, image_size: int, repeats: int = 9) -> float:
    """Median time of one picture in native size through a predictor."""
    predictor = Predictor(model, frame.camera, frame.hull, image_size)
    predictor.warm_up()
    picture = read_picture(frame.image_path)
    times_s = []
    for _ in range(repeats):
        start_s = time.perf_counter()
        predictor(picture)
        times_s.append(time.perf_counter() - start_s)
    return 1000 * statistics.median(times_s)


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
