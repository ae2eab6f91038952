import math

import pytest
import torch

from usvnet.losses.ranges import TOLERANCE, range_loss

from .scene import label

BOX = [8.0, 8.0, 24.0, 24.0]


def test_range_loss_by_hand():
    """1 % off is quadratic, a factor of 2 off linear; the mean is over the two."""
    boats = label([[BOX], [BOX]], range_m=20.0)
    predicted = torch.tensor([[20.0 * math.exp(0.01)], [40.0]])
    loss, number = range_loss(predicted, torch.ones(2, 1, dtype=torch.bool), boats)
    assert number == 2
    assert loss.item() == pytest.approx((0.01**2 / (2 * TOLERANCE) + math.log(2) - TOLERANCE / 2) / 2, rel=1e-4)


def test_boats_without_range_padding_and_rays_above_the_horizon_do_not_count():
    boats = label([[BOX] * 4], range_m=20.0)
    boats = boats._replace(
        range_m=torch.tensor([[20.0, 0.0, 20.0, 20.0]]), present=torch.tensor([[True, True, False, True]])
    )
    predicted = torch.tensor([[22.0, 5.0, 5.0, math.inf]], requires_grad=True)
    loss, number = range_loss(predicted, torch.tensor([[True, True, True, False]]), boats)
    loss.backward()
    assert number == 1
    assert loss.item() == pytest.approx(math.log(1.1) - TOLERANCE / 2, rel=1e-4)
    assert predicted.grad is not None
    assert predicted.grad[0, 0].item() == pytest.approx(1 / 22)
    assert (predicted.grad[0, 1:] == 0).all()


def test_nothing_ranged_is_zero_and_in_the_graph():
    predicted = torch.tensor([[math.inf], [3.0]], requires_grad=True)
    loss, number = range_loss(predicted, torch.tensor([[False], [True]]), label([[BOX], [BOX]]))
    loss.backward()
    assert (loss.item(), number.item()) == (0, 0)
    assert predicted.grad is not None
    assert (predicted.grad == 0).all()


def test_gradient_of_range_loss():
    boats = label([[BOX] * 3], range_m=20.0)
    predicted = torch.tensor([[20.4, 35.0, 9.0]], dtype=torch.float64, requires_grad=True)
    valid = torch.ones(1, 3, dtype=torch.bool)
    assert torch.autograd.gradcheck(lambda x: range_loss(x, valid, boats)[0], predicted)


def test_an_uncertain_reading_teaches_less_and_a_laser_as_if_it_were_exact():
    """Weight 1 / (1 + (std / range / tolerance)^2), over the number of boats: 20 m +- 1 m has half."""
    predicted, valid = torch.tensor([[22.0, 22.0]]), torch.ones(1, 2, dtype=torch.bool)
    boats = label([[BOX] * 2], range_m=20.0)
    exact, number = range_loss(predicted, valid, boats)
    for std, share in ((0.01, 1.0), (20 * TOLERANCE, 0.5), (60 * TOLERANCE, 0.1)):
        loss, counted = range_loss(predicted, valid, boats._replace(range_std_m=torch.full((1, 2), std)))
        assert loss.item() == pytest.approx(share * exact.item(), rel=1e-3)
        assert counted == number
    one_sure = boats._replace(range_std_m=torch.tensor([[0.0, 1e6]]))
    assert range_loss(predicted, valid, one_sure)[0].item() == pytest.approx(exact.item() / 2, rel=1e-3)
