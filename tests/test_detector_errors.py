"""Labels made worse stray as far as they say, and no further."""

import math

import torch

from usvnet.detector_errors import confuse_ends, exchange_ends, jitter_boxes, jitter_keypoints


def test_jittered_boxes_stray_as_far_as_they_may():
    torch.manual_seed(0)
    boxes_px = torch.tensor([100.0, 60, 180, 90]).expand(1000, 4)
    strayed = jitter_boxes(boxes_px, shift=0.15, log_scale=0.25)
    shift = (strayed.view(-1, 2, 2).mean(1) - boxes_px.view(-1, 2, 2).mean(1)).abs() / 80
    assert shift.max() < 0.15
    assert shift.amax(0).min() > 0.13
    scale = ((strayed[:, 2:] - strayed[:, :2]) / (boxes_px[:, 2:] - boxes_px[:, :2])).log()
    torch.testing.assert_close(scale[:, 0], scale[:, 1])
    assert 0.23 < scale.abs().max() < 0.25


def test_jittered_keypoints_stray_by_a_share_of_the_boat_that_differs_from_boat_to_boat():
    torch.manual_seed(0)
    boxes_px = torch.tensor([[0.0, 0, 100, 40], [0.0, 0, 10, 4]]).expand(4000, 2, 4)
    labels_px = torch.rand(4000, 2, 7, 2)
    error = (jitter_keypoints(labels_px, boxes_px, 0.01, 0.04) - labels_px) / torch.tensor([100.0, 10.0])[:, None, None]
    squared = error.square().mean((2, 3))
    expected = (0.04**2 - 0.01**2) / math.log(0.04 / 0.01)  # of 2 s^2, s being even on a logarithmic scale
    torch.testing.assert_close(squared.mean(0), torch.full((2,), expected), rtol=0.08, atol=0)
    together = error.mean(2)  # half of the variance, and a seventh of the other half
    torch.testing.assert_close(together.square().mean((0, 2)), torch.full((2,), expected * 4 / 7), rtol=0.08, atol=0)
    assert squared.quantile(0.9) > 6 * squared.quantile(0.1)


def test_ends_exchanged_twice_are_where_they_were_but_for_the_bow():
    keypoints_px = torch.rand(3, 7, 2)
    exchanged = exchange_ends(keypoints_px)
    assert torch.equal(exchange_ends(exchanged)[:, 1:], keypoints_px[:, 1:])
    assert torch.equal(exchanged[:, 3], keypoints_px[:, 6])
    assert torch.equal(exchanged[:, 0], keypoints_px[:, 4:6].mean(1))


def test_a_share_of_the_boats_has_its_ends_confused_half_of_them_end_for_end():
    torch.manual_seed(0)
    keypoints_px = torch.rand(4000, 1, 7, 2)
    visibility = torch.full((4000, 1, 7), 1)
    visibility[:1000, 0, 2] = 0
    confused = confuse_ends(keypoints_px, visibility, share=0.3)
    changed = (confused != keypoints_px).flatten(1).any(1)
    swapped = torch.isclose(confused, exchange_ends(keypoints_px)).flatten(1).all(1)
    assert not changed[:1000].any()  # a boat that is not wholly labelled
    assert abs(changed[1000:].float().mean() - 0.3) < 0.03
    assert abs(swapped[1000:].float().mean() - 0.15) < 0.02
    part = (confused - keypoints_px)[..., 3, :] / (exchange_ends(keypoints_px) - keypoints_px)[..., 3, :]
    torch.testing.assert_close(part[..., 0], part[..., 1], rtol=1e-2, atol=1e-4)  # of the way, straight there
    assert ((part >= -1e-4) & (part <= 1 + 1e-4)).all()
