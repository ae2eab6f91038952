import math

import pytest
import torch

from usvnet import heatmap
from usvnet.losses.keypoints import heatmap_loss, keypoint_loss, visibility_loss

from .scene import label

BOX = torch.tensor([[10.0, 10.0, 50.0, 35.0]])  # 1000 px^2


def test_keypoint_loss_by_hand():
    """d^2 = 80 in 1000 px^2 at sigma 0.1: e = 80 / (2 * 1000 * 0.04) = 1, so ln 2; the hidden keypoint is right."""
    target = torch.zeros(1, 3, 2)
    predicted = torch.tensor([[[8.0, 4.0], [0.0, 0.0], [500.0, 0.0]]])
    loss = keypoint_loss(predicted, target, torch.tensor([[2, 1, 0]]), BOX, sigma=0.1)
    assert loss.item() == pytest.approx(math.log(2) / 2)


def test_keypoint_loss_equals_the_similarity_near_and_still_pulls_from_far():
    visibility = torch.full((1, 1), 2)
    target = torch.zeros(1, 1, 2, dtype=torch.float64)
    near = torch.tensor([[[0.9, 0.0]]], dtype=torch.float64)
    e = 0.81 / (2 * 1000 * 0.04)
    loss = keypoint_loss(near, target, visibility, BOX.double(), 0.1).item()
    assert loss == pytest.approx(1 - math.exp(-e), rel=1e-4)
    far = torch.tensor([[[200.0, 0.0]]], dtype=torch.float64, requires_grad=True)
    keypoint_loss(far, target, visibility, BOX.double(), 0.1).backward()
    assert far.grad is not None
    assert far.grad[0, 0, 0].item() == pytest.approx(2 / 200, rel=0.01)  # the similarity's own: exp(-500)


def test_anchors_without_labelled_keypoints_do_not_dilute_the_mean():
    predicted = torch.tensor([[[8.0, 4.0]], [[8.0, 4.0]]])
    loss = keypoint_loss(predicted, torch.zeros(2, 1, 2), torch.tensor([[2], [0]]), BOX.expand(2, 4), 0.1)
    assert loss.item() == pytest.approx(math.log(2))


def test_gradient_of_keypoint_loss():
    torch.manual_seed(0)
    predicted = (20 * torch.randn(2, 7, 2, dtype=torch.float64)).requires_grad_()
    target = 20 * torch.randn(2, 7, 2, dtype=torch.float64)
    visibility = torch.randint(0, 3, (2, 7))
    boxes = torch.tensor([[0.0, 0.0, 30.0, 20.0], [5.0, 5.0, 5.0, 5.0]], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: keypoint_loss(x, target, visibility, boxes, 0.1), predicted)


def test_visibility_means_seen():
    right = torch.tensor([[20.0, -20.0, -20.0]])
    assert visibility_loss(right, torch.tensor([[2, 1, 0]])).item() < 1e-6
    assert visibility_loss(torch.zeros(1, 3), torch.tensor([[2, 1, 0]])).item() == pytest.approx(math.log(2))


def test_a_boat_without_keypoint_labels_says_nothing_about_visibility():
    assert visibility_loss(torch.full((1, 3), 5.0), torch.zeros(1, 3, dtype=torch.int64)).item() == 0


def test_heatmap_loss_is_zero_for_the_encoded_keypoints_wherever_the_window_sits():
    torch.manual_seed(0)
    boats = label([[[9.0, 11.0, 60.0, 49.0]], [[30.0, 0.0, 63.0, 20.0]]])
    logits = heatmap.encode(boats.keypoints_px[:, 0], 16, 16, heatmap.HEATMAP_STRIDE, 1.0)
    for _ in range(5):
        assert heatmap_loss(logits + 3, boats, 1.0, 6, jitter_cells=3).item() == pytest.approx(0, abs=1e-5)


def test_heatmap_loss_of_a_shifted_gaussian_by_hand():
    """Equal Gaussians d apart: the divergence is d^2 / (2 sigma^2); 2 px is half a cell, so 1/8."""
    boats = label([[[40.0, 40.0, 80.0, 80.0]]])
    shifted = boats.keypoints_px[:, 0] + torch.tensor([2.0, 0.0])
    logits = heatmap.encode(shifted, 32, 32, heatmap.HEATMAP_STRIDE, 1.0)
    assert heatmap_loss(logits, boats, 1.0, 6).item() == pytest.approx(1 / 8, rel=1e-3)


def test_the_whole_map_is_held_against_the_keypoint_and_a_window_knows_nothing_of_the_rest():
    """A second peak, as high as the right one and far from it, takes half of the softmax: ln 2."""
    boats = label([[[40.0, 40.0, 60.0, 60.0]]])
    logits = heatmap.encode(boats.keypoints_px[:, 0], 30, 32, heatmap.HEATMAP_STRIDE, 1.0)
    assert heatmap_loss(logits - 3, boats, 1.0, None).item() == pytest.approx(0, abs=1e-5)
    other = heatmap.encode(boats.keypoints_px[:, 0] + 40, 30, 32, heatmap.HEATMAP_STRIDE, 1.0)
    both = torch.logaddexp(logits, other)
    assert heatmap_loss(both, boats, 1.0, None).item() == pytest.approx(math.log(2), abs=1e-3)
    assert heatmap_loss(both, boats, 1.0, 4).item() == pytest.approx(0, abs=1e-3)


def test_heatmap_loss_trains_hidden_keypoints_but_not_unlabelled_ones_nor_padding():
    torch.manual_seed(0)
    boats = label([[[9.0, 11.0, 60.0, 49.0], [20.0, 20.0, 40.0, 30.0]]])
    visibility = boats.visibility.clone()
    visibility[0, 0, 2:4] = torch.tensor([0, 1])
    keypoints = boats.keypoints_px.clone()
    keypoints[0, 0, 2] = float("nan")
    keypoints[0, 1] = 1e9
    boats = boats._replace(visibility=visibility, keypoints_px=keypoints, present=torch.tensor([[True, False]]))
    logits = torch.randn(1, 7, 16, 16, requires_grad=True)
    loss = heatmap_loss(logits, boats, 1.0, 6)
    loss.backward()
    assert loss.isfinite()
    assert logits.grad is not None
    assert logits.grad.isfinite().all()
    assert (logits.grad[0, 2] == 0).all()
    assert (logits.grad[0, [0, 1, 3, 4, 5, 6]] != 0).any(-1).any(-1).all()


def test_gradient_of_heatmap_loss():
    """A keypoint near the corner, so that part of its window is off the map."""
    torch.manual_seed(0)
    boats = label([[[1.0, 2.0, 22.0, 19.0]]])
    logits = torch.randn(1, 7, 6, 6, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x: heatmap_loss(x, boats, 1.0, 2), logits)
    assert torch.autograd.gradcheck(lambda x: heatmap_loss(x, boats, 1.0, None), logits)


def test_free_logits_learn_to_decode_to_the_keypoint():
    torch.manual_seed(0)
    boats = label([[[21.3, 30.9, 71.6, 66.2]]])
    logits = torch.zeros(1, 7, 24, 24, requires_grad=True)
    optimiser = torch.optim.Adam([logits], lr=0.3)
    for _ in range(150):
        optimiser.zero_grad()
        heatmap_loss(logits, boats, 1.0, 6, jitter_cells=3).backward()
        optimiser.step()
    coarse_px = boats.keypoints_px + torch.tensor([7.0, -6.0])
    decoded_px, _ = heatmap.decode(logits, coarse_px, heatmap.HEATMAP_STRIDE, 6, 1.0)
    assert (decoded_px - boats.keypoints_px).norm(dim=-1).max() < 0.2
