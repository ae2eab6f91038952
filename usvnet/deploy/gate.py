"""May an eight-bit file take the place of the float one? Decided in metres, on boats whose range is known.

Measured is ``fused``, the range that usvnet shows: it rests on all seven keypoints, so that every one that rounding has
moved is felt, and it is what a person would lose.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from rich.console import Console
from rich.progress import track
from torch import Tensor

from usvnet.data.dataset import BoatDataset, collate
from usvnet.deploy.deployed import plain_inputs
from usvnet.deploy.exported import as_prediction
from usvnet.evaluation.range_metrics import RangedBoat, range_errors, ranged_boats
from usvnet.evaluation.records import to_records, to_truths

ESTIMATOR = "fused"


class Ranging(NamedTuple):
    """How well boats of known range are ranged."""

    boats: int
    """Those with a range."""
    missed: int
    """Of them, those not found or without a valid ``fused`` range."""
    fused_mae_m: float
    """Mean absolute error of ``fused`` over the others, as all the following; nan where none is left."""
    fused_rmse_m: float
    waterline_mae_m: float
    keypoint_median_px: float
    """Median distance of the keypoints from their labels, in pixels of the network's picture."""


class Gate(NamedTuple):
    """What was measured, and what is allowed."""

    float32: Ranging
    int8: Ranging
    tolerance_m: float
    """How much greater the mean absolute error of ``fused`` may be."""

    @property
    def growth_m(self) -> float:
        """How much greater it is."""
        return self.int8.fused_mae_m - self.float32.fused_mae_m

    def check(self) -> None:
        """Let pass what is good enough.

        Raises:
            ValueError: ranges are too much worse or more boats are missed, with what was measured and what is allowed.
        """
        if self.growth_m <= self.tolerance_m and self.int8.missed <= self.float32.missed:
            return
        raise ValueError(
            f"in int8, {self}; allowed are {self.tolerance_m:g} m more and no further boat missed: nothing was written"
        )

    def __str__(self) -> str:
        """Say it in half a sentence."""
        return (
            f"{ESTIMATOR} ranges are {self.int8.fused_mae_m:.3f} m wrong in the mean, in float32 "
            f"{self.float32.fused_mae_m:.3f} m, and {self.int8.missed} of {self.int8.boats} boats are missed, "
            f"in float32 {self.float32.missed}"
        )

    def to_json(self) -> dict[str, Any]:
        """Everything by name; nan, which JSON does not have, as None."""
        return {
            "float32": _without_nan(self.float32),
            "int8": _without_nan(self.int8),
            "estimator": ESTIMATOR,
            "tolerance_m": self.tolerance_m,
        }


def measure(
    answer: Callable[..., dict[str, Tensor]], dataset: BoatDataset, score_threshold: float, title: str
) -> Ranging:
    """Range the labelled boats of a dataset, a picture at a time, with a progress bar on stderr.

    Args:
        answer: from the plain inputs to the named outputs: a module, or a file read back.
        dataset: letterboxed and not augmented.
        score_threshold: lowest score of a boat.
        title: of the progress bar.
    """
    records, truths = [], []
    for index in track(range(len(dataset)), title, console=Console(stderr=True), transient=True):
        batch = collate([dataset[index]])
        with torch.inference_mode():
            named = answer(*plain_inputs(batch.image, batch.camera, batch.hull))
        records += to_records(as_prediction(named, score_threshold))
        truths += to_truths(batch.boats)
    ranged = ranged_boats(records, truths, score_threshold)
    fused, waterline = range_errors(ranged, ESTIMATOR), range_errors(ranged, "waterline")
    return Ranging(
        boats=len(ranged),
        missed=fused.missed,
        fused_mae_m=fused.mae_m,
        fused_rmse_m=fused.rmse_m,
        waterline_mae_m=waterline.mae_m,
        keypoint_median_px=keypoint_median_px(ranged),
    )


def keypoint_median_px(ranged: list[RangedBoat]) -> float:
    """Median distance of all labelled keypoints of the boats that were found; nan where there is none."""
    distances_px = [
        np.linalg.norm(item.boat.keypoints_px - item.truth.keypoints_px, axis=-1)[item.truth.visibility > 0]
        for item in ranged
        if item.boat is not None
    ]
    return float(np.median(np.concatenate(distances_px))) if distances_px else math.nan


def _without_nan(ranging: Ranging) -> dict[str, float | None]:
    return {name: None if math.isnan(value) else value for name, value in ranging._asdict().items()}
