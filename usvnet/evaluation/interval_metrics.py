"""How honest the intervals are: the share of readings they hold, their width and their likelihood.

Each as it is reported, and as it was before calibration; on boats that calibration did not see.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from usvnet.evaluation.range_metrics import RangedBoat, group_boats, usable_errors
from usvnet.evaluation.records import ESTIMATORS, FloatArray
from usvnet.intervals import Z_68, Z_90


@dataclass(frozen=True)
class Honesty:
    """Of one estimator on a set of laser-ranged boats; nan where there are none."""

    coverage_68: float
    """Share of readings inside the central 68 % interval; 0.68 when the uncertainty is honest."""
    coverage_90: float
    width_68_m: float
    """Mean width of that interval."""
    width_90_m: float
    negative_log_likelihood: float
    """Mean over the boats of that of the reading under a Gaussian about the range, readings in metres."""


@dataclass(frozen=True)
class IntervalErrors:
    """Before and after calibration."""

    n: int
    before: Honesty
    after: Honesty


@dataclass(frozen=True)
class IntervalScores:
    """By estimator, over everything and in the groups of :class:`usvnet.evaluation.range_metrics.RangeScores`."""

    calibration_boats: dict[str, int]
    """Laser-ranged boats that each estimator was calibrated on; 0 where it was not, and both halves are the same."""
    overall: dict[str, IntervalErrors]
    by_scene: dict[str, dict[str, IntervalErrors]]
    by_distance: dict[str, dict[str, IntervalErrors]]


def score_intervals(ranged: Sequence[RangedBoat], calibration_boats: Mapping[str, int]) -> IntervalScores:
    """Score every estimator's intervals."""
    by_scene, by_distance = group_boats(ranged)
    return IntervalScores(
        calibration_boats={name: calibration_boats.get(name, 0) for name in ESTIMATORS},
        overall=_by_estimator(ranged),
        by_scene={scene: _by_estimator(boats) for scene, boats in by_scene.items()},
        by_distance={distance: _by_estimator(boats) for distance, boats in by_distance.items()},
    )


def interval_errors(ranged: Sequence[RangedBoat], estimator: str) -> IntervalErrors:
    """Score one estimator on a set of laser-ranged boats."""
    error_m, estimates = usable_errors(ranged, estimator)
    columns = [(estimate.raw_std_m, estimate.slant_std_m, estimate.half_width_68_m) for estimate in estimates]
    raw_m, std_m, half_68_m = np.array(columns).reshape(-1, 3).T
    return IntervalErrors(
        n=len(error_m),
        before=_honesty(error_m, raw_m, Z_68 * raw_m),
        after=_honesty(error_m, std_m, half_68_m),
    )


def reliability(ranged: Sequence[RangedBoat], estimator: str, nominal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Share of readings inside the central Gaussian interval of every nominal coverage, by raw and calibrated sigma.

    Args:
        ranged: laser-ranged boats; those without a range by the estimator are left out.
        estimator: its name.
        nominal: (L,) coverages in (0, 1).

    Returns:
        Two (L,) shares; nan where there is no boat.
    """
    error_m, estimates = usable_errors(ranged, estimator)
    z = np.array([NormalDist().inv_cdf((1 + level) / 2) for level in nominal])
    if not estimates:
        return np.full(len(z), np.nan), np.full(len(z), np.nan)
    raw, calibrated = (
        np.mean(np.abs(error_m) / np.array(std_m) <= z[:, None], axis=1)
        for std_m in ([e.raw_std_m for e in estimates], [e.slant_std_m for e in estimates])
    )
    return raw, calibrated


def _by_estimator(ranged: Sequence[RangedBoat]) -> dict[str, IntervalErrors]:
    return {estimator: interval_errors(ranged, estimator) for estimator in ESTIMATORS}


def _honesty(error_m: FloatArray, std_m: FloatArray, half_68_m: FloatArray) -> Honesty:
    if not len(error_m):
        return Honesty(*[math.nan] * 5)
    return Honesty(
        coverage_68=float(np.mean(np.abs(error_m) <= half_68_m)),
        coverage_90=float(np.mean(np.abs(error_m) <= Z_90 * std_m)),
        width_68_m=float(np.mean(2 * half_68_m)),
        width_90_m=float(np.mean(2 * Z_90 * std_m)),
        negative_log_likelihood=float(np.mean(0.5 * np.log(2 * np.pi * std_m**2) + 0.5 * (error_m / std_m) ** 2)),
    )
