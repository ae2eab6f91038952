import math

import numpy as np
import pytest

from usvnet.evaluation.range_metrics import DISTANCE_BINS, distance_bin, score_range
from usvnet.evaluation.records import ESTIMATORS

from .boats import boat, truth


def test_perfect_ranges_have_no_error_and_full_coverage():
    truths = [[truth(range_m=r, scene=s)] for r, s in [(4.0, "I"), (12.0, "VI"), (7.0, "II")]]
    scores = score_range([[boat(label) for label in labels] for labels in truths], truths)
    for estimator in ESTIMATORS:
        errors = scores.overall[estimator]
        assert (errors.n, errors.missed, errors.mae_m, errors.rmse_m, errors.bias_m) == (3, 0, 0, 0, 0)
        assert (errors.coverage_68, errors.coverage_90) == (1, 1)
    assert list(scores.by_scene) == ["I", "II", "VI"]
    assert list(scores.by_distance) == ["0-5 m", "5-10 m", "10-15 m"]


def test_errors_by_hand():
    truths = [[truth(range_m=10.0)], [truth(range_m=20.0)], [truth(range_m=40.0)]]
    estimates_m = [11.0, 18.0, 40.0]
    records = [[boat(labels[0], slant_m=estimate)] for labels, estimate in zip(truths, estimates_m)]
    errors = score_range(records, truths).overall["waterline"]
    assert errors.mse_m2 == pytest.approx(5 / 3)
    assert errors.rmse_m == pytest.approx(math.sqrt(5 / 3))
    assert errors.mae_m == pytest.approx(1.0)
    assert errors.bias_m == pytest.approx(-1 / 3)
    assert errors.median_relative_error == pytest.approx(0.1)


@pytest.mark.parametrize(
    "prediction",
    [[], [boat(truth(range_m=9.0), score=0.2)], [boat(truth(range_m=9.0), slant_m=math.inf, valid=False)]],
    ids=["nothing found", "below the confidence", "above the horizon"],
)
def test_misses_are_counted(prediction):
    label = truth(range_m=9.0, scene="III")
    scores = score_range([prediction, [boat(label)]], [[label], [label]])
    for group in (scores.overall, scores.by_scene["III"], scores.by_distance["5-10 m"]):
        assert (group["waterline"].n, group["waterline"].missed) == (1, 1)


def test_a_scene_in_which_everything_is_missed_still_shows():
    scores = score_range([[]], [[truth(range_m=9.0, scene="IV")]])
    assert scores.by_scene["IV"]["box_bottom"].missed == 1
    assert math.isnan(scores.by_scene["IV"]["box_bottom"].mae_m)


def test_pictures_without_a_laser_reading_are_not_scored():
    scores = score_range([[boat(truth())], []], [[truth()], [truth()]])
    assert (scores.overall["waterline"].n, scores.overall["waterline"].missed) == (0, 0)


def test_coverage_of_honest_gaussian_errors():
    generator = np.random.default_rng(0)
    truths, records = [], []
    for _ in range(4000):
        label, std_m = truth(range_m=generator.uniform(5, 40)), generator.uniform(0.05, 2.0)
        truths.append([label])
        records.append([boat(label, slant_m=label.range_m + generator.normal(0, std_m), std_m=std_m)])
    errors = score_range(records, truths).overall["waterline"]
    assert errors.coverage_68 == pytest.approx(0.68, abs=0.02)  # binomial standard error 0.007
    assert errors.coverage_90 == pytest.approx(0.90, abs=0.015)
    assert errors.width_90_m / errors.width_68_m == pytest.approx(1.6449 / 0.9945, rel=1e-3)


def test_several_boats_are_matched_by_overlap_whatever_their_order():
    near, far = truth(0.0, range_m=8.0), truth(300.0, range_m=20.0)
    scores = score_range([[boat(far, 0.9), boat(near, 0.8)]], [[near, far]])
    assert scores.overall["waterline"].mae_m == 0
    scores = score_range([[boat(far, 0.9)]], [[near, far]])
    assert (scores.overall["waterline"].n, scores.overall["waterline"].missed) == (1, 1)
    assert list(scores.by_distance) == ["5-10 m", "15-25 m"]


def test_a_lone_labelled_boat_takes_the_best_box_wherever_it_is():
    label, buoy = truth(range_m=8.0), truth(300.0, range_m=20.0)
    scores = score_range([[boat(label, 0.5), boat(buoy, 0.9)]], [[label]])
    assert scores.overall["waterline"].mae_m == pytest.approx(12.0)


@pytest.mark.parametrize(("range_m", "name"), [(0.1, "0-5 m"), (5.0, "5-10 m"), (49.9, "25-50 m"), (50.0, "50+ m")])
def test_distance_bins_hold_their_lower_edge(range_m, name):
    assert distance_bin(range_m) == name
    assert len(DISTANCE_BINS) == 6
