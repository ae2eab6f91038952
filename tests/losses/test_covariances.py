"""The covariance that the heatmaps claim is taught to be the covariance that the keypoints' errors have."""

import pytest
import torch
from torch import Tensor

from usvnet import heatmap
from usvnet.losses.covariances import covariance_loss, robust_nll
from usvnet.losses.keypoints import heatmap_loss
from usvnet.types import Boats

from .scene import label

CENTRE_PX = 62.0
CELLS = 32


def labels_at(keypoints_px: Tensor) -> Boats:
    """Boats of B pictures with the keypoints (B, 1, 7, 2)."""
    return label([[[40.0, 40.0, 80.0, 80.0]]] * len(keypoints_px))._replace(keypoints_px=keypoints_px)


def loss(logits: Tensor, boats: Boats, coarse_px: Tensor | None = None) -> Tensor:
    coarse_px = boats.keypoints_px if coarse_px is None else coarse_px
    return covariance_loss(heatmap.window_moments(logits, coarse_px), boats, heatmap.SIGMA_CELLS, 0.01)


def test_gaussian_errors_ask_for_their_own_covariance():
    torch.manual_seed(0)
    root = torch.tensor([[2.0, 0.0], [1.2, 0.7]], dtype=torch.float64)
    errors = torch.randn(400_000, 2, dtype=torch.float64) @ root.T
    covariance = (root @ root.T).requires_grad_()
    (slope,) = torch.autograd.grad(robust_nll(errors, covariance.expand(len(errors), 2, 2)).mean(), covariance)
    torch.testing.assert_close(slope, torch.zeros_like(slope), rtol=0, atol=0.005)
    wrong = [robust_nll(errors, scale * covariance.detach().expand(len(errors), 2, 2)).mean() for scale in (0.7, 1.4)]
    assert min(wrong) > robust_nll(errors, covariance.expand(len(errors), 2, 2)).mean() + 0.01


def test_gradients_of_the_likelihood():
    torch.manual_seed(0)
    error = torch.randn(5, 2, dtype=torch.float64, requires_grad=True)
    root = torch.randn(5, 2, 2, dtype=torch.float64, requires_grad=True)
    eye = torch.eye(2, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda e, r: robust_nll(e, r @ r.transpose(-1, -2) + eye), (error, root))


@pytest.mark.parametrize("start_cells", [0.8, 1.5])
def test_heatmaps_learn_how_wrong_they_are(start_cells: float):
    """Seven noises from 0.6 to 5 px, two of them longish, beside the loss that holds the position, as in training."""
    torch.manual_seed(0)
    noise_px = torch.tensor([[0.6, 0.6], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0], [4.0, 4.0], [1.0, 3.0], [5.0, 1.0]])
    centre_px = torch.full((7, 2), CENTRE_PX)
    logits = heatmap.encode(centre_px, CELLS, CELLS, heatmap.HEATMAP_STRIDE, start_cells).requires_grad_()
    optimiser = torch.optim.Adam([logits], 0.05)
    for _ in range(250):
        boats = labels_at(centre_px + torch.randn(32, 1, 7, 2) * noise_px)
        coarse_px = boats.keypoints_px + 3 * torch.randn(32, 1, 7, 2)
        optimiser.zero_grad()
        maps = logits.expand(32, -1, -1, -1)
        position = heatmap_loss(maps, boats, heatmap.SIGMA_CELLS, heatmap.WINDOW_RADIUS)
        (position + loss(maps, boats, coarse_px)).backward()
        optimiser.step()
    found_px, covariance_px2 = heatmap.decode(logits[None].detach(), centre_px[None, None])
    std_px = covariance_px2[0, 0].diagonal(dim1=-2, dim2=-1).sqrt()
    assert ((std_px - noise_px).abs() < 0.25 * noise_px + 0.3).all()
    assert ((found_px[0, 0] - centre_px).abs() < 0.1 * noise_px + 0.2).all()


def test_a_swapped_end_does_not_rule():
    exact = torch.full((10, 1, 7, 2), CENTRE_PX)
    logits = heatmap.encode(exact[0, 0], CELLS, CELLS, heatmap.HEATMAP_STRIDE, 1.1).expand(10, -1, -1, -1)
    one_off = exact.clone()
    one_off[0] += 40.0
    assert loss(logits, labels_at(one_off), exact) < loss(logits, labels_at(exact), exact) + 1.0


def test_a_map_too_sharp_for_the_floor_still_learns():
    """A decoded variance stands at its floor, where it has no slope of its own."""
    keypoints_px = torch.full((1, 1, 7, 2), CENTRE_PX)
    logits = heatmap.encode(keypoints_px[:, 0], CELLS, CELLS, heatmap.HEATMAP_STRIDE, 0.7).requires_grad_()
    _, covariance_px2 = heatmap.decode(logits, keypoints_px)
    (decoding,) = torch.autograd.grad(covariance_px2.diagonal(dim1=-2, dim2=-1).sum(), logits)
    (taught,) = torch.autograd.grad(loss(logits, labels_at(keypoints_px + 2.0), keypoints_px), logits)
    assert decoding.abs().max() < 1e-6
    assert taught.isfinite().all()
    assert taught.abs().max() > 1e-4


def test_unlabelled_and_unreadable_keypoints_say_nothing():
    torch.manual_seed(0)
    logits = torch.randn(1, 7, CELLS, CELLS, requires_grad=True)
    boats = labels_at(torch.full((1, 1, 7, 2), CENTRE_PX))
    nothing = boats._replace(visibility=torch.zeros_like(boats.visibility))
    outside = torch.full((1, 1, 7, 2), -400.0)
    for silent in (loss(logits, nothing), loss(logits, boats, outside)):
        silent.backward()
        assert silent == 0
        assert logits.grad is not None
        assert not logits.grad.any()
