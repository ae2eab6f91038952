"""The lens: plumb-bob distortion, its derivative and its inverse, on the plane z = 1 of the camera frame.

Kornia distorts and undistorts; what it leaves out is here: whether the inverse exists, and its derivative.
"""

from typing import NamedTuple

import torch
from kornia.geometry.calibration import distort_points, undistort_points
from torch import Tensor

from usvnet.types import Camera


class Undistorted(NamedTuple):
    """Where pixels lie on the plane z = 1 once the lens is taken away."""

    xy: Tensor
    """(B, P, 2) undistorted; 0 where not valid."""
    distorted_xy: Tensor
    """(B, P, 2) the same points with the lens's distortion left in; 0 where not valid."""
    inverse_jacobian: Tensor
    """(B, P, 2, 2) d xy / d distorted_xy."""
    valid: Tensor
    """(B, P) bool, False where the pixel is not finite or the distortion has no inverse."""


def focal_px(camera: Camera) -> Tensor:
    """Focal lengths fx, fy (B, 1, 2)."""
    return torch.stack([camera.K[..., 0, 0], camera.K[..., 1, 1]], -1).unsqueeze(-2)


def centre_px(camera: Camera) -> Tensor:
    """Principal points cx, cy (B, 1, 2)."""
    return camera.K[..., :2, 2].unsqueeze(-2)


def distort(xy: Tensor, distortion: Tensor) -> Tensor:
    """Put the lens ``distortion`` (B, 5) on points (B, P, 2) of the plane z = 1."""
    return distort_points(xy, torch.eye(3, dtype=xy.dtype, device=xy.device), distortion)


def distortion_jacobian(xy: Tensor, distortion: Tensor) -> Tensor:
    """Derivative (B, P, 2, 2) of the distorted point to the undistorted point ``xy`` (B, P, 2) on the plane z = 1.

    From x_d = x g + 2 p1 x y + p2 (r^2 + 2 x^2), y_d = y g + p1 (r^2 + 2 y^2) + 2 p2 x y with
    g = 1 + k1 r^2 + k2 r^4 + k3 r^6 (Brown's plumb bob, as in OpenCV); ``distortion`` is (B, 5).
    """
    k1, k2, p1, p2, k3 = torch.unbind(distortion.unsqueeze(-2), -1)
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))
    xx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
    cross = slope * x * y + 2 * p1 * x + 2 * p2 * y
    yy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
    return torch.stack([torch.stack([xx, cross], -1), torch.stack([cross, yy], -1)], -2)


def undistort(
    points_px: Tensor,
    camera: Camera,
    iterations: int = 8,
    newton_steps: int = 3,
    tolerance: float = 1e-5,
    min_determinant: float = 0.01,
) -> Undistorted:
    """Take the lens away from pixels (B, P, 2).

    Kornia's fixed-point iteration and Newton steps find the point, outside the graph; one more Newton step polishes it
    and carries the exact first derivative (implicit function theorem). Garbage and diverging points are set aside
    before that step, so that every gradient is finite.

    Args:
        points_px: (B, P, 2) pixels.
        camera: B cameras.
        iterations: fixed-point steps before the Newton steps; strong lenses need more than Kornia's default of 5.
        newton_steps: steps of Newton's method that end the search: near a lens's fold the fixed point alone creeps.
        tolerance: a point that distorts back further than this from where it came has no ray (0.007 px at f = 700 px).
        min_determinant: area scale of the distortion below which the lens model folds over and has no inverse.
    """
    plane = torch.eye(3, dtype=points_px.dtype, device=points_px.device)
    target = (points_px - centre_px(camera)) / focal_px(camera)
    lens = camera.distortion.detach()
    found = undistort_points(target.detach(), plane, lens, num_iters=iterations)
    for _ in range(newton_steps):
        found = _newton_step(found, target.detach(), lens)
    miss = (distort(found, lens) - target.detach()).abs() / (1 + target.detach().abs())
    slope = distortion_jacobian(found, lens)
    upright = slope[..., 0, 0] + slope[..., 1, 1] > 0  # beyond the fold a point may lie across the centre, turned over
    valid = (miss.amax(-1) < tolerance) & (determinant_2x2(slope) > min_determinant) & upright

    chosen = valid.unsqueeze(-1)
    start = torch.where(chosen, found, torch.zeros_like(found))
    target = (torch.where(chosen, points_px, centre_px(camera)) - centre_px(camera)) / focal_px(camera)
    xy = _newton_step(start, target, camera.distortion)
    return Undistorted(xy, target, inverse_2x2(distortion_jacobian(xy, camera.distortion)), valid)


def _newton_step(xy: Tensor, target: Tensor, distortion: Tensor) -> Tensor:
    """Step from ``xy`` towards the point that distorts to ``target``, with the slope taken as constant."""
    slope = distortion_jacobian(xy, distortion).detach()
    return xy + apply_matrix(inverse_2x2(slope), target - distort(xy, distortion))


def apply_matrix(matrix: Tensor, vector: Tensor) -> Tensor:
    """Matrices (..., n, m) times vectors (..., m), elementwise and so in full precision under autocast."""
    return (matrix * vector.unsqueeze(-2)).sum(-1)


def determinant_2x2(matrix: Tensor) -> Tensor:
    """Determinants (...) of matrices (..., 2, 2)."""
    return matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]


def inverse_2x2(matrix: Tensor) -> Tensor:
    """Inverses (..., 2, 2) of matrices (..., 2, 2)."""
    a, b, c, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 0], matrix[..., 1, 1]
    adjugate = torch.stack([torch.stack([d, -b], -1), torch.stack([-c, a], -1)], -2)
    return adjugate / determinant_2x2(matrix)[..., None, None]
