"""Views drawn at random: within their bounds, around a boat, and true to the camera."""

import dataclasses

import numpy as np
import pytest
import torch

from usvnet.data.augmentation import AugmentationConfig, Source, plain_view
from usvnet.data.augmentation.geometric import random_affine, random_view
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import WATERLINE_KEYPOINTS


def test_a_drawn_affine_stays_within_its_bounds():
    rng = np.random.default_rng(0)
    config = AugmentationConfig(zoom=(0.5, 2.0), translate=0.1)
    drawn = [random_affine(config, (100, 100), (100, 100), rng) for _ in range(300)]
    zooms = np.array([A[0, 0] for A in drawn])
    assert 0.5 <= zooms.min() < 0.6
    assert 1.8 < zooms.max() <= 2.0
    left = np.array([A[0, 0] * -0.5 + A[0, 2] + 0.5 for A in drawn])  # the picture's left edge in the frame
    assert left[zooms > 1].max() <= 10
    assert left[zooms < 1].min() >= -10
    still = random_affine(AugmentationConfig(zoom=(1.0, 1.0), translate=0.0), (100, 80), (100, 80), rng)
    np.testing.assert_allclose(still, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("part_px", [(100, 100), (40, 60)])
def test_a_focus_goes_to_the_middle_part_of_the_frame_where_the_picture_allows(part_px: tuple[int, int]):
    rng = np.random.default_rng(0)
    config = AugmentationConfig(zoom=(1.5, 2.5), translate=0.1)
    for focus in np.array([[50.0, 50.0], [30.0, 70.0]]):
        drawn = [random_affine(config, (100, 100), part_px, rng, focus) for _ in range(200)]
        places = np.array([(A @ (*focus, 1))[:2] for A in drawn])
        assert (places > 0).all()
        assert (places < part_px).all()
        assert places.std(0).min() > 5


def test_every_view_keeps_the_range_of_every_point_of_the_water(make_frame):
    """Turn, zoom, shift and mirror at once: the keypoints that stay in the frame range as they did before."""
    frame = make_frame(2, boats=2)
    frame.visibility[:] = 2

    def ranges(of) -> torch.Tensor:
        points = torch.from_numpy(of.keypoints_px[:, list(WATERLINE_KEYPOINTS)]).float().reshape(1, -1, 2)
        covariance = torch.eye(2).expand(1, points.shape[1], 2, 2)
        return RangingLayer().range_points(points, covariance, of.camera).slant_m.reshape(-1, 2)

    source = Source(np.zeros((120, 160, 3), np.uint8), frame)
    config = AugmentationConfig(zoom=(0.5, 1.0), roll_deg=10)
    rng, before = np.random.default_rng(0), ranges(frame)
    rolls = []
    for _ in range(20):
        view = random_view(source, (96, 96), config, rng)
        assert view.picture.shape == (96, 96, 3)
        assert len(view.frame.boxes_px) == 2
        torch.testing.assert_close(ranges(view.frame), before, rtol=2e-4, atol=2e-4)
        np.testing.assert_array_equal(view.frame.range_m[view.frame.range_m > 0], [7.0])
        rolls.append(abs(view.frame.camera.roll_rad.item()))
    assert np.std(rolls) > 0.02


def test_a_config_that_turns_everything_off_is_the_plain_view(make_frame):
    rng = np.random.default_rng(0)
    source = Source(rng.integers(0, 256, (120, 160, 3), np.uint8), make_frame(3))
    off = AugmentationConfig(mirror=0, zoom=(1, 1), translate=0, roll_deg=0)
    still, plain = random_view(source, (96, 96), off, rng), plain_view(source, (96, 96))
    np.testing.assert_array_equal(still.picture, plain.picture)
    np.testing.assert_allclose(still.frame.boxes_px, plain.frame.boxes_px)
    for ours, theirs in zip(still.frame.camera, plain.frame.camera):
        torch.testing.assert_close(ours, theirs)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mirror", 1.5),
        ("fog", -0.1),
        ("zoom", (1.2, 0.8)),
        ("zoom", (0.0, 1.0)),
        ("roll_deg", 50),
        ("roll_deg", -1),
        ("mosaic", 2),
        ("closing", 1.1),
    ],
)
def test_a_config_out_of_bounds_is_refused(name: str, value: object):
    with pytest.raises(ValueError, match=f"augmentation.{name} is"):
        dataclasses.replace(AugmentationConfig(), **{name: value})
