"""Light and air change the colours alone, and fog knows how far away the water is."""

import dataclasses

import cv2
import numpy as np
import pytest
import torch

from usvnet.data.augmentation import AugmentationConfig
from usvnet.data.augmentation.photometric import add_fog, add_glare, add_noise, change_light, darken, fog_thickness
from usvnet.data.augmentation.water import depression_sine, horizon_row
from usvnet.geometry.camera import make_camera
from usvnet.geometry.ranging import RangingLayer

OFF = AugmentationConfig(**dict.fromkeys(("hue", "saturation", "value", "glare", "fog", "dim", "blur", "noise"), 0))
CAMERA = make_camera(
    [[150, 0, 79.5], [0, 150, 59.5], [0, 0, 1]], (160, 120), height_m=1.5, pitch_rad=0.1, roll_rad=0.07
)


@pytest.mark.parametrize("one_camera", [True, False])
def test_colours_change_without_moving_anything(make_frame, one_camera: bool):
    rng = np.random.default_rng(0)
    frame = make_frame(1)
    picture = cv2.GaussianBlur(rng.integers(0, 256, (120, 160, 3), np.uint8), (0, 0), 1)
    before = picture.copy()
    same = change_light(picture, frame, OFF, rng, one_camera)
    np.testing.assert_allclose(same, picture, atol=4)  # HSV and back rounds
    for name in ("hue", "saturation", "value", "glare", "fog", "dim", "blur", "noise"):
        changed = change_light(picture, frame, dataclasses.replace(OFF, **{name: 1.0}), rng, one_camera)
        assert changed.dtype == np.uint8
        assert changed.shape == picture.shape
        assert np.abs(changed.astype(int) - same).mean() > 0.5, name
    np.testing.assert_array_equal(picture, before)


def test_the_sine_is_that_of_the_geometry_layer():
    points = torch.tensor([[[10.0, 70.0], [80.0, 80.0], [150.0, 119.0]]])
    slant_m = RangingLayer().range_points(points, torch.zeros(1, 3, 2, 2), CAMERA).slant_m[0]
    sine = depression_sine(CAMERA, points[0, :, 0].numpy(), points[0, :, 1].numpy())
    np.testing.assert_allclose(1.5 / sine, slant_m.numpy(), rtol=1e-5)
    for u in (0.0, 100.0):
        assert depression_sine(CAMERA, np.array(u), np.array(horizon_row(CAMERA, u))) == pytest.approx(0, abs=1e-6)


def test_fog_is_thin_near_the_camera_and_does_not_draw_the_boat():
    box = np.array([[60.0, 40.0, 100.0, 75.0]])
    thickness = fog_thickness(CAMERA, box, (120, 160, 3))
    assert thickness.shape == (120, 160)
    assert thickness.max() == 1
    np.testing.assert_allclose(thickness[:70, 80], 1)  # from the boat's foot up to its top and beyond
    d = 1.5 / depression_sine(CAMERA, np.array([80.0, 80.0]), np.array([75.0, 110.0]))
    assert thickness[110, 80] == pytest.approx(d[1] / d[0], rel=0.05)
    assert (np.diff(thickness[:, 80]) <= 1e-6).all()


def test_fog_lets_through_what_koschmieder_says():
    rng = np.random.default_rng(0)
    black, white = np.zeros((2, 40, 40, 3), np.uint8)
    white[:] = 255
    thickness = np.repeat(np.array([0.5, 1.0]), 20)[:, None].repeat(40, 1)
    grey, light = (add_fog(p, thickness, np.random.default_rng(3)).astype(float) for p in (black, white))
    through = ((light - grey) / 255).mean((1, 2))
    assert through[0] == pytest.approx(through[-1] ** 0.5, abs=0.01)
    assert 0.45 < through[-1] < 0.95
    assert add_fog(black, np.ones(()), rng).std() == 0


def test_glare_is_light_on_the_water_only():
    picture = np.full((120, 160, 3), 60, np.uint8)
    for seed in range(5):
        added = add_glare(picture, CAMERA, np.random.default_rng(seed)).astype(int) - 60
        assert (added >= 0).all()
        assert added.max() > 60
        brightest = added.sum((0, 2)).argmax()
        assert not added[: int(horizon_row(CAMERA, brightest)) - 2, brightest].any()


def test_a_fraction_of_the_light_is_darker_by_the_displays_gamma():
    picture = np.array([[[0, 100, 255]]], np.uint8)
    np.testing.assert_allclose(darken(picture, 0.25)[0, 0], picture[0, 0] * 0.25 ** (1 / 2.2), atol=1)


def test_noise_has_no_mean_and_repeats_with_its_generator():
    picture = np.full((80, 80, 3), 128, np.uint8)
    one, two, other = (add_noise(picture, np.random.default_rng(seed)) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, two)
    assert (one != other).any()
    error = one.astype(float) - 128
    assert abs(error.mean()) < 0.3
    assert 0.8 < error.std() < 8.5
    assert abs(np.corrcoef(error[..., 0].ravel(), error[..., 1].ravel())[0, 1]) < 0.1
