"""The far edge of the water in a picture, and the pitch and roll of the camera that sees it there.

The sea's horizon lies everywhere equally far below the horizontal, by its dip d: its rays r (unit vectors of the camera
frame) are those with g . r = sin d, where g is gravity's direction in the camera frame,

    g = (cos(pitch) sin(roll), cos(pitch) cos(roll), sin(pitch)),

a cone and not a plane, and through a lens a curve and not a line. Two of its points are enough to know g.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from usvnet.geometry.attitude import Attitude
from usvnet.geometry.camera import project
from usvnet.geometry.lens import apply_matrix
from usvnet.geometry.rays import level_rotation, trace_pixels
from usvnet.geometry.water import REFRACTION, horizon_dip_rad
from usvnet.types import Camera

REFRACTION_STD = 0.1
"""How well the coefficient of refraction is taken to be known: near warm or cold water it strays far."""


class WaterEdge(NamedTuple):
    """How far below the horizontal the water ends, seen from B cameras."""

    depression_rad: Tensor
    """(B,)"""
    std_rad: Tensor
    """(B,) one standard deviation of it, the same all along the edge."""


def sea_horizon(camera: Camera, refraction: float = REFRACTION, refraction_std: float = REFRACTION_STD) -> WaterEdge:
    """The open sea's edge: the dip, with the sigma that the camera's height and the air give it."""
    dip = horizon_dip_rad(camera.height_m, refraction)
    by_height = dip / (2 * camera.height_m)  # the dip grows with the square root of h (1 - k)
    by_refraction = dip / (2 * (1 - refraction))
    std = torch.sqrt((by_height * camera.height_std_m) ** 2 + (by_refraction * refraction_std) ** 2)
    return WaterEdge(dip, std)


def flat_edge(camera: Camera, distance_m: float) -> WaterEdge:
    """The edge of flat water that ends ``distance_m`` away from B cameras, as rendered water does; known exactly."""
    return WaterEdge(torch.atan(camera.height_m / distance_m), torch.zeros_like(camera.height_m))


def edge_px(camera: Camera, depression_rad: Tensor, azimuth_rad: Tensor) -> Tensor:
    """Pixels (B, P, 2) where the water's edge lies at azimuths (B, P) clockwise from the optical axis; NaN for none.

    Args:
        camera: B cameras with the attitude to draw the edge for.
        depression_rad: (B,) of the edge.
        azimuth_rad: (B, P) or broadcastable to it.
    """
    depression = depression_rad.unsqueeze(-1)
    across = torch.cos(depression)
    x, y, z = torch.broadcast_tensors(
        across * torch.sin(azimuth_rad), torch.sin(depression), across * torch.cos(azimuth_rad)
    )
    to_camera = level_rotation(camera.pitch_rad, camera.roll_rad).mT.unsqueeze(-3)
    return project(apply_matrix(to_camera, torch.stack([x, y, z], -1)), camera)


def attitude_from_edge(points_px: Tensor, row_covariance_px2: Tensor, camera: Camera, edge: WaterEdge) -> Attitude:
    """Pitch and roll of B cameras from two points of the water's edge.

    The standard deviations are first order in the points' rows, the edge's depression and the focal length (fx and fy
    wrong by the same fraction): from g . r = sin d follows dg . r = cos(d) dd - g . dr for both points, and dg . g = 0.

    Args:
        points_px: (B, 2, 2) a left and a right pixel (u, v), with the lens's distortion left in.
        row_covariance_px2: (B, 2, 2) covariance of their rows v.
        camera: their lens; height, pitch and roll are not looked at.
        edge: its depression and how well it is known.

    Returns:
        The attitude, upright (cos(pitch) cos(roll) > 0); with infinite sigmas where a point has no ray, or where the
        two do not lie apart.
    """
    level = torch.zeros_like(camera.pitch_rad)
    rays = trace_pixels(points_px, camera._replace(pitch_rad=level, roll_rad=level))
    left, right = rays.direction[:, 0], rays.direction[:, 1]
    normal = torch.linalg.cross(right, left)
    apart = (normal * normal).sum(-1)
    sine, cosine = torch.sin(edge.depression_rad), (left * right).sum(-1)
    rest = 1 - 2 * sine * sine / (1 + cosine)
    valid = rays.valid.all(-1) & (apart > 1e-8) & (rest > 1e-8)

    # in the basis of both rays and their normal; g is a unit vector that points down
    along_rays = (sine / (1 + cosine)).unsqueeze(-1) * (left + right)
    length = torch.sqrt(torch.where(valid, rest, 1.0) / torch.where(valid, apart, 1.0))
    gravity = along_rays + (length * torch.sign(normal[:, 1])).unsqueeze(-1) * normal
    gravity = torch.where(valid.unsqueeze(-1), gravity, torch.tensor([0.0, 1.0, 0.0]).to(gravity))
    pitch = torch.asin(gravity[:, 2].clamp(-1, 1))
    roll = torch.atan2(gravity[:, 0], gravity[:, 1])

    by_left, by_right = _angles_by_sines(left, right, gravity, valid)  # (B, 2) of pitch and roll
    fy = camera.K[:, 1, 1].unsqueeze(-1)
    by_row = -(gravity.unsqueeze(1) * rays.direction_by_xy[..., 1]).sum(-1) / fy  # (B, 2) sines by their rows
    by_focal = (gravity.unsqueeze(1) * apply_matrix(rays.direction_by_xy, rays.distorted_xy)).sum(-1) / fy
    rows = torch.stack([by_left * by_row[:, :1], by_right * by_row[:, 1:]], -1)  # (B, 2 angles, 2 rows)
    focal = by_left * by_focal[:, :1] + by_right * by_focal[:, 1:]
    whole = (by_left + by_right) * (torch.cos(edge.depression_rad) * edge.std_rad).unsqueeze(-1)
    variance = (rows * apply_matrix(row_covariance_px2.unsqueeze(1), rows)).sum(-1)
    variance = variance + (focal * camera.focal_std_px.unsqueeze(-1)) ** 2 + whole * whole
    std = torch.sqrt(variance.clamp_min(1e-18))
    std = torch.where(valid.unsqueeze(-1), std, torch.full_like(std, float("inf")))
    return Attitude(pitch, roll, std[:, 0], std[:, 1])


def _angles_by_sines(left: Tensor, right: Tensor, gravity: Tensor, valid: Tensor) -> tuple[Tensor, Tensor]:
    """Derivatives (B, 2) of pitch and roll to the sines g . r of the left ray and of the right ray.

    With M = [left; right; g], dg = M^-1 (ds_left, ds_right, 0); the columns of M^-1 are cross products over det M.
    """
    across = torch.linalg.cross(right, gravity)
    determinant = (left * across).sum(-1)
    scale = torch.where(valid, determinant, torch.ones_like(determinant)).unsqueeze(-1)
    upright2 = (gravity[:, 0] ** 2 + gravity[:, 1] ** 2).clamp_min(1e-12)

    def angles(change: Tensor) -> Tensor:
        by_pitch = change[:, 2] / torch.sqrt(upright2)
        by_roll = (gravity[:, 1] * change[:, 0] - gravity[:, 0] * change[:, 1]) / upright2
        return torch.stack([by_pitch, by_roll], -1)

    return angles(across / scale), angles(torch.linalg.cross(gravity, left) / scale)
