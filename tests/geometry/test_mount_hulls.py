"""The mount that boats of known shape tell, against the one that drew them."""

import math

import pytest
import torch

from usvnet.geometry.camera import make_camera
from usvnet.geometry.mount_hulls import UNKNOWN_STD_RAD, HullMount, fit_mount_to_hulls
from usvnet.types import Camera, Hull

from .boats import draw_poses, known_hull, put, repeat_camera, see

NOISE_PX = 1.5
PITCH_DEG, ROLL_DEG = 0.4, -0.5
"""How far off the first guess is."""


def mounted(pitch_deg: float = 0.0, roll_deg: float = 0.0, std_deg: float = 0.5) -> Camera:
    std_rad = math.radians(std_deg)
    return make_camera(
        [[700.0, 0, 319.5], [0, 695.0, 239.5], [0, 0, 1]],
        (640, 480),
        (-0.1, 0.02, 0.001, -0.001, 0.0),
        height_m=1.5,
        pitch_rad=0.1 + math.radians(pitch_deg),
        roll_rad=0.03 + math.radians(roll_deg),
        height_std_m=0.01,
        pitch_std_rad=std_rad,
        roll_std_rad=std_rad,
        focal_std_px=1.0,
        wave_std_m=0.02,
        dtype=torch.float64,
    )


def drawn(count: int, seed: int = 0, size: float = 1.0, near_m: float = 4.0) -> torch.Tensor:
    """Keypoints (C, 7, 2) of boats on waves, drawn larger than they are, with noise."""
    torch.manual_seed(seed)
    camera, hull = repeat_camera(mounted(), count), known_hull(count)
    heights_m = camera.height_m + 0.02 * torch.randn(count, dtype=torch.float64)
    pixels = see(put(hull.points_m, draw_poses(count, near_m, 15.0), heights_m), camera)
    middle = pixels.mean(1, keepdim=True)
    return middle + size * (pixels - middle) + NOISE_PX * torch.randn_like(pixels)


def fit(keypoints_px: torch.Tensor, camera: Camera | None = None, hull: Hull | None = None) -> HullMount:
    covariance = NOISE_PX**2 * torch.eye(2, dtype=torch.float64).expand(*keypoints_px.shape, 2)
    return fit_mount_to_hulls(keypoints_px, covariance, camera or mounted(PITCH_DEG, ROLL_DEG), hull or known_hull(1))


def errors_deg(found: HullMount) -> tuple[float, float]:
    true, camera = mounted(), found.camera
    return (
        math.degrees(camera.pitch_rad.item() - true.pitch_rad.item()),
        math.degrees(camera.roll_rad.item() - true.roll_rad.item()),
    )


@pytest.mark.parametrize("size", [0.97, 1.0, 1.03])
def test_pitch_and_roll_are_found_however_large_boats_are_drawn(size):
    found = fit(drawn(300, size=size))
    pitch_deg, roll_deg = errors_deg(found)
    assert abs(pitch_deg) < 0.12
    assert abs(roll_deg) < 0.2
    assert found.size == pytest.approx(size, abs=0.012)
    assert int(found.fits.sum()) > 280
    true = mounted()
    for field in ("K", "distortion", "size_px", "height_m", "height_std_m", "focal_std_px", "wave_std_m"):
        torch.testing.assert_close(getattr(found.camera, field), getattr(true, field), rtol=0, atol=0)


def test_errors_are_what_the_sigmas_say():
    scores = []
    for seed in range(25):
        found = fit(drawn(50, seed, size=0.98))
        stds = (found.camera.pitch_std_rad.item(), found.camera.roll_std_rad.item())
        scores.append([error / math.degrees(std) for error, std in zip(errors_deg(found), stds)])
        assert math.degrees(stds[0]) < 0.25  # of 0.5 before
    spread = torch.tensor(scores).square().mean(0).sqrt()
    assert ((spread > 0.5) & (spread < 1.5)).all()


def test_boats_that_err_together_are_no_surer_than_one_of_them():
    """A video shows the same boat, and the same error, many times over."""
    once = drawn(20)
    often = once.repeat_interleave(20, 0)
    assert fit(often).camera.pitch_std_rad > 0.6 * fit(once).camera.pitch_std_rad
    assert fit(drawn(400)).camera.pitch_std_rad < 0.5 * fit(once).camera.pitch_std_rad


def test_a_mount_that_is_not_known_is_found_from_far_off():
    found = fit(drawn(300), mounted(2.5, -2.0, std_deg=0.0))
    assert max(abs(error) for error in errors_deg(found)) < 0.2
    assert found.camera.pitch_std_rad.item() < 0.1 * UNKNOWN_STD_RAD


def test_boats_of_one_distance_leave_the_pitch_open():
    near_and_far, far = fit(drawn(100)), fit(drawn(100, near_m=14.0))
    assert far.camera.pitch_std_rad > 1.5 * near_and_far.camera.pitch_std_rad


def test_boats_of_another_shape_are_left_out_and_too_few_refused():
    keypoints_px = drawn(40)
    keypoints_px[:10] = keypoints_px[:10, [6, 5, 4, 3, 2, 1, 0]]
    found = fit(keypoints_px)
    assert not found.fits[:10].any()
    assert found.fits[10:].sum() > 25
    with pytest.raises(ValueError, match=r"[0-2] of 12 boats fit the hull, expected at least 5"):
        fit(keypoints_px[:12])
    with pytest.raises(ValueError, match="0 of 0 boats"):
        fit(keypoints_px[:0])
