"""Every boat is scored once, by a calibration that has not seen its picture; standard errors know about clusters."""

import dataclasses
import math

import numpy as np
import pytest

from usvnet.evaluation.conformal import fit_intervals
from usvnet.evaluation.cross_calibration import coverage_std, cross_calibrate, deal_folds
from usvnet.evaluation.interval_metrics import interval_errors
from usvnet.evaluation.range_metrics import RangedBoat

from .boats import boat, truth


def ranged(pictures: int, each: int = 1, wrong_by: float = 2.0) -> list[RangedBoat]:
    """Boats at 10 m, ``each`` in a picture, whose Gaussian errors are ``wrong_by`` times what they say."""
    rng = np.random.default_rng(0)
    made = []
    for picture in np.repeat(np.arange(pictures), each):
        label = truth(range_m=10.0)
        found = boat(label, slant_m=10.0 + 0.1 * wrong_by * float(rng.standard_normal()), std_m=0.1)
        made.append(RangedBoat(int(picture), label, found))
    return made


def with_factor(item: RangedBoat, factors) -> RangedBoat:
    ranges = {
        name: dataclasses.replace(e, slant_std_m=e.raw_std_m * factors[name].factor_90, factors=factors[name])
        for name, e in item.boat.ranges.items()
    }
    return dataclasses.replace(item, boat=dataclasses.replace(item.boat, ranges=ranges))


def test_folds_are_balanced_seeded_and_keep_pictures_whole():
    boats = ranged(23, each=2)
    dealt = deal_folds(boats, 5, seed=1)
    pictures = [{item.picture for item in members} for members in dealt]
    assert sorted(map(len, pictures)) == [4, 4, 5, 5, 5]
    assert sum(map(len, pictures)) == len(set.union(*pictures)) == 23  # no picture in two folds
    assert sum(map(len, dealt)) == len(boats)
    again, other = (
        [[item.picture for item in members] for members in deal_folds(boats, 5, seed=seed)] for seed in (1, 2)
    )
    assert again == [[item.picture for item in members] for members in dealt] != other


@pytest.mark.parametrize("folds", [0, 1, 4])
def test_too_few_or_too_many_folds_are_refused(folds):
    with pytest.raises(ValueError, match=f"folds: expected 2 to 3, .* got {folds}"):
        deal_folds(ranged(3), folds, seed=0)


def test_no_boat_is_scored_by_what_it_was_fitted_on():
    boats, seen = ranged(40, each=2), []

    def calibrate(others, held):
        assert not {item.picture for item in others} & {item.picture for item in held}
        assert len(others) + len(held) == len(boats)
        seen.extend(held)
        return [item for item in held for _ in range(3)]

    calibrated = cross_calibrate(boats, calibrate, folds=8)
    assert len(calibrated) == 3 * len(boats)
    assert sorted(map(id, seen)) == sorted(map(id, boats))


def test_intervals_that_are_half_as_wide_as_they_should_be_are_mended():
    boats = ranged(400)

    def calibrate(others, held):
        factors = fit_intervals(others)
        return [with_factor(item, factors) for item in held]

    errors = interval_errors(cross_calibrate(boats, calibrate), "fused")
    assert errors.before.coverage_90 < 0.65  # P(|N(0, 1)| < 1.645 / 2) = 0.59
    assert abs(errors.after.coverage_90 - 0.9) < 0.02
    assert errors.after.negative_log_likelihood < errors.before.negative_log_likelihood - 0.3


def test_standard_error_of_one_boat_a_picture_is_the_binomials():
    boats = ranged(50)
    coverage = interval_errors(boats, "fused").after.coverage_90
    assert coverage_std(boats, "fused") == pytest.approx(math.sqrt(coverage * (1 - coverage) / 50))


def test_draws_that_hit_together_tell_no_more_than_one():
    boats = ranged(50)
    assert coverage_std(5 * boats, "fused") == pytest.approx(coverage_std(boats, "fused"))
    apart = [dataclasses.replace(item, picture=n) for n, item in enumerate(5 * boats)]
    assert coverage_std(apart, "fused") == pytest.approx(coverage_std(boats, "fused") / math.sqrt(5))


def test_without_a_range_there_is_no_standard_error():
    missed = [RangedBoat(0, truth(range_m=10.0), None)]
    assert math.isnan(coverage_std(missed, "fused"))
