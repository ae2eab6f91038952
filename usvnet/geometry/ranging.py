"""From pixels to ranges: rays of a mounted camera, met with the water, with a first-order standard deviation.

This is the paper's distance model (Wu et al., J. Mar. Sci. Eng. 2025, 13, 1172) in its general form: with roll, lens
distortion, curved water and an error bar. No matrix product is used, so autocast has nothing to lower.
"""

import torch
from torch import Tensor, nn

from usvnet.geometry.hull_fit import chi_squared_limit, fit_hulls
from usvnet.geometry.hull_model import generic_hull
from usvnet.geometry.hull_range import estimate_hull, fuse, halfway, range_hull
from usvnet.geometry.hull_sight import sight_hulls
from usvnet.geometry.lens import Undistorted, apply_matrix, focal_px, undistort
from usvnet.geometry.rays import trace_undistorted
from usvnet.geometry.water import MIN_SINE, REFRACTION, effective_radius_m, meet_water
from usvnet.types import WATERLINE_KEYPOINTS, Camera, Hull, RangeEstimate, Ranges, Reason


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


class RangingLayer(nn.Module):
    """The geometry at the end of the network: no weights, differentiable, float32 or wider whatever comes in.

    Args:
        curved_water: follow the earth's curvature (worth 1 % of range at 500 m, seen from 1.5 m) or take it as flat.
        refraction: coefficient k of terrestrial refraction, used with curved water only.
        box_bottom_std_px: standard deviation of the bottom centre of a box, which brings none of its own.
        boat_roll_std_rad: standard deviation of a boat's roll about upright.
        boat_pitch_std_rad: standard deviation of a boat's pitch about its resting trim.
        misfit_limit: largest misfit of a hull that is not refused. Since the fit bounds what a keypoint can cost, 0.9
            (and not 1) refuses 1 good boat in 100.

    The buffer ``misfit_limit`` is the misfit (:class:`usvnet.types.Ranges`) above which a hull's fit is refused. It
    may be set to the 99 % quantile of a validation split.
    """

    misfit_limit: Tensor
    generic_points_m: Tensor
    generic_scale_std: Tensor
    generic_point_std_m: Tensor

    def __init__(
        self,
        curved_water: bool = False,
        refraction: float = REFRACTION,
        box_bottom_std_px: float = 1.0,
        boat_roll_std_rad: float = 0.05,
        boat_pitch_std_rad: float = 0.035,
        misfit_limit: float = 0.9,
    ) -> None:
        super().__init__()
        self.box_bottom_std_px = box_bottom_std_px
        self.boat_roll_std_rad = boat_roll_std_rad
        self.boat_pitch_std_rad = boat_pitch_std_rad
        self.bow_bottom, self.stern_bottom = WATERLINE_KEYPOINTS
        self.curved_water = curved_water
        self.refraction = refraction
        self.curvature_per_m = 1 / effective_radius_m(refraction) if curved_water else 0.0
        self.register_buffer("misfit_limit", torch.tensor(misfit_limit), persistent=False)
        for name, value in generic_hull()._asdict().items():
            self.register_buffer(f"generic_{name}", value, persistent=False)

    def forward(
        self, keypoints_px: Tensor, covariance_px2: Tensor, boxes_px: Tensor, camera: Camera, hull: Hull | None = None
    ) -> Ranges:
        """All estimators of N boats in B pictures, side by side.

        Args:
            keypoints_px: (B, N, 7, 2) keypoints, in the order of ``KEYPOINT_NAMES``.
            covariance_px2: (B, N, 7, 2, 2) their covariances.
            boxes_px: (B, N, 4) boxes.
            camera: the camera of each picture, as the picture is.
            hull: the shape of the boats in each picture; None takes a generic one of uncertain size.
        """
        dtype = torch.promote_types(torch.promote_types(keypoints_px.dtype, camera.K.dtype), torch.float32)
        camera = _cast_camera(camera, dtype)
        covariance_px2 = covariance_px2.to(dtype)
        if hull is None:
            batch = keypoints_px.shape[0]
            scale_std, point_std_m = self.generic_scale_std.expand(batch), self.generic_point_std_m.expand(batch)
            hull = Hull(self.generic_points_m.expand(batch, -1, -1), scale_std, point_std_m)
        hull = Hull(hull.points_m.to(dtype), hull.scale_std.to(dtype), hull.point_std_m.to(dtype))
        boats = keypoints_px.shape[1]

        bottom_px = torch.stack([(boxes_px[..., 0] + boxes_px[..., 2]) / 2, boxes_px[..., 3]], -1)
        isotropic = torch.eye(2, dtype=dtype, device=keypoints_px.device) * self.box_bottom_std_px**2
        points_px = torch.cat([bottom_px.to(dtype), keypoints_px.flatten(1, 2).to(dtype)], 1)
        covariance = torch.cat([isotropic.expand(points_px.shape[0], boats, 2, 2), covariance_px2.flatten(1, 2)], 1)
        lens = undistort(points_px, camera)
        everything = self.range_rays(lens, covariance, camera)
        bow = _slice(everything, boats + self.bow_bottom, 8 * boats, 7)
        stern = _slice(everything, boats + self.stern_bottom, 8 * boats, 7)
        waterline = _either(bow.slant_m <= stern.slant_m, bow, stern)
        box_bottom = _slice(everything, 0, boats, 1)

        lens = Undistorted(
            lens.xy[:, boats:], lens.distorted_xy[:, boats:], lens.inverse_jacobian[:, boats:], lens.valid[:, boats:]
        )
        roll_std_rad, pitch_std_rad = self.boat_roll_std_rad, self.boat_pitch_std_rad
        sight = sight_hulls(lens, covariance_px2, camera, hull, roll_std_rad, pitch_std_rad, self.curvature_per_m)
        fit = fit_hulls(sight)
        misfit = fit.cost / chi_squared_limit(fit.degrees_of_freedom)
        fitted = range_hull(fit, sight, self.curved_water, self.refraction)
        by_hull = estimate_hull(fitted, fit.degrees_of_freedom > 0, misfit <= self.misfit_limit)
        same_point = _either(fitted.keypoint == self.bow_bottom, bow, stern)
        # keypoints that do not fit one hull are suspect, and the box knows nothing of them
        unfit = by_hull.reason == Reason.MISFIT.value
        alone = _either(unfit, halfway(box_bottom, waterline), waterline)
        partner = _either(by_hull.valid, same_point, alone)
        heading = fit.state[..., 2]
        return Ranges(
            box_bottom=box_bottom,
            waterline=waterline,
            hull=by_hull,
            fused=fuse(by_hull, partner, fitted),
            heading_rad=torch.atan2(torch.sin(heading), torch.cos(heading)),
            heading_std_rad=torch.sqrt(fit.covariance[..., 2, 2]),
            misfit=misfit,
        )

    @torch.jit.export
    def range_points(self, points_px: Tensor, covariance_px2: Tensor, camera: Camera) -> RangeEstimate:
        """Range of points on the water (B, P, 2) with covariances (B, P, 2, 2), by B cameras: shape (B, P).

        The standard deviation is first order in the keypoint and the camera's pitch, roll, focal length (fx and fy
        wrong by the same fraction) and height above the water at the boat (mount and wave), taken as independent. Slant
        range depends on the ray only through the sine of its depression, the Y of its direction, so one chain rule
        serves flat and curved water.
        """
        dtype = torch.promote_types(torch.promote_types(points_px.dtype, camera.K.dtype), torch.float32)
        camera = _cast_camera(camera, dtype)
        return self.range_rays(undistort(points_px.to(dtype), camera), covariance_px2.to(dtype), camera)

    def range_rays(self, lens: Undistorted, covariance_px2: Tensor, camera: Camera) -> RangeEstimate:
        """The same for points whose lens is undone, everything in one dtype."""
        rays = trace_undistorted(lens, camera)
        direction = rays.direction
        hit = meet_water(direction, camera.height_m.unsqueeze(-1), self.curved_water, self.refraction)
        valid = hit.valid & rays.valid

        by_xy = hit.slant_by_sine_m.unsqueeze(-1) * rays.direction_by_xy[..., 1, :]
        by_px = by_xy / focal_px(camera)
        by_log_focal = -(by_xy * rays.distorted_xy).sum(-1)
        by_pitch = hit.slant_by_sine_m * direction[..., 2]
        by_roll = hit.slant_by_sine_m * direction[..., 0] * torch.cos(camera.pitch_rad).unsqueeze(-1)
        variance = (
            (by_px * apply_matrix(covariance_px2, by_px)).sum(-1)
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
            reason=torch.where(
                valid, Reason.OK.value, torch.where(rays.valid, Reason.HORIZON.value, Reason.NO_RAY.value)
            ),
        )


def _cast_camera(camera: Camera, dtype: torch.dtype) -> Camera:
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


def _slice(estimate: RangeEstimate, start: int, stop: int, step: int) -> RangeEstimate:
    return RangeEstimate(
        slant_m=estimate.slant_m[:, start:stop:step],
        slant_std_m=estimate.slant_std_m[:, start:stop:step],
        horizontal_m=estimate.horizontal_m[:, start:stop:step],
        bearing_rad=estimate.bearing_rad[:, start:stop:step],
        position_m=estimate.position_m[:, start:stop:step],
        valid=estimate.valid[:, start:stop:step],
        reason=estimate.reason[:, start:stop:step],
    )


def _either(first: Tensor, a: RangeEstimate, b: RangeEstimate) -> RangeEstimate:
    reason = torch.where(first, a.reason, b.reason)
    return RangeEstimate(
        slant_m=torch.where(first, a.slant_m, b.slant_m),
        slant_std_m=torch.where(first, a.slant_std_m, b.slant_std_m),
        horizontal_m=torch.where(first, a.horizontal_m, b.horizontal_m),
        bearing_rad=torch.where(first, a.bearing_rad, b.bearing_rad),
        position_m=torch.where(first.unsqueeze(-1), a.position_m, b.position_m),
        valid=reason == Reason.OK.value,
        reason=reason,
    )
