"""The labels of a crop are those of its boat, and perfect refined heatmaps cost nothing."""

import pytest
import torch

from usvnet.config import LossWeights
from usvnet.crops import CROP_SIZE_PX, REFINED_STRIDE, Refinement, place_crops, to_crop
from usvnet.heatmap import encode, window_moments
from usvnet.losses import Criterion
from usvnet.losses.refinement import boats_in_crops

from .scene import label

BOATS = label([[[10.0, 12, 34, 30], [40, 20, 52, 26]]] * 2)
PICTURE, BOAT = torch.tensor([1, 0]), torch.tensor([0, 1])


def perfect() -> Refinement:
    """The right answer for the first boat of the second picture and the second boat of the first."""
    crops = place_crops(BOATS.boxes_px[PICTURE, BOAT], torch.eye(3).expand(2, 3, 3) / 3)
    hints_px = to_crop(BOATS.keypoints_px[PICTURE, BOAT], crops)
    cells = CROP_SIZE_PX // REFINED_STRIDE
    logits = encode(hints_px, cells, cells, REFINED_STRIDE, 1.0)
    moments = window_moments(logits, hints_px.unsqueeze(1), REFINED_STRIDE)
    return Refinement(BOATS.keypoints_px, torch.zeros(2, 2, 7, 2, 2), PICTURE, BOAT, crops, hints_px, logits, moments)


def test_labels_follow_their_boat_into_its_crop():
    found = boats_in_crops(perfect(), BOATS)
    torch.testing.assert_close(found.keypoints_px[:, 0], perfect().hints_px)
    assert (found.visibility == 2).all()
    assert found.present.shape == (2, 1)


def test_a_keypoint_outside_its_crop_is_no_label():
    keypoints_px = BOATS.keypoints_px.clone()
    keypoints_px[1, 0, 3] = 300.0
    found = boats_in_crops(perfect(), BOATS._replace(keypoints_px=keypoints_px))
    assert found.visibility[0, 0].tolist() == [2, 2, 2, 0, 2, 2, 2]


def losses(refinement: Refinement) -> dict[str, torch.Tensor]:
    """Of a refinement that learns alone, of boats that no laser has ranged."""
    no_ranges = BOATS._replace(range_m=torch.zeros(2, 2))
    found: dict[str, torch.Tensor] = (
        Criterion(LossWeights())
        .eval()
        .second_look(no_ranges, torch.ones(2, 2), torch.ones(2, 2, dtype=torch.bool), 1.0, refinement)
    )
    return found


def test_perfect_refined_heatmaps_cost_nothing():
    found = losses(perfect())
    assert found["refined_heatmap"].item() == pytest.approx(0, abs=1e-5)
    assert found["refined_covariance"].item() == pytest.approx(0, abs=1e-3)
    assert found["range"].item() == 0


def test_refined_heatmaps_of_another_boat_cost():
    found = losses(perfect()._replace(heatmap_logits=perfect().heatmap_logits.flip(1)))
    assert found["refined_heatmap"] > 1
    weights = LossWeights()
    expected = weights.heatmap * found["refined_heatmap"] + weights.covariance * found["refined_covariance"]
    torch.testing.assert_close(found["total"], expected)
