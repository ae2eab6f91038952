import math

import pytest
import torch
from torch import Tensor

from usvnet import heatmap
from usvnet.config import LossWeights
from usvnet.losses import Assignment, Criterion, assign, best_keypoints
from usvnet.types import Boats, NetworkOutput

from .scene import guess, label, mirror, perfect

NOTHING = dict.fromkeys(
    ("box", "dfl", "classification", "keypoint", "visibility", "heatmap", "range", "covariance"), 0.0
)
BOXES = [[[9.0, 12.0, 40.0, 37.0], [44.0, 44.0, 58.0, 52.0]], [[20.0, 5.0, 29.0, 12.0], [0.0, 30.0, 33.0, 60.0]]]


def losses(
    output: NetworkOutput, boats: Boats, slant_m: Tensor, weights: LossWeights | None = None, range_scale: float = 1.0
) -> dict[str, Tensor]:
    criterion = Criterion(weights or LossWeights()).eval()
    valid = torch.ones_like(boats.present)
    return criterion(output, boats, *read(output, boats), slant_m, valid, range_scale)


def read(output: NetworkOutput, boats: Boats) -> tuple[Assignment, heatmap.Moments]:
    assignment = assign(output, boats)
    return assignment, heatmap.window_moments(output.heatmap_logits, best_keypoints(output, assignment).float())


def learned(output: NetworkOutput) -> dict[str, Tensor]:
    return {name: tensor for name, tensor in output._asdict().items() if tensor.requires_grad}


def test_the_perfect_answer_costs_nothing():
    boats = label([[[19.5, 27.5, 35.5, 43.5]], [[67.5, 11.5, 83.5, 27.5]]], range_m=12.0)
    visibility = boats.visibility.clone()
    visibility[:, :, 4] = 1
    boats = boats._replace(visibility=visibility)
    result = losses(perfect(boats, 96), boats, slant_m=boats.range_m)
    assert set(result) == {*NOTHING, "total"}
    for name, loss in result.items():
        assert loss.item() == pytest.approx(0, abs=1e-4), name


def test_the_total_is_the_weighted_sum_and_the_parts_are_for_reading_only():
    torch.manual_seed(0)
    weights = LossWeights(1, 2, 3, 4, 5, 6, 7, 8)
    boats = label(BOXES, range_m=20.0)
    result = losses(guess(2), boats, torch.full((2, 2), 25.0), weights, range_scale=0.5)
    expected = sum(getattr(weights, name) * result[name] for name in NOTHING) - 0.5 * 7 * result["range"]
    expected -= 0.5 * 8 * result["covariance"]
    torch.testing.assert_close(result["total"].detach(), expected)
    assert result["total"].requires_grad
    assert not any(result[name].requires_grad for name in NOTHING)


def test_every_answer_is_trained():
    torch.manual_seed(0)
    output = guess(2)
    slant_m = torch.full((2, 2), 25.0, requires_grad=True)
    losses(output, label(BOXES, range_m=20.0), slant_m)["total"].backward()
    for name, tensor in {**learned(output), "slant_m": slant_m}.items():
        assert tensor.grad is not None, name
        assert tensor.grad.isfinite().all(), name
        assert tensor.grad.any(), name


def test_the_range_loss_speaks_through_the_range_alone():
    torch.manual_seed(0)
    output = guess(2)
    slant_m = torch.full((2, 2), 25.0, requires_grad=True)
    weights = LossWeights(**{**NOTHING, "range": 1.0})
    losses(output, label(BOXES, range_m=20.0), slant_m, weights)["total"].backward()
    assert slant_m.grad is not None
    assert (slant_m.grad > 0).all()
    for name, tensor in learned(output).items():
        assert not tensor.grad.any(), name


def test_frames_without_a_range_leave_it_alone():
    torch.manual_seed(0)
    slant_m = torch.tensor([[25.0, math.inf], [3.0, 8.0]], requires_grad=True)
    result = losses(guess(2), label(BOXES), slant_m)
    result["total"].backward()
    assert result["range"].item() == 0
    assert slant_m.grad is not None
    assert (slant_m.grad == 0).all()


@pytest.mark.parametrize("room", [0, 2])
def test_a_batch_without_boats_trains_the_score_alone(room: int):
    torch.manual_seed(0)
    boats = label([[[0.0] * 4] * room] * 2)
    boats = boats._replace(present=torch.zeros_like(boats.present))
    output = guess(2)
    slant_m = torch.full((2, room), math.inf, requires_grad=True)
    result = losses(output, boats, slant_m)
    result["total"].backward()
    assert result["total"].item() == pytest.approx(0.5 * result["classification"].item())
    for name, tensor in {**learned(output), "slant_m": slant_m}.items():
        assert tensor.grad is not None, name
        assert tensor.grad.isfinite().all(), name
        assert bool(tensor.grad.any()) == (name == "class_logits"), name


def test_a_mirror_changes_nothing():
    torch.manual_seed(0)
    output, boats = guess(2), label(BOXES, range_m=20.0)
    visibility = torch.randint(0, 3, boats.visibility.shape)
    boats = boats._replace(visibility=visibility)
    slant_m = torch.rand(2, 2) * 40 + 1
    straight = losses(output, boats, slant_m)
    mirrored = losses(*mirror(output, boats, 64), slant_m)
    for name, loss in straight.items():
        torch.testing.assert_close(mirrored[name], loss, msg=name, rtol=1e-4, atol=1e-5)


def test_windows_move_in_training_only():
    torch.manual_seed(0)
    output, boats = guess(2), label(BOXES)
    criterion = Criterion(LossWeights())
    given = (output, boats, *read(output, boats), torch.ones(2, 2), torch.ones(2, 2, dtype=torch.bool))
    criterion.eval()
    assert criterion(*given)["heatmap"] == criterion(*given)["heatmap"]
    criterion.train()
    assert criterion(*given)["heatmap"] != criterion(*given)["heatmap"]


def test_half_precision_answers_are_judged_in_single():
    torch.manual_seed(0)
    boats = label(BOXES, range_m=20.0)
    output = guess(2)
    half = NetworkOutput(*(t.bfloat16() for t in output[:6]), *output[6:])
    rounded = NetworkOutput(*(t.float() for t in half[:6]), *output[6:])
    slant_m = torch.full((2, 2), 25.0)
    for name, loss in losses(half, boats, slant_m).items():
        torch.testing.assert_close(loss, losses(rounded, boats, slant_m)[name], msg=name)


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_a_bad_weight_is_named(value: float):
    with pytest.raises(ValueError, match=r"loss_weights\.keypoint"):
        LossWeights(keypoint=value)


@pytest.mark.parametrize("name", ["keypoint_sigma", "heatmap_sigma_cells", "heatmap_radius"])
def test_a_bad_setting_is_named(name: str):
    with pytest.raises(ValueError, match=name):
        Criterion(LossWeights(), **{name: 0})


def test_a_false_peak_at_the_other_end_of_the_boat_is_taught_away():
    """40 px from the bow, further than a window reads: where an exchanged coarse keypoint would look for it."""
    boats = label([[[40.0, 60.0, 88.0, 76.0]]])
    output = perfect(boats, 128)
    bow = heatmap.px_to_cell(boats.keypoints_px[0, 0, 0], heatmap.HEATMAP_STRIDE).round().long()
    false = bow + torch.tensor([10, 0])
    logits = output.heatmap_logits.clone()
    logits[0, 0, false[1], false[0]] = 0.0
    logits.requires_grad_()
    criterion = Criterion(LossWeights(**{**NOTHING, "heatmap": 1.0})).eval()
    output = output._replace(heatmap_logits=logits)
    valid = torch.ones_like(boats.present)
    criterion(output, boats, *read(output, boats), boats.range_m, valid)["total"].backward()
    assert logits.grad is not None
    assert logits.grad[0, 0, false[1], false[0]] > 0.1 * logits.grad.abs().max()
