"""Split-conformal calibration of the range intervals, scaled by the predicted standard deviation.

Angelopoulos & Bates, A Gentle Introduction to Conformal Prediction, 2021, sections 1 and 2.3.2. The score of a
laser-ranged boat that was not trained on is |range - reading| / predicted standard deviation. With n of them, the
ceil((n + 1) c)-th smallest score q makes range +- q standard deviations hold a further boat's reading with a
probability of at least c, whatever the errors' distribution, as long as the boats come from the same waters.

One factor for each estimator and level, nothing by distance: how errors grow with distance is the geometry's part, and
a factor for each bin of a few dozen boats would be known less well than the differences it is to mend.
"""

import math
from collections.abc import Sequence

import numpy as np

from usvnet.evaluation.range_metrics import RangedBoat
from usvnet.evaluation.records import ESTIMATORS, FloatArray
from usvnet.intervals import UNCALIBRATED, Z_68, Z_90, IntervalFactors

MIN_BOATS = 30
"""Fewer say too little about the tails: the coverage that 30 boats give strays by 5 points about 90 %."""

LEAST_FACTOR = 1e-3
"""An interval of no width at all would be claimed where most errors are exactly 0."""


def conformal_quantile(scores: FloatArray, coverage: float) -> float:
    """The ceil((n + 1) coverage)-th smallest of n scores; inf where there are too few for that coverage."""
    rank = math.ceil((len(scores) + 1) * coverage - 1e-9)
    return float(np.sort(scores)[rank - 1]) if rank <= len(scores) else math.inf


def fit_intervals(ranged: Sequence[RangedBoat]) -> dict[str, IntervalFactors]:
    """Find the factors of every estimator.

    Args:
        ranged: laser-ranged boats that were not trained on, their standard deviations raw or calibrated already.

    Returns:
        By estimator; factors of 1 and 0 boats where fewer than :data:`MIN_BOATS` have a range.
    """
    factors = {}
    for name in ESTIMATORS:
        scores = np.array(
            [
                abs(estimate.slant_m - item.truth.range_m) / estimate.raw_std_m
                for item in ranged
                if item.boat is not None and (estimate := item.boat.ranges[name]).usable
            ]
        )
        factors[name] = UNCALIBRATED
        if len(scores) >= MIN_BOATS:
            q_68, q_90 = conformal_quantile(scores, 0.68), conformal_quantile(scores, 0.90)
            factors[name] = IntervalFactors(max(q_68 / Z_68, LEAST_FACTOR), max(q_90 / Z_90, LEAST_FACTOR), len(scores))
    return factors
