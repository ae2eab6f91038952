"""Boats put on the water, and what a camera sees of them."""

import math

import torch

from usvnet.geometry.camera import project
from usvnet.geometry.hull_model import generic_hull, hull_to
from usvnet.geometry.rays import level_rotation
from usvnet.types import Camera, Hull

LEANS = torch.tensor([1.0, 1, 1, 0, 1, 1, 0], dtype=torch.float64)


def known_hull(boats: int, scale_std: float = 0.0, point_std_m: float = 0.0, size: float = 1.0) -> Hull:
    """The generic shape as a boat that is known as well as said."""
    points = size * hull_to(generic_hull(boats), dtype=torch.float64).points_m
    one = torch.ones(boats, dtype=torch.float64)
    return Hull(points, scale_std * one, point_std_m * one)


def repeat_camera(camera: Camera, boats: int) -> Camera:
    return Camera(*(field.expand(boats, *field.shape[1:]).contiguous() for field in camera))


def uniform(boats: int, low: float, high: float) -> torch.Tensor:
    return low + (high - low) * torch.rand(boats, dtype=torch.float64)


def draw_poses(boats: int, near_m: float, far_m: float) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Right of the camera, ahead of it, and heading, (boats,) each."""
    ahead = torch.exp(uniform(boats, math.log(near_m), math.log(far_m)))
    return ahead * uniform(boats, -0.3, 0.3), ahead, uniform(boats, -math.pi, math.pi)


def put(
    points_m: torch.Tensor,
    pose: tuple[torch.Tensor, torch.Tensor, torch.Tensor],
    height_m: torch.Tensor,
    roll_rad: torch.Tensor | float = 0.0,
    pitch_rad: torch.Tensor | float = 0.0,
) -> torch.Tensor:
    """Points (F, 7, 3) of hulls in the level frame; the two on the water do not roll and pitch."""
    right, ahead, heading = (value[:, None] for value in pose)
    roll, pitch = (torch.as_tensor(angle, dtype=torch.float64).view(-1, 1) * LEANS for angle in (roll_rad, pitch_rad))
    x, y, z = points_m.unbind(-1)
    x, y, z = x - pitch * z, y - roll * z, z + pitch * x + roll * y
    s, c = heading.sin(), heading.cos()
    return torch.stack([right + x * s - y * c, height_m[:, None] - z, ahead + x * c + y * s], -1)


def see(level_m: torch.Tensor, camera: Camera) -> torch.Tensor:
    """Pixels (F, 7, 2) of points in the level frame."""
    return project(level_m @ level_rotation(camera.pitch_rad, camera.roll_rad), camera)


def nearest_m(level_m: torch.Tensor) -> torch.Tensor:
    """Slant range (F,) of the nearer waterline point."""
    return level_m[:, [3, 6]].norm(dim=-1).amin(-1)
