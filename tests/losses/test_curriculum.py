"""Ranges wait for the keypoints, and the wait is measured where it should be."""

import pytest
import torch

from usvnet.losses.curriculum import MEMORY, RangeCurriculum, keypoint_error

from .scene import label

BOX = [10.0, 10.0, 50.0, 35.0]  # 1000 px^2


def test_the_weight_rises_smoothly_from_twice_the_error_to_the_error():
    curriculum = RangeCurriculum(0.1)
    scales = []
    for error in (1.0, 0.21, 0.2, 0.175, 0.15, 0.125, 0.1, 0.01):
        curriculum.error = torch.tensor(error)
        scales.append(curriculum.scale().item())
    assert scales == pytest.approx([0, 0, 0, 0.15625, 0.5, 0.84375, 1, 1], abs=1e-5)


def test_a_batch_moves_the_running_error_and_one_without_keypoints_does_not():
    curriculum = RangeCurriculum(0.1)
    assert curriculum.scale() == 0
    curriculum.update(torch.tensor(0.2))
    assert curriculum.error.item() == pytest.approx(MEMORY + (1 - MEMORY) * 0.2)
    before = curriculum.error.clone()
    curriculum.update(torch.tensor(torch.nan))
    assert curriculum.error == before


def test_without_an_error_ranges_teach_from_the_start():
    assert RangeCurriculum(None).scale() == 1


@pytest.mark.parametrize("error", [0.0, -1.0, float("nan")])
def test_an_impossible_error_is_named(error: float):
    with pytest.raises(ValueError, match="range_loss_error"):
        RangeCurriculum(error)


def test_the_error_is_a_median_in_sizes_of_the_boat():
    """4 keypoints 10 px off, 3 of them exact: the median is 10 px over the root of 1000 px^2."""
    boats = label([[BOX]])
    found = boats.keypoints_px.clone()
    found[0, 0, :4, 0] += 10
    assert keypoint_error(found, boats).item() == pytest.approx(10 / 1000**0.5)
    found[0, 0, 0] = 1e6  # exchanged ends do not count for more than any other error
    assert keypoint_error(found, boats).item() == pytest.approx(10 / 1000**0.5)
    found[..., 0] += 1e6
    assert keypoint_error(found, boats) == 1


def test_unlabelled_keypoints_and_padding_do_not_count():
    boats = label([[BOX, BOX]])
    visibility = boats.visibility.clone()
    visibility[0, 0, 3:] = 0
    boats = boats._replace(visibility=visibility, present=torch.tensor([[True, False]]))
    found = boats.keypoints_px.clone()
    found[0, 0, 3:] += 100
    found[0, 1] += 100
    assert keypoint_error(found, boats) == 0
    assert keypoint_error(found, boats._replace(present=torch.zeros(1, 2, dtype=torch.bool))).isnan()
