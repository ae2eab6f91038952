import pytest
import torch

from usvnet.losses.boxes import complete_iou, iou


def test_iou_by_hand():
    a = torch.tensor([[0.0, 0.0, 4.0, 2.0], [0.0, 0.0, 2.0, 2.0], [0.0, 0.0, 2.0, 2.0]])
    b = torch.tensor([[2.0, 0.0, 4.0, 4.0], [4.0, 0.0, 6.0, 2.0], [0.0, 0.0, 2.0, 2.0]])
    torch.testing.assert_close(iou(a, b), torch.tensor([4 / 12, 0.0, 1.0]))


def test_complete_iou_by_hand():
    """Boxes 4 x 2 and 2 x 4: they share 2 x 2 of 12, so IoU = 1/3; the centres (2, 1) and (3, 2) are sqrt(2) apart
    in an enclosing square of diagonal sqrt(32), so the distance term is 1/16; v = 4/pi^2 (atan 2 - atan 1/2)^2 =
    0.405285 * 0.643501^2 = 0.167826, alpha = v / (2/3 + v) = 0.201111, so the shape term is 0.033752."""
    a = torch.tensor([0.0, 0.0, 4.0, 2.0])
    b = torch.tensor([2.0, 0.0, 4.0, 4.0])
    assert complete_iou(a, b).item() == pytest.approx(1 / 3 - 1 / 16 - 0.033752, abs=1e-6)


def test_complete_iou_of_separate_squares_is_less_the_distance():
    """Equal squares of side 2, centres 4 apart, enclosed in 6 x 2: - 16 / 40."""
    assert complete_iou(torch.tensor([0.0, 0.0, 2.0, 2.0]), torch.tensor([4.0, 0.0, 6.0, 2.0])).item() == pytest.approx(
        -0.4
    )


def test_complete_iou_is_one_for_equal_boxes_symmetric_and_blind_to_scale():
    torch.manual_seed(0)
    corner = torch.rand(2, 20, 2, dtype=torch.float64) * 20
    a, b = torch.cat([corner, corner + 1 + 20 * torch.rand(2, 20, 2, dtype=torch.float64)], -1)
    torch.testing.assert_close(complete_iou(a, a), torch.ones(20, dtype=torch.float64))
    torch.testing.assert_close(complete_iou(a, b), complete_iou(b, a))
    torch.testing.assert_close(complete_iou(a, b), complete_iou(7 * a + 3, 7 * b + 3))


def test_gradient_of_complete_iou():
    a = torch.tensor(
        [[0.0, 1.0, 9.0, 6.0], [3.0, 2.0, 8.0, 12.0], [0.0, 0.0, 5.0, 5.0]], dtype=torch.float64, requires_grad=True
    )
    b = torch.tensor(
        [[2.0, 0.0, 7.5, 8.0], [4.0, 3.0, 6.0, 9.0], [9.0, 8.0, 12.0, 15.0]], dtype=torch.float64, requires_grad=True
    )
    assert torch.autograd.gradcheck(complete_iou, (a, b))


def test_boxes_apart_are_pulled_together():
    box = torch.tensor([0.0, 0.0, 2.0, 2.0], requires_grad=True)
    complete_iou(box, torch.tensor([10.0, 0.0, 12.0, 2.0])).backward()
    assert box.grad is not None
    assert box.grad[0] + box.grad[2] > 0


def test_degenerate_boxes_stay_finite():
    point, line, inside_out = [5.0, 5.0, 5.0, 5.0], [1.0, 5.0, 9.0, 5.0], [9.0, 9.0, 1.0, 1.0]
    boxes = torch.tensor([point, line, inside_out, [0.0, 0.0, 4.0, 4.0]])
    a = boxes.repeat_interleave(4, 0).requires_grad_()
    value = complete_iou(a, boxes.repeat(4, 1))
    value.sum().backward()
    assert value.isfinite().all()
    assert a.grad is not None
    assert a.grad.isfinite().all()
