import math

import pytest
import torch

from usvnet.losses.detection import box_loss, classification_loss, distribution_focal_loss, side_distances


def test_side_distances_by_hand():
    box, anchor = torch.tensor([[3.5, 11.5, 27.5, 35.5]]), torch.tensor([[19.5, 15.5]])
    assert side_distances(box, anchor, torch.tensor([8.0])).tolist() == [[2.0, 0.5, 1.0, 2.5]]


def test_box_loss_is_a_mean_weighted_by_the_target_score():
    boxes = torch.tensor([[0.0, 0.0, 2.0, 2.0], [0.0, 0.0, 2.0, 2.0]])
    targets = torch.tensor([[0.0, 0.0, 2.0, 2.0], [4.0, 0.0, 6.0, 2.0]])  # CIoU 1 and -0.4
    assert box_loss(boxes, targets, torch.tensor([0.3, 0.1])).item() == pytest.approx(1.4 / 4)


def test_distribution_focal_loss_by_hand():
    """Distance 1.25 with probabilities 1/8, 5/8, 2/8: -(0.75 ln 5/8 + 0.25 ln 2/8)."""
    logits = torch.tensor([1.0, 5.0, 2.0]).log().expand(1, 4, 3)
    loss = distribution_focal_loss(logits, torch.full((1, 4), 1.25), torch.tensor([0.4]))
    assert loss.item() == pytest.approx(-(0.75 * math.log(5 / 8) + 0.25 * math.log(2 / 8)))


def test_distribution_focal_loss_clamps_distances_into_the_bins():
    torch.manual_seed(0)
    logits, weight = torch.randn(1, 4, 8), torch.ones(1)
    beyond = distribution_focal_loss(logits, torch.tensor([[-3.0, 7.0, 99.0, 0.0]]), weight)
    within = distribution_focal_loss(logits, torch.tensor([[0.0, 6.99, 6.99, 0.0]]), weight)
    assert beyond.item() == pytest.approx(within.item())


def test_the_expectation_of_a_trained_distribution_is_the_distance():
    torch.manual_seed(0)
    logits = torch.zeros(1, 4, 16, requires_grad=True)
    distances = torch.tensor([[0.3, 2.0, 7.75, 14.1]])
    optimiser = torch.optim.Adam([logits], lr=0.3)
    for _ in range(200):
        optimiser.zero_grad()
        distribution_focal_loss(logits, distances, torch.ones(1)).backward()
        optimiser.step()
    torch.testing.assert_close((logits.softmax(-1) * torch.arange(16.0)).sum(-1), distances, atol=0.03, rtol=0)


def test_gradient_of_distribution_focal_loss():
    torch.manual_seed(0)
    logits = torch.randn(3, 4, 6, dtype=torch.float64, requires_grad=True)
    distances = torch.rand(3, 4, dtype=torch.float64) * 5
    weight = torch.rand(3, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: distribution_focal_loss(x, distances, weight), logits)


def test_classification_loss_is_normalised_by_the_targets_but_by_one_at_least():
    logits = torch.zeros(1, 4)
    assert classification_loss(logits, torch.tensor([[1.0, 1.0, 0.0, 0.0]])).item() == pytest.approx(2 * math.log(2))
    assert classification_loss(logits, torch.zeros(1, 4)).item() == pytest.approx(4 * math.log(2))


def test_without_foreground_the_losses_are_zero_and_in_the_graph():
    boxes = torch.zeros(0, 4, requires_grad=True)
    logits = torch.zeros(0, 4, 16, requires_grad=True)
    weight = torch.zeros(0)
    loss = box_loss(boxes, torch.zeros(0, 4), weight) + distribution_focal_loss(logits, torch.zeros(0, 4), weight)
    loss.backward()
    assert loss.item() == 0
    assert boxes.grad is not None
    assert logits.grad is not None
