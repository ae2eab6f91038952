import pytest
import torch

from usvnet.losses.assigner import MIN_PEAK_SCORE, assign
from usvnet.losses.boxes import complete_iou
from usvnet.types import Boats, NetworkOutput

from .scene import guess, label

FAR_AWAY = [900.0, 900.0, 910.0, 910.0]


def answer(size_px: int, boxes: dict[int, list[float]], scores: dict[int, float]) -> NetworkOutput:
    """One picture with anchors of stride 8; what is not stated misses everything with score 0.01."""
    output = guess(1, size_px, (8,))
    count = len(output.anchors_px)
    boxes_px = torch.tensor([[boxes.get(i, FAR_AWAY) for i in range(count)]])
    class_logits = torch.tensor([[scores.get(i, 0.01) for i in range(count)]]).logit().unsqueeze(-1)
    return output._replace(boxes_px=boxes_px, class_logits=class_logits)


def test_by_hand():
    """Anchors at 3.5, 11.5, 19.5, 27.5; those at 11.5 and 19.5 (indices 5, 6, 9, 10) lie inside the box."""
    boat = [8.0, 8.0, 24.0, 24.0]
    half = [8.0, 8.0, 24.0, 16.0]
    output = answer(32, {0: boat, 5: boat, 6: half, 9: half}, {0: 0.9, 5: 0.25, 6: 0.81, 9: 0.16})
    result = assign(output, label([[boat]]), topk=3)
    assert result.foreground.nonzero()[:, 1].tolist() == [5, 6, 9]  # 0 is perfect but outside, 10 comes fourth
    overlap = complete_iou(torch.tensor(half), torch.tensor(boat)).item()
    expected = {5: 1.0, 6: 0.9 * overlap**6 / 0.5, 9: 0.4 * overlap**6 / 0.5}
    for anchor in range(16):
        assert result.target_score[0, anchor].item() == pytest.approx(expected.get(anchor, 0.0), rel=1e-4)
    assert result.best_anchor.tolist() == [[5]]


def test_an_anchor_wanted_by_two_boats_goes_to_the_one_it_overlaps_best():
    large, small = [0.0, 0.0, 31.0, 31.0], [8.0, 8.0, 15.0, 15.0]
    output = answer(32, {5: small, 10: large}, {5: 0.5, 10: 0.5})
    result = assign(output, label([[large, small]]), topk=10)
    assert result.boat_index[0, 5] == 1
    assert result.boat_index[0, 10] == 0
    assert result.best_anchor.tolist() == [[10, 5]]


def test_a_boat_that_loses_every_anchor_still_has_a_best_one():
    large, small = [0.0, 0.0, 31.0, 31.0], [8.0, 8.0, 15.0, 15.0]
    output = answer(32, {5: large}, {5: 0.5})
    result = assign(output, label([[large, small]]), topk=10)
    assert not (result.foreground & (result.boat_index == 1)).any()
    assert result.best_anchor.tolist() == [[5, 5]]


@pytest.mark.parametrize("centre", [(31.5, 31.5), (20.0, 33.0), (-0.5, -0.5), (63.5, 40.0), (70.0, 40.0)])
def test_a_tiny_far_boat_gets_an_anchor_beside_it(centre: tuple[float, float]):
    u, v = centre
    output = guess(1, 64)
    result = assign(output, label([[[u - 1, v - 0.5, u + 1, v + 0.5]]]))
    chosen = output.anchors_px[result.foreground[0]]
    assert len(chosen) > 0
    nearest = (output.anchors_px - torch.tensor(centre)).norm(dim=-1).min()
    assert (chosen - torch.tensor(centre)).norm(dim=-1).min() == nearest
    assert result.foreground[0, result.best_anchor[0, 0]]


def test_a_thin_far_boat_gets_every_anchor_along_it():
    """20 x 2 px between the rows of anchors at 11.5 and 19.5: none lies inside the box."""
    output = guess(1, 64, (8,))
    result = assign(output, label([[[9.0, 14.0, 29.0, 16.0]]]))
    assert output.anchors_px[result.foreground[0]].tolist() == [[11.5, 11.5], [19.5, 11.5], [27.5, 11.5]]


def test_guesses_that_all_miss_still_have_something_to_learn():
    output = answer(32, {}, {5: 0.2, 6: 0.1})
    result = assign(output, label([[[8.0, 8.0, 24.0, 24.0]]]))
    assert result.best_anchor.tolist() == [[5]]
    assert result.target_score[0, 5].item() == pytest.approx(MIN_PEAK_SCORE)
    assert result.target_score[0, 6].item() == pytest.approx(MIN_PEAK_SCORE * 0.5**0.5, rel=1e-4)


def test_hopeless_scores_keep_the_best_anchor_inside():
    output = answer(32, {}, {})
    output = output._replace(class_logits=torch.full_like(output.class_logits, -300.0))
    result = assign(output, label([[[8.0, 8.0, 24.0, 24.0]]]))
    assert result.foreground[0, result.best_anchor[0, 0]]
    assert result.target_score.isfinite().all()


def test_padding_and_pictures_without_boats_are_background():
    boats = label([[[8.0, 8.0, 24.0, 24.0]] * 2] * 2)
    boats = boats._replace(present=torch.tensor([[True, False], [False, False]]))
    result = assign(guess(2), boats)
    assert result.foreground[0].any()
    assert not result.foreground[1].any()
    assert (result.boat_index == 0).all()
    assert (result.target_score[~result.foreground] == 0).all()


def test_no_room_for_boats_at_all():
    boats = label([[], []])
    result = assign(guess(2), boats)
    assert not result.foreground.any()
    assert result.best_anchor.shape == (2, 0)


def test_at_most_topk_anchors_each_and_scores_within_one():
    torch.manual_seed(0)
    boats: Boats = label([[[2.0, 3.0, 50.0, 60.0], [30.0, 30.0, 61.0, 62.0]]] * 3)
    result = assign(guess(3), boats, topk=4)
    for boat in range(2):
        count = (result.foreground & (result.boat_index == boat)).sum(-1)
        assert ((count > 0) & (count <= 4)).all()
    assert ((result.target_score >= 0) & (result.target_score <= 1)).all()
    assert (result.target_score[result.foreground] > 0).all()
