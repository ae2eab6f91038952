"""From pixels to ranges: rays of a mounted camera, met with the water, with a first-order standard deviation.

This is the paper's distance model (Wu et al., J. Mar. Sci. Eng. 2025, 13, 1172) in its general form: with roll, lens
distortion, curved water and an error bar. No matrix product is used, so autocast has nothing to lower.
"""

from typing import NamedTuple, Tuple

import torch
from torch import Tensor, nn

from usvnet.geometry.lens import apply_matrix, focal_px, undistort
from usvnet.geometry.water import MIN_SINE, REFRACTION, meet_water
from usvnet.types import WATERLINE_KEYPOINTS, Camera, RangeEstimate


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


def paper_range(
    points_px: Tensor, K: Tensor, height_m: Tensor, pitch_rad: Tensor, min_sine: float = MIN_SINE
) -> Tensor:
    """Slant range (B, P) of pixels (B, P, 2) by the paper's closed form: no roll, no distortion, flat water.

    gamma = atan((v - cy) / fy), beta = pitch + gamma, z = h cos(gamma) / sin(beta), D = z |K^-1 (u, v, 1)|, with K
    (B, 3, 3), height and pitch (B,); inf for a ray at or above the horizon. This is the consistent reading of
    Wu et al., J. Mar. Sci. Eng. 2025, 13, 1172, which slips twice in print: its Q is already shifted by the
    principal point and K^-1 shifts it once more, and its RMSE lacks the square.
    """
    x = (points_px[..., 0] - K[..., 0, 2, None]) / K[..., 0, 0, None]
    y = (points_px[..., 1] - K[..., 1, 2, None]) / K[..., 1, 1, None]
    gamma = torch.atan(y)
    below = torch.sin(pitch_rad.unsqueeze(-1) + gamma)
    valid = below > min_sine
    z = height_m.unsqueeze(-1) * torch.cos(gamma) / torch.where(valid, below, torch.ones_like(below))
    slant = z * torch.sqrt(x * x + y * y + 1)
    return torch.where(valid, slant, torch.full_like(slant, float("inf")))


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
    lens = undistort(points_px, camera)
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


class RangingLayer(nn.Module):
    """The geometry at the end of the network: no weights, differentiable, float32 or wider whatever comes in.

    Args:
        curved_water: follow the earth's curvature (worth 1 % of range at 500 m, seen from 1.5 m) or take it as flat.
        refraction: coefficient k of terrestrial refraction, used with curved water only.
        box_bottom_std_px: standard deviation of the bottom centre of a box, which brings none of its own.
    """

    def __init__(
        self, curved_water: bool = False, refraction: float = REFRACTION, box_bottom_std_px: float = 1.0
    ) -> None:
        super().__init__()
        self.box_bottom_std_px = box_bottom_std_px
        self.bow_bottom, self.stern_bottom = WATERLINE_KEYPOINTS
        self.curved_water = curved_water
        self.refraction = refraction

    def forward(
        self, keypoints_px: Tensor, covariance_px2: Tensor, boxes_px: Tensor, camera: Camera
    ) -> Tuple[RangeEstimate, RangeEstimate]:
        """Both of the paper's estimators of N boats in B pictures.

        Args:
            keypoints_px: (B, N, 7, 2) keypoints, in the order of ``KEYPOINT_NAMES``.
            covariance_px2: (B, N, 7, 2, 2) their covariances.
            boxes_px: (B, N, 4) boxes.
            camera: the camera of each picture, as the picture is.

        Returns:
            ``box_bottom`` (the baseline: bottom centre of the box) and ``waterline`` (the nearer of bow_bottom and
            stern_bottom), each of shape (B, N).
        """
        bottom = torch.stack([(boxes_px[..., 0] + boxes_px[..., 2]) / 2, boxes_px[..., 3]], -1)
        isotropic = torch.eye(2, dtype=covariance_px2.dtype, device=covariance_px2.device) * self.box_bottom_std_px**2
        points = torch.cat([bottom, keypoints_px[..., self.bow_bottom, :], keypoints_px[..., self.stern_bottom, :]], 1)
        covariance = torch.cat(
            [
                isotropic.expand_as(covariance_px2[..., 0, :, :]),
                covariance_px2[..., self.bow_bottom, :, :],
                covariance_px2[..., self.stern_bottom, :, :],
            ],
            1,
        )
        everything = self.range_points(points, covariance, camera)
        boats = boxes_px.shape[1]
        bow = _slice(everything, boats, 2 * boats)
        stern = _slice(everything, 2 * boats, 3 * boats)
        return _slice(everything, 0, boats), _nearer(bow, stern)

    def range_points(self, points_px: Tensor, covariance_px2: Tensor, camera: Camera) -> RangeEstimate:
        """Range of points on the water (B, P, 2) with covariances (B, P, 2, 2), by B cameras: shape (B, P).

        The standard deviation is first order in the keypoint and the camera's pitch, roll, focal length (fx and fy
        wrong by the same fraction) and height above the water at the boat (mount and wave), taken as independent. Slant
        range depends on the ray only through the sine of its depression, the Y of its direction, so one chain rule
        serves flat and curved water.
        """
        dtype = torch.promote_types(torch.promote_types(points_px.dtype, camera.K.dtype), torch.float32)
        camera = _cast(camera, dtype)
        rays = trace_pixels(points_px.to(dtype), camera)
        direction = rays.direction
        hit = meet_water(direction, camera.height_m.unsqueeze(-1), self.curved_water, self.refraction)
        valid = hit.valid & rays.valid

        by_xy = hit.slant_by_sine_m.unsqueeze(-1) * rays.direction_by_xy[..., 1, :]
        by_px = by_xy / focal_px(camera)
        by_log_focal = -(by_xy * rays.distorted_xy).sum(-1)
        by_pitch = hit.slant_by_sine_m * direction[..., 2]
        by_roll = hit.slant_by_sine_m * direction[..., 0] * torch.cos(camera.pitch_rad).unsqueeze(-1)
        variance = (
            (by_px * apply_matrix(covariance_px2.to(dtype), by_px)).sum(-1)
            + (by_log_focal * (camera.focal_std_px / camera.K[..., 1, 1]).unsqueeze(-1)) ** 2
            + (by_pitch * camera.pitch_std_rad.unsqueeze(-1)) ** 2
            + (by_roll * camera.roll_std_rad.unsqueeze(-1)) ** 2
            + hit.slant_by_height**2 * (camera.height_std_m**2 + camera.wave_std_m**2).unsqueeze(-1)
        )

        infinite = torch.full_like(hit.slant_m, float("inf"))
        std = torch.sqrt(variance.clamp_min(1e-12))  # the root's gradient is infinite at 0
        position = hit.slant_m.unsqueeze(-1) * direction
        return RangeEstimate(
            slant_m=torch.where(valid, hit.slant_m, infinite),
            slant_std_m=torch.where(valid, std, infinite),
            horizontal_m=torch.where(valid, hit.horizontal_m, infinite),
            bearing_rad=torch.atan2(direction[..., 0], direction[..., 2]),
            position_m=torch.where(valid.unsqueeze(-1), position, torch.zeros_like(position)),
            valid=valid,
        )


def _cast(camera: Camera, dtype: torch.dtype) -> Camera:
    return Camera(
        K=camera.K.to(dtype),
        distortion=camera.distortion.to(dtype),
        size_px=camera.size_px.to(dtype),
        height_m=camera.height_m.to(dtype),
        pitch_rad=camera.pitch_rad.to(dtype),
        roll_rad=camera.roll_rad.to(dtype),
        focal_std_px=camera.focal_std_px.to(dtype),
        height_std_m=camera.height_std_m.to(dtype),
        pitch_std_rad=camera.pitch_std_rad.to(dtype),
        roll_std_rad=camera.roll_std_rad.to(dtype),
        wave_std_m=camera.wave_std_m.to(dtype),
    )


def _slice(estimate: RangeEstimate, start: int, stop: int) -> RangeEstimate:
    return RangeEstimate(
        slant_m=estimate.slant_m[:, start:stop],
        slant_std_m=estimate.slant_std_m[:, start:stop],
        horizontal_m=estimate.horizontal_m[:, start:stop],
        bearing_rad=estimate.bearing_rad[:, start:stop],
        position_m=estimate.position_m[:, start:stop],
        valid=estimate.valid[:, start:stop],
    )


def _nearer(a: RangeEstimate, b: RangeEstimate) -> RangeEstimate:
    first = a.slant_m <= b.slant_m
    return RangeEstimate(
        slant_m=torch.where(first, a.slant_m, b.slant_m),
        slant_std_m=torch.where(first, a.slant_std_m, b.slant_std_m),
        horizontal_m=torch.where(first, a.horizontal_m, b.horizontal_m),
        bearing_rad=torch.where(first, a.bearing_rad, b.bearing_rad),
        position_m=torch.where(first.unsqueeze(-1), a.position_m, b.position_m),
        valid=torch.where(first, a.valid, b.valid),
    )
