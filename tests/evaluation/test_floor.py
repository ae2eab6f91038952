"""RMSE beside what the keypoints' own noise allows."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from usvnet.data.records import Frame
from usvnet.evaluation.disturbances import disturb, drawn_amount
from usvnet.evaluation.floor import robust_covariance, score_floor
from usvnet.evaluation.range_metrics import RangedBoat
from usvnet.evaluation.reranging import range_cases, slants_m
from usvnet.evaluation.scenario_boats import scenario_cases
from usvnet.geometry.camera import make_camera
from usvnet.geometry.hull_model import generic_hull
from usvnet.geometry.ranging import RangingLayer

from .boats import boat, truth

NOISE_PX = 0.7
BOATS = 300
CAMERA = make_camera([[700.0, 0, 320.0], [0, 700.0, 240.0], [0, 0, 1]], (640, 480), height_m=1.5, pitch_rad=0.05)


def noisy_boats() -> tuple[list[RangedBoat], list[Frame]]:
    """Boats at 8 m and 12 m, stern on, their keypoints and boxes off by Gaussian noise."""
    truths = scenario_cases(CAMERA, generic_hull(), [8.0, 12.0], [0.0], keypoint_std_px=NOISE_PX).repeat(BOATS)
    ranging = RangingLayer()
    reading_m = slants_m(truths, ranging)["waterline"].tolist()
    generator = torch.Generator().manual_seed(0)
    found = disturb(truths, "keypoint_px", drawn_amount("keypoint_px", NOISE_PX, truths.count, generator))
    estimates = range_cases(found, ranging)
    ranged, frames = [], []
    for n in range(truths.count):
        label = dataclasses.replace(
            truth(range_m=reading_m[n]),
            keypoints_px=truths.keypoints_px[n].numpy(),
            box_px=truths.boxes_px[n].numpy(),
        )
        record = dataclasses.replace(
            boat(label), keypoints_px=found.keypoints_px[n].numpy(), box_px=found.boxes_px[n].numpy()
        )
        ranges = {
            name: dataclasses.replace(record.ranges[name], slant_m=float(e.slant_m[n]), valid=bool(e.valid[n]))
            for name, e in estimates.items()
        }
        ranged.append(RangedBoat(n, label, dataclasses.replace(record, ranges=ranges)))
        nothing = np.zeros(0)
        frames.append(
            Frame(Path("x.jpg"), "x", None, CAMERA, label.box_px, label.keypoints_px, label.visibility, *[nothing] * 3)
        )
    return ranged, frames


@pytest.fixture(scope="module")
def scores():
    return score_floor(*noisy_boats(), curved_water=False)


@pytest.mark.parametrize("estimator", ["box_bottom", "waterline"])
def test_pure_pixel_noise_reaches_the_floor(scores, estimator):
    floor = scores.overall[estimator]
    assert floor.n == 2 * BOATS
    assert floor.ratio == pytest.approx(1.0, abs=0.1)
    near, far = scores.by_distance["5-10 m"][estimator], scores.by_distance["10-15 m"][estimator]
    assert far.floor_m == pytest.approx(near.floor_m * (12 / 8) ** 2, rel=0.15)


def test_the_noise_is_measured(scores):
    assert list(scores.waterline_noise_px.values()) == pytest.approx([NOISE_PX] * 2, rel=0.1)


def test_a_bias_shows_as_a_ratio_above_one(scores):
    ranged, frames = noisy_boats()
    wrong = []
    for item in ranged:
        ranges = {name: dataclasses.replace(e, slant_m=e.slant_m + 0.5) for name, e in item.boat.ranges.items()}
        wrong.append(RangedBoat(item.picture, item.truth, dataclasses.replace(item.boat, ranges=ranges)))
    biased = score_floor(wrong, frames, curved_water=False).overall["waterline"]
    assert biased.floor_m == scores.overall["waterline"].floor_m
    assert biased.ratio > 3


def test_the_covariance_of_gaussian_errors_and_its_outliers():
    rng = np.random.default_rng(0)
    root = np.array([[2.0, 0.0], [1.2, 0.7]])
    errors = rng.standard_normal((4000, 2)) @ root.T
    np.testing.assert_allclose(robust_covariance(errors), root @ root.T, rtol=0.08, atol=0.05)
    swapped = np.where(rng.random((4000, 1)) < 0.03, errors + 60.0, errors)
    np.testing.assert_allclose(robust_covariance(swapped), root @ root.T, rtol=0.25, atol=0.1)
    assert np.cov(swapped.T)[0, 0] > 80


def test_no_error_at_all_is_the_floor_of_decoding():
    for errors in (np.zeros((20, 2)), np.zeros((0, 2))):
        assert np.diag(robust_covariance(errors)) == pytest.approx([1e-4, 1e-4], rel=1e-6)


def test_without_a_boat_there_is_no_floor():
    scores = score_floor([RangedBoat(0, truth(range_m=5.0), None)], [], curved_water=False)
    assert scores.by_distance == {}
    assert np.isnan(scores.overall["waterline"].ratio)
