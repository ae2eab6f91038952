"""A camera turned about its axis sees the same world, through any plumb-bob lens."""

import math

import pytest
import torch
from torch.autograd import gradcheck

from usvnet.data.transforms import turn_matrix
from usvnet.geometry.camera import camera_to, flip_camera, make_camera, project, turn_camera
from usvnet.geometry.ranging import RangingLayer
from usvnet.geometry.rays import level_rotation

ANGLES = [-0.3, 0.02, math.pi / 2]


def tilted() -> torch.Tensor:
    """Unequal focal lengths, tangential distortion, pitch and roll; float64."""
    camera = make_camera(
        [[700, 0, 310], [0, 640, 260], [0, 0, 1]],
        (640, 480),
        [-0.2, 0.05, 0.003, -0.004, 0.01],
        height_m=1.5,
        pitch_rad=0.1,
        roll_rad=0.05,
        focal_std_px=2.0,
        height_std_m=0.02,
        pitch_std_rad=0.01,
        roll_std_rad=0.02,
    )
    return camera_to(camera, dtype=torch.float64)


def level_points() -> torch.Tensor:
    """Points (1, 100, 3) on the water, in the level frame."""
    torch.manual_seed(0)
    x, z = torch.rand(100, dtype=torch.float64) * 2 - 1, torch.rand(100, dtype=torch.float64) * 20 + 4
    return torch.stack([x * z * 0.3, torch.full_like(x, 1.5), z], -1)[None]


def see(camera, points: torch.Tensor) -> torch.Tensor:
    return project(points @ level_rotation(camera.pitch_rad, camera.roll_rad)[0], camera)


def turned_pixels(camera, angle: float) -> torch.Tensor:
    """Map (1, 3, 3) from the pixels of a camera's picture to those of the turned camera's."""
    return torch.from_numpy(turn_matrix(camera.K[0].numpy(), angle))[None]


def moved(pixels: torch.Tensor, A: torch.Tensor) -> torch.Tensor:
    return pixels @ A[..., :2, :2].mT + A[..., None, :2, 2]


@pytest.mark.parametrize("angle", ANGLES)
def test_project_then_turn_is_turn_then_project(angle):
    camera, points = tilted(), level_points()
    A = turned_pixels(camera, angle)
    torch.testing.assert_close(
        see(turn_camera(camera, angle), points), moved(see(camera, points), A), atol=1e-8, rtol=0
    )


@pytest.mark.parametrize("angle", ANGLES)
def test_a_turned_picture_keeps_its_ranges_and_their_stds(angle):
    camera, points = tilted(), level_points()
    turned, A = turn_camera(camera, angle), turned_pixels(camera, angle)
    covariance = torch.eye(2, dtype=torch.float64).expand(1, 100, 2, 2)
    S = A[:, None, :2, :2]
    before = RangingLayer().range_points(see(camera, points), covariance, camera)
    after = RangingLayer().range_points(moved(see(camera, points), A), S @ covariance @ S.mT, turned)
    torch.testing.assert_close(before.slant_m, points.norm(dim=-1), atol=1e-6, rtol=0)
    torch.testing.assert_close(after.slant_m, before.slant_m, atol=1e-6, rtol=0)
    torch.testing.assert_close(after.slant_std_m, before.slant_std_m, atol=1e-6, rtol=1e-5)


def test_a_positive_turn_is_clockwise_seen_from_behind_and_turns_the_picture_the_other_way():
    camera = make_camera([[100, 0, 50], [0, 100, 50], [0, 0, 1]], (101, 101), height_m=1.0, dtype=torch.float64)
    assert turn_camera(camera, 0.2).roll_rad.tolist() == pytest.approx([0.2])
    right = moved(camera.K.new_tensor([[[90, 50]]]), turned_pixels(camera, 0.2))[0, 0]
    assert right.tolist() == pytest.approx([50 + 40 * math.cos(0.2), 50 - 40 * math.sin(0.2)])


def test_a_turn_back_undoes_it_and_a_mirror_turns_the_other_way():
    camera = tilted()
    for ours, theirs in zip(turn_camera(turn_camera(camera, 0.3), -0.3), camera):
        torch.testing.assert_close(ours, theirs)
    for ours, theirs in zip(flip_camera(turn_camera(camera, 0.3)), turn_camera(flip_camera(camera), -0.3)):
        torch.testing.assert_close(ours, theirs)


def test_gradcheck_turn():
    camera, angle = tilted(), torch.tensor([0.2], dtype=torch.float64, requires_grad=True)
    assert gradcheck(lambda a: turn_camera(camera, a).distortion, (angle,))
