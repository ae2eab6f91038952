"""CameraInfo to camera, without ROS."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from ros_messages import camera_info

from usvnet.geometry.camera import project
from usvnet_ros.cameras import Mount, camera_from_info

MOUNT = Mount(height_m=1.5, pitch_deg=6.0, roll_deg=-2.0, pitch_std_deg=0.3, focal_std_px=2.0)
POINTS_M = np.random.default_rng(0).uniform((-2, -1.5, 8), (2, 1.5, 12), (50, 3))


def seen_px(camera):
    return project(torch.from_numpy(POINTS_M).float()[None], camera)[0].numpy()


def by_opencv(info, coefficients):
    return cv2.projectPoints(POINTS_M, np.zeros(3), np.zeros(3), np.reshape(info.k, (3, 3)), np.array(coefficients))[0][
        :, 0
    ]


def test_a_plumb_bob_and_its_mount():
    info = camera_info()
    camera = camera_from_info(info, MOUNT)
    np.testing.assert_allclose(seen_px(camera), by_opencv(info, info.d), atol=1e-3)
    assert camera.size_px.tolist() == [[640, 480]]
    assert camera.height_m.item() == 1.5
    assert np.degrees(camera.pitch_rad.item()) == pytest.approx(6)
    assert np.degrees(camera.roll_rad.item()) == pytest.approx(-2)
    assert np.degrees(camera.pitch_std_rad.item()) == pytest.approx(0.3)
    assert camera.focal_std_px.item() == 2


def test_a_rational_polynomial_shows_the_same_picture():
    d = [0.35, -0.02, 7e-4, -4e-4, 0.003, 0.62, 0.05, 0.004]
    info = camera_info(distortion_model="rational_polynomial", d=d)
    np.testing.assert_allclose(seen_px(camera_from_info(info, MOUNT)), by_opencv(info, d), atol=0.25)


def test_rectified_images_have_the_pinhole_p():
    info = camera_info(distortion_model="equidistant", d=[0.1, 0.01, 0, 0])
    camera = camera_from_info(info, MOUNT, rectified=True)
    expected = 580 * POINTS_M[:, :2] / POINTS_M[:, 2:] + (320, 240)
    np.testing.assert_allclose(seen_px(camera), expected, atol=1e-3)


def test_no_coefficients_are_a_perfect_lens():
    camera = camera_from_info(camera_info(distortion_model="", d=[]), MOUNT)
    assert not camera.distortion.any()


def test_the_region_of_interest_and_binning_move_the_camera_as_the_driver_moves_the_picture():
    """u' = (u - x_offset + 0.5) / binning - 0.5: a pixel of a binned picture covers several."""
    roi = SimpleNamespace(x_offset=40, y_offset=20, width=500, height=400)
    camera = camera_from_info(camera_info(roi=roi, binning_x=2, binning_y=2), MOUNT)
    assert camera.size_px.tolist() == [[250, 200]]
    whole = seen_px(camera_from_info(camera_info(), MOUNT))
    np.testing.assert_allclose(seen_px(camera), (whole - (40, 20) + 0.5) / 2 - 0.5, atol=1e-3)


@pytest.mark.parametrize(
    ("fields", "mount", "sentence"),
    [
        (
            {"distortion_model": "equidistant"},
            MOUNT,
            "distortion_model is 'equidistant', expected plumb_bob or",
        ),
        ({"distortion_model": "fisheye"}, MOUNT, r"'fisheye', .* take the rectified images \(rectified: true\)"),
        ({"k": [0.0] * 9}, MOUNT, "CameraInfo: k is zero, expected a calibrated camera"),
        ({"d": [0.1] * 7}, MOUNT, "CameraInfo: d: expected 4 or 5 numbers"),
        ({}, Mount(), "height_m: expected metres above the water, got 0"),
    ],
)
def test_what_is_no_camera_is_refused_in_one_sentence(fields, mount, sentence):
    with pytest.raises(ValueError, match=sentence):
        camera_from_info(camera_info(**fields), mount)
