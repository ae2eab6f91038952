"""The share of a boat's size by which keypoints stray comes back from boats made with it."""

import dataclasses

import numpy as np
import pytest

from usvnet.evaluation.keypoint_calibration import MIN_KEYPOINTS, fit_keypoint_share

from .boats import boat, truth


def strayed(count: int, share: float, claimed_px: float, gross: float = 0.0, seed: int = 0):
    """Boats whose keypoints stray by what they claim and by a share of their size; some by 40 px more."""
    rng = np.random.default_rng(seed)
    pairs = []
    for _ in range(count):
        labelled = truth()
        predicted = boat(labelled)
        size_px = np.sqrt(np.prod(predicted.box_px[2:] - predicted.box_px[:2]))
        std_px = np.hypot(claimed_px, share * size_px)
        error_px = std_px * rng.standard_normal((7, 2)) + 40 * (rng.random((7, 1)) < gross)
        covariance_px2 = claimed_px**2 * np.broadcast_to(np.eye(2), (7, 2, 2))
        keypoints_px = labelled.keypoints_px + error_px
        changed = dataclasses.replace(predicted, keypoints_px=keypoints_px, keypoint_covariance_px2=covariance_px2)
        pairs.append((changed, labelled))
    return pairs


@pytest.mark.parametrize("share", [0.01, 0.04])
def test_the_share_comes_back(share):
    assert fit_keypoint_share(strayed(300, share, 0.3)) == pytest.approx(share, rel=0.15)


def test_honest_heatmaps_need_none():
    assert fit_keypoint_share(strayed(300, 0.0, 2.0)) < 0.005


def test_gross_errors_do_not_rule_it():
    assert fit_keypoint_share(strayed(300, 0.04, 0.3, gross=0.05)) == pytest.approx(0.045, abs=0.012)


def test_too_few_keypoints_say_nothing():
    assert fit_keypoint_share(strayed(MIN_KEYPOINTS // 7, 0.04, 0.3)) == 0.0
    assert fit_keypoint_share([]) == 0.0
