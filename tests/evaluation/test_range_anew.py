"""Ranging boats anew gives what the geometry says of the new pixels, and leaves out whom it left out before."""

import dataclasses

import numpy as np
import pytest
import torch

from usvnet.evaluation.evaluator import frame_truths
from usvnet.evaluation.range_metrics import RangedBoat
from usvnet.evaluation.records import ESTIMATORS
from usvnet.evaluation.reranging import native_cases, range_anew
from usvnet.geometry.ranging import RangingLayer
from usvnet.intervals import IntervalFactors

from .boats import boat


@pytest.fixture
def ranged(dataset):
    """One boat in each of four pictures, the second missed."""
    truths = [frame_truths(frame)[0] for frame in dataset.frames]
    return [RangedBoat(n, truth, None if n == 1 else boat(truth)) for n, truth in enumerate(truths)]


def test_found_boats_get_their_own_ranges_and_missed_ones_none(ranged, dataset):
    found = [item for item in ranged if item.boat is not None]
    cases = native_cases([(item.boat, dataset.frames[item.picture]) for item in found])
    anew = range_anew(ranged, cases, RangingLayer(), {"waterline": IntervalFactors(2.0, 3.0, 50)})
    raw = range_anew(ranged, cases, RangingLayer())
    assert [item.boat is None for item in anew] == [False, True, False, False]
    for before, after, plain in zip(ranged, anew, raw):
        if after.boat is None:
            continue
        assert set(after.boat.ranges) == set(ESTIMATORS)
        waterline = after.boat.ranges["waterline"]
        assert waterline.slant_m == pytest.approx(before.truth.range_m, rel=1e-4)  # what the laser of the fixture read
        assert waterline.raw_std_m == pytest.approx(plain.boat.ranges["waterline"].slant_std_m)
        assert waterline.slant_std_m == pytest.approx(3 * waterline.raw_std_m)
        np.testing.assert_array_equal(after.boat.keypoints_px, before.boat.keypoints_px)


def test_a_camera_pitched_too_far_down_ranges_too_near(ranged, dataset):
    cases = native_cases([(item.boat, dataset.frames[item.picture]) for item in ranged if item.boat is not None])
    pitched = cases.camera._replace(pitch_rad=cases.camera.pitch_rad + torch.tensor(0.01))
    anew = range_anew(ranged, dataclasses.replace(cases, camera=pitched), RangingLayer())
    for before, after in zip(ranged, anew):
        if after.boat is not None:
            assert after.boat.ranges["waterline"].slant_m < 0.99 * before.truth.range_m


def test_other_numbers_of_boats_are_refused(ranged, dataset):
    cases = native_cases([(item.boat, dataset.frames[item.picture]) for item in ranged[:1]])
    with pytest.raises(ValueError, match="got 1 cases for 3 boats"):
        range_anew(ranged, cases, RangingLayer())
