"""How true the ranges are, by scene and by distance, and whether their stated uncertainty can be believed.

The reference is the laser's reading, slant, in metres; an error is estimate - reading. RMSE is the square root of
MSE (the paper's printed formula forgets the square; its tables do not). A boat that was not found, or whose estimate
is not valid, is counted as missed and never dropped silently: read ``missed`` beside every other figure. A reading of
the farther waterline keypoint is no reference (:func:`usvnet.evaluation.records.comparable_range_m`).
"""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from usvnet.evaluation.records import (
    ESTIMATORS,
    RANGE_CONFIDENCE,
    BoatRecord,
    FloatArray,
    RangeRecord,
    TruthRecord,
    match_boats,
)
from usvnet.intervals import Z_90 as Z_90

SCENES = ("I", "II", "III", "IV", "V", "VI")
DISTANCE_EDGES_M = (0.0, 5.0, 10.0, 15.0, 25.0, 50.0, math.inf)


@dataclass(frozen=True)
class RangeErrors:
    """Errors of one estimator on a set of laser-ranged boats; nan where none was ranged (n = 0)."""

    n: int
    """Boats that were ranged; every figure below is over these."""
    missed: int
    """Boats without a detection above the confidence, or without a valid range."""
    mse_m2: float
    rmse_m: float
    mae_m: float
    median_relative_error: float
    """Median of |error| / reading."""
    bias_m: float
    """Mean error: positive when boats are placed too far away."""
    coverage_68: float
    """Share of readings inside the estimate's central 68 % interval; 0.68 when the uncertainty is honest."""
    coverage_90: float
    width_68_m: float
    """Mean width of that interval."""
    width_90_m: float


@dataclass(frozen=True)
class RangedBoat:
    """A laser-ranged boat and what was predicted for it."""

    picture: int
    truth: TruthRecord
    boat: BoatRecord | None
    """None where it was missed."""


@dataclass(frozen=True)
class RangeScores:
    """Errors by estimator name, over everything and in groups; a group without a ranged boat is left out."""

    overall: dict[str, RangeErrors]
    by_scene: dict[str, dict[str, RangeErrors]]
    """Scene tag -> estimator -> errors, in the paper's order of scenes."""
    by_distance: dict[str, dict[str, RangeErrors]]
    """Bin such as ``"5-10 m"`` -> estimator -> errors, near to far."""


def score_range(
    records: Sequence[Sequence[BoatRecord]],
    truths: Sequence[Sequence[TruthRecord]],
    confidence: float = RANGE_CONFIDENCE,
) -> RangeScores:
    """Compare every estimator of every boat with a laser reading.

    Args:
        records: predicted boats of each picture.
        truths: labelled boats of the same pictures; those with ``range_m`` above 0 are scored.
        confidence: score below which a prediction does not count.

    Raises:
        ValueError: the two have different lengths.
    """
    ranged = ranged_boats(records, truths, confidence)
    by_scene, by_distance = group_boats(ranged)
    return RangeScores(
        overall=_by_estimator(ranged),
        by_scene={scene: _by_estimator(boats) for scene, boats in by_scene.items()},
        by_distance={distance: _by_estimator(boats) for distance, boats in by_distance.items()},
    )


def group_boats(ranged: Sequence[RangedBoat]) -> tuple[dict[str, list[RangedBoat]], dict[str, list[RangedBoat]]]:
    """Sort laser-ranged boats by scene, in the paper's order, and by distance bin, near to far; no empty groups."""
    scenes = {boat.truth.scene for boat in ranged} - {None}
    in_order = sorted(scenes, key=lambda scene: (SCENES.index(scene) if scene in SCENES else len(SCENES), str(scene)))
    return (
        _grouped(ranged, [str(scene) for scene in in_order], lambda truth: str(truth.scene)),
        _grouped(ranged, DISTANCE_BINS, lambda truth: distance_bin(truth.range_m)),
    )


def ranged_boats(
    records: Sequence[Sequence[BoatRecord]],
    truths: Sequence[Sequence[TruthRecord]],
    confidence: float = RANGE_CONFIDENCE,
) -> list[RangedBoat]:
    """List the boats that carry a laser reading with what was predicted for each.

    Raises:
        ValueError: the two have different lengths.
    """
    if len(records) != len(truths):
        raise ValueError(f"predictions of {len(records)} pictures cannot be scored on labels of {len(truths)}")
    return [
        RangedBoat(picture, truth, boat)
        for picture, (boats, labelled) in enumerate(zip(records, truths))
        for truth, boat in zip(labelled, match_boats(boats, labelled, confidence))
        if truth.range_m > 0
    ]


def distance_bin(range_m: float) -> str:
    """Name the distance bin of a reading: ``"5-10 m"`` holds 5 m and not 10 m."""
    return DISTANCE_BINS[int(np.searchsorted(DISTANCE_EDGES_M, range_m, side="right")) - 1]


def range_errors(ranged: Iterable[RangedBoat], estimator: str) -> RangeErrors:
    """Score one estimator on a set of laser-ranged boats."""
    ranged = list(ranged)
    error_m, estimates = usable_errors(ranged, estimator)
    missed = len(ranged) - len(estimates)
    if not estimates:
        return RangeErrors(0, missed, *[float("nan")] * 9)
    reading_m = np.array([estimate.slant_m for estimate in estimates]) - error_m
    half_68_m = np.array([estimate.half_width_68_m for estimate in estimates])
    half_90_m = np.array([estimate.half_width_90_m for estimate in estimates])
    mse_m2 = float(np.mean(error_m**2))
    return RangeErrors(
        n=len(estimates),
        missed=missed,
        mse_m2=mse_m2,
        rmse_m=math.sqrt(mse_m2),
        mae_m=float(np.mean(np.abs(error_m))),
        median_relative_error=float(np.median(np.abs(error_m) / reading_m)),
        bias_m=float(np.mean(error_m)),
        coverage_68=float(np.mean(np.abs(error_m) <= half_68_m)),
        coverage_90=float(np.mean(np.abs(error_m) <= half_90_m)),
        width_68_m=float(np.mean(2 * half_68_m)),
        width_90_m=float(np.mean(2 * half_90_m)),
    )


def usable_errors(ranged: Iterable[RangedBoat], estimator: str) -> tuple[FloatArray, list[RangeRecord]]:
    """Errors (n,) in metres of the boats that have a range by an estimator, and those ranges."""
    pairs = [
        (estimate.slant_m - item.truth.range_m, estimate)
        for item in ranged
        if item.boat is not None and (estimate := item.boat.ranges[estimator]).usable
    ]
    return np.array([error_m for error_m, _ in pairs]), [estimate for _, estimate in pairs]


def _bin_names() -> tuple[str, ...]:
    edges = itertools.pairwise(DISTANCE_EDGES_M)
    return tuple(f"{low:g}-{high:g} m" if math.isfinite(high) else f"{low:g}+ m" for low, high in edges)


DISTANCE_BINS = _bin_names()


def _by_estimator(ranged: Sequence[RangedBoat]) -> dict[str, RangeErrors]:
    return {estimator: range_errors(ranged, estimator) for estimator in ESTIMATORS}


def _grouped(
    ranged: Sequence[RangedBoat], groups: Iterable[str], group_of: Callable[[TruthRecord], str]
) -> dict[str, list[RangedBoat]]:
    members = {group: [boat for boat in ranged if group_of(boat.truth) == group] for group in groups}
    return {group: boats for group, boats in members.items() if boats}
