"""Intervals that do not hold what they promise do so after calibration, on boats that it has not seen."""

import dataclasses
import math

import numpy as np
import pytest

from usvnet.evaluation.conformal import MIN_BOATS, conformal_quantile, fit_intervals
from usvnet.evaluation.interval_metrics import interval_errors, reliability, score_intervals
from usvnet.evaluation.range_metrics import RangedBoat, score_range
from usvnet.evaluation.records import ESTIMATORS
from usvnet.intervals import UNCALIBRATED, IntervalFactors

from .boats import boat, truth

CALIBRATION, FRESH = 2000, 2000
HEAVY_TAILED, TOO_WIDE = "waterline", "box_bottom"


def boats(n: int, seed: int) -> list[RangedBoat]:
    """Boats at 5 to 60 m whose sigma grows with the square of the range.

    The sigma of ``waterline`` is half of what it should be and its errors have heavy tails; that of ``box_bottom`` is
    twice too wide, and its errors are Gaussian.
    """
    rng = np.random.default_rng(seed)
    made = []
    for distance_m in rng.uniform(5, 60, n):
        std_m = 0.0005 * distance_m**2 * float(rng.uniform(0.5, 2))
        label = truth(range_m=float(distance_m), scene="I")
        found = boat(label, std_m=std_m)
        ranges = dict(found.ranges)
        for name, error in ((HEAVY_TAILED, 2 * rng.standard_t(3)), (TOO_WIDE, 0.5 * rng.standard_normal())):
            ranges[name] = dataclasses.replace(ranges[name], slant_m=label.range_m + float(error) * std_m)
        made.append(RangedBoat(len(made), label, dataclasses.replace(found, ranges=ranges)))
    return made


def calibrated(ranged: list[RangedBoat], factors: dict[str, IntervalFactors]) -> list[RangedBoat]:
    """What a model with these factors would have said."""
    said = []
    for item in ranged:
        ranges = {
            name: dataclasses.replace(e, slant_std_m=e.slant_std_m * factors[name].factor_90, factors=factors[name])
            for name, e in item.boat.ranges.items()
        }
        said.append(RangedBoat(item.picture, item.truth, dataclasses.replace(item.boat, ranges=ranges)))
    return said


def band(level: float, tail: float = 0.005) -> tuple[float, float]:
    """Exact 99 % band of the share of FRESH readings that an interval calibrated on CALIBRATION boats holds.

    The coverage is Beta(k, n + 1 - k) with k = ceil((n + 1) level), so the number held is beta-binomial.
    """
    k = math.ceil((CALIBRATION + 1) * level)
    a, b, n = k, CALIBRATION + 1 - k, FRESH
    x = np.arange(n + 1)
    lgamma = np.vectorize(math.lgamma)

    def log_beta(p, q):
        return lgamma(p) + lgamma(q) - lgamma(np.asarray(p) + q)

    choose = lgamma(np.array(n + 1)) - lgamma(x + 1) - lgamma(n - x + 1)
    cumulative = np.cumsum(np.exp(choose + log_beta(x + a, n - x + b) - log_beta(a, b)))
    return float(np.searchsorted(cumulative, tail)) / n, float(np.searchsorted(cumulative, 1 - tail)) / n


def test_the_quantile_by_hand():
    scores = np.arange(10.0, 0.0, -1.0)
    assert conformal_quantile(scores, 0.68) == 8  # ceil(11 * 0.68) = 8
    assert conformal_quantile(scores, 0.90) == 10
    assert conformal_quantile(scores, 0.91) == math.inf  # the 11th of ten
    assert conformal_quantile(np.arange(1.0, 100.0), 0.90) == 90  # (99 + 1) * 0.9 exactly


def test_coverage_fails_before_and_holds_after_on_fresh_boats():
    factors = fit_intervals(boats(CALIBRATION, seed=1))
    fresh = calibrated(boats(FRESH, seed=2), factors)
    low_68, high_68 = band(0.68)
    low_90, high_90 = band(0.90)
    assert 0.87 < low_90 < 0.90 < high_90 < 0.93
    heavy, wide = interval_errors(fresh, HEAVY_TAILED), interval_errors(fresh, TOO_WIDE)
    assert heavy.before.coverage_90 < low_90 - 0.1
    assert wide.before.coverage_90 > high_90 + 0.03
    for errors in (heavy, wide):
        assert low_68 <= errors.after.coverage_68 <= high_68
        assert low_90 <= errors.after.coverage_90 <= high_90
        assert errors.after.negative_log_likelihood < errors.before.negative_log_likelihood - 0.1
    assert heavy.after.width_90_m > heavy.before.width_90_m
    assert wide.after.width_90_m < wide.before.width_90_m
    # Gaussian errors need one factor, heavy tails two: their middle is narrower than their flanks say.
    assert factors[TOO_WIDE].factor_68 == pytest.approx(factors[TOO_WIDE].factor_90, rel=0.15)
    assert factors[HEAVY_TAILED].factor_68 < 0.9 * factors[HEAVY_TAILED].factor_90


def test_all_reports_of_an_interval_agree():
    factors = fit_intervals(boats(CALIBRATION, seed=1))
    fresh = calibrated(boats(200, seed=3), factors)
    scores = score_range([[item.boat] for item in fresh], [[item.truth] for item in fresh])
    told = score_intervals(fresh, {HEAVY_TAILED: CALIBRATION})
    after = told.overall[HEAVY_TAILED].after
    errors = scores.overall[HEAVY_TAILED]
    assert (errors.coverage_68, errors.coverage_90) == (after.coverage_68, after.coverage_90)
    assert (errors.width_68_m, errors.width_90_m) == (after.width_68_m, after.width_90_m)
    assert told.calibration_boats[HEAVY_TAILED] == CALIBRATION
    assert told.calibration_boats[TOO_WIDE] == 0
    assert sum(groups[HEAVY_TAILED].n for groups in told.by_distance.values()) == 200
    assert told.by_scene["I"][HEAVY_TAILED] == told.overall[HEAVY_TAILED]
    raw, reached = reliability(fresh, HEAVY_TAILED, np.array([0.5, 0.9]))
    assert reached[1] == after.coverage_90
    assert raw[1] == told.overall[HEAVY_TAILED].before.coverage_90
    assert raw[0] < raw[1]


def test_calibrating_twice_changes_nothing():
    """Factors are found from the raw standard deviation, whatever was applied to it."""
    ranged = boats(CALIBRATION, seed=1)
    factors = fit_intervals(ranged)
    for name, found in fit_intervals(calibrated(ranged, factors)).items():
        assert found == pytest.approx(factors[name], rel=1e-9)


def test_too_few_boats_leave_the_factor_at_one():
    assert fit_intervals(boats(MIN_BOATS - 1, seed=0)) == dict.fromkeys(ESTIMATORS, UNCALIBRATED)
    assert fit_intervals(boats(MIN_BOATS, seed=0))[HEAVY_TAILED].boats == MIN_BOATS


def test_boats_without_a_range_are_not_asked():
    ranged = boats(MIN_BOATS, seed=0)
    missed = [RangedBoat(0, ranged[0].truth, None)] * 5
    assert fit_intervals([*missed, *ranged]) == fit_intervals(ranged)
    empty = interval_errors(missed, HEAVY_TAILED)
    assert empty.n == 0
    assert math.isnan(empty.after.coverage_90)
