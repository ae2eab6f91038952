"""The rays of pixels in the level frame."""

from typing import NamedTuple

import torch
from torch import Tensor

from usvnet.geometry.lens import Undistorted, apply_matrix, undistort
from usvnet.types import Camera


def level_rotation(pitch_rad: Tensor, roll_rad: Tensor) -> Tensor:
    """Rotation (B, 3, 3) from camera to level frame, Rx(pitch) Rz(roll), of angles (B,)."""
    cp, sp = torch.cos(pitch_rad), torch.sin(pitch_rad)
    cr, sr = torch.cos(roll_rad), torch.sin(roll_rad)
    zero = torch.zeros_like(cp)
    return torch.stack(
        [
            torch.stack([cr, -sr, zero], -1),
            torch.stack([cp * sr, cp * cr, sp], -1),
            torch.stack([-sp * sr, -sp * cr, cp], -1),
        ],
        -2,
    )


class LevelRays(NamedTuple):
    """The rays of pixels in the level frame."""

    direction: Tensor
    """(B, P, 3) unit vectors; the optical axis where not valid."""
    direction_by_xy: Tensor
    """(B, P, 3, 2) derivative of the direction to the pixel's place on the plane z = 1, before undistortion."""
    distorted_xy: Tensor
    """(B, P, 2) that place."""
    valid: Tensor
    """(B, P) bool, False where the pixel has no ray."""


def trace_pixels(points_px: Tensor, camera: Camera) -> LevelRays:
    """Rays of pixels (B, P, 2) in the level frame, with their derivative."""
    return trace_undistorted(undistort(points_px, camera), camera)


def trace_undistorted(lens: Undistorted, camera: Camera) -> LevelRays:
    """Rays of pixels whose lens is undone."""
    ray = torch.cat([lens.xy, torch.ones_like(lens.xy[..., :1])], -1)
    length = torch.sqrt((ray * ray).sum(-1, keepdim=True))
    R = level_rotation(camera.pitch_rad, camera.roll_rad).unsqueeze(-3)
    direction = apply_matrix(R, ray / length)
    tangent = R[..., :2] - direction.unsqueeze(-1) * (ray / length)[..., None, :2]  # d direction / d xy, times length
    by_xy = (tangent.unsqueeze(-1) * lens.inverse_jacobian.unsqueeze(-3)).sum(-2) / length.unsqueeze(-1)
    return LevelRays(direction, by_xy, lens.distorted_xy, lens.valid)


def level_rays(points_px: Tensor, camera: Camera) -> Tensor:
    """Unit rays (B, P, 3) of pixels (B, P, 2) in the level frame; the optical axis for a pixel that has no ray."""
    return trace_pixels(points_px, camera).direction
