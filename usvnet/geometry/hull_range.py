"""How far a fitted hull is, and what that says together with its waterline keypoint alone.

Both estimates of one point are taken as linear in what is unknown: the noise n of the keypoints, the hull's shape, and
the u of :mod:`usvnet.geometry.hull_fit` (the camera's attitude, focal length and height). With b the waterline range's
derivative to its keypoint and c to the u, and k and g those of the fit,

    e_waterline = b n_j - c u,        e_hull = sum_i k_i n_i - g u,

so their covariance is b S_j k_j + c g, and the minimum-variance unbiased combination follows. The fit holds that
keypoint already: where its shape is exact it lacks nothing that the waterline could add, the weight of the waterline is
0 and fused = hull. Where it is not, the waterline keypoint still stands on the very water that the laser ranges to.
"""

from typing import NamedTuple, Tuple

import torch
from torch import Tensor

from usvnet.geometry.hull_fit import HullFit
from usvnet.geometry.hull_sight import HullSight, move_hull, place_hull
from usvnet.geometry.lens import apply_matrix
from usvnet.geometry.water import REFRACTION, meet_water
from usvnet.types import WATERLINE_KEYPOINTS, RangeEstimate, Reason


class HullRange(NamedTuple):
    """The waterline point of a fitted hull that is nearer to the camera."""

    slant_m: Tensor
    """(B, N)"""
    variance_m2: Tensor
    """(B, N) of the slant range."""
    position_m: Tensor
    """(B, N, 3) in the level frame."""
    keypoint: Tensor
    """(B, N) int64, which keypoint it is."""
    waterline_variance_m2: Tensor
    """(B, N) of the slant range that this keypoint alone gives."""
    shared_m2: Tensor
    """(B, N) covariance of both."""


def range_hull(
    fit: HullFit,
    sight: HullSight,
    curved: bool = False,
    refraction: float = REFRACTION,
    points: Tuple[int, int] = WATERLINE_KEYPOINTS,
) -> HullRange:
    """Range fitted boats (B, N)."""
    state = fit.state.unsqueeze(2)
    placed = place_hull(state, sight)
    slants = torch.sqrt(placed.points_m.square().sum(-1) + 1e-12)[:, :, 0]
    keypoint = torch.where(slants[..., points[0]] <= slants[..., points[1]], points[0], points[1])
    point = pick(placed.points_m, keypoint)
    slant = torch.sqrt((point * point).sum(-1) + 1e-12)
    axes = torch.stack([sight.right, sight.down, sight.forward], -2)[:, :, 0]
    position = apply_matrix(axes, point)

    moved = pick(move_hull(placed, state, sight).flatten(-2), keypoint).unflatten(-1, (3, 7))
    slope = (point.unsqueeze(-1) * moved).sum(-2) / slant.unsqueeze(-1)  # of the slant range to the first seven
    follows = (fit.covariance[..., :7, :] * slope.unsqueeze(-1)).sum(-2)  # covariance of range and state
    gain = pick(fit.gain.flatten(-2).unsqueeze(2), keypoint).unflatten(-1, (2, 10))
    by_xy = (gain[..., :7] * slope.unsqueeze(-2)).sum(-1)  # how the range follows this very keypoint

    # The point itself strays from the shape, along the water; the fit takes that for the keypoint's noise.
    outward = point - (point * sight.down[:, :, 0]).sum(-1, keepdim=True) * sight.down[:, :, 0]
    away = outward / torch.sqrt((outward * outward).sum(-1, keepdim=True) + 1e-12)
    level = (point * away).sum(-1) / slant
    depth = point[..., 2:].clamp_min(0.01)
    plane = point[..., :2] / depth
    stray = (away[..., :2] - plane * away[..., 2:]) / depth
    shape = sight.shape_std_m[:, :, 0].square() * level * (level - 2 * (by_xy * stray).sum(-1))
    variance = (follows[..., :7] * slope).sum(-1) + shape

    xy = pick(sight.xy, keypoint)
    ray = torch.cat([xy, torch.ones_like(xy[..., :1])], -1)
    length = torch.sqrt((ray * ray).sum(-1, keepdim=True))
    down = sight.down[:, :, 0]
    sine = (ray * down).sum(-1, keepdim=True) / length
    hit = meet_water(apply_matrix(axes, ray / length), sight.height_m[:, :, 0], curved, refraction)
    b = hit.slant_by_sine_m.unsqueeze(-1) * (down[..., :2] - sine * ray[..., :2] / length) / length
    noise = pick(sight.covariance.flatten(-2), keypoint).unflatten(-1, (2, 2))
    common = pick(sight.by_camera.flatten(-2), keypoint).unflatten(-1, (2, 3))
    c_camera = -(b.unsqueeze(-1) * common).sum(-2)
    c_height = hit.slant_by_height * sight.std[..., 0, 3] * sight.rides[:, :, 0, points[0]]
    weight = pick(fit.weight.unsqueeze(2).unsqueeze(-1), keypoint)[..., 0]
    spread = apply_matrix(noise, b)
    alone = (b * spread).sum(-1) / weight.clamp_min(1e-6)  # a keypoint that the fit holds for wrong counts as such
    wave = hit.slant_by_height * sight.wave_std_m[:, :, 0].square()
    rise = (plane * down[..., 2:] - down[..., :2]) / depth  # of the keypoint with the water there
    alone = alone + c_camera.square().sum(-1) + c_height.square() + hit.slant_by_height * wave
    shared = (by_xy * spread).sum(-1) + c_height * follows[..., 6] + (c_camera * follows[..., 7:]).sum(-1)
    shared = shared + wave * (by_xy * rise).sum(-1)
    return HullRange(slant, variance, position, keypoint, alone, shared)


def pick(values: Tensor, keypoint: Tensor) -> Tensor:
    """Of values (B, N, 1, 7, D), those (B, N, D) of keypoints (B, N)."""
    index = keypoint[..., None, None].expand(-1, -1, -1, values.shape[-1])
    return values[:, :, 0].gather(2, index)[:, :, 0]


def estimate_hull(fitted: HullRange, enough: Tensor, fits: Tensor) -> RangeEstimate:
    """The ``hull`` estimate, refused where there were not ``enough`` keypoints or they do not fit: both (B, N) bool."""
    reason = torch.where(enough, torch.where(fits, Reason.OK.value, Reason.MISFIT.value), Reason.NO_RAY.value)
    horizontal = torch.sqrt(fitted.position_m[..., 0].square() + fitted.position_m[..., 2].square() + 1e-12)
    return _estimate(fitted.slant_m, fitted.variance_m2, horizontal, fitted.position_m, reason)


def fuse(hull: RangeEstimate, waterline: RangeEstimate, fitted: HullRange) -> RangeEstimate:
    """The ``fused`` estimate: both weighted for the least variance where both are valid, else the one that is.

    The weight is kept between 0 and 1: outside, the mean would bet on the correlation being known exactly.
    """
    both = hull.valid & waterline.valid
    one = torch.ones_like(fitted.slant_m)
    difference = fitted.variance_m2 + fitted.waterline_variance_m2 - 2 * fitted.shared_m2
    share = (fitted.waterline_variance_m2 - fitted.shared_m2) / torch.where(difference > 1e-12, difference, one)
    share = torch.where(both, share.clamp(0.0, 1.0), torch.where(hull.valid, one, torch.zeros_like(one)))
    rest = 1 - share
    alone = torch.where(waterline.valid & ~hull.valid, waterline.slant_std_m.square(), fitted.waterline_variance_m2)
    variance = share * share * fitted.variance_m2 + rest * rest * alone + 2 * share * rest * fitted.shared_m2
    return _mixed(share, hull, waterline, variance)


def halfway(a: RangeEstimate, b: RangeEstimate) -> RangeEstimate:
    """The middle of two estimates that are equally suspect, with half of their difference as further doubt.

    Their errors may be one and the same, so that their sigmas are averaged and not their variances. Where only one is
    valid it stands alone.
    """
    both = a.valid & b.valid
    half = torch.full_like(a.slant_m, 0.5)
    share = torch.where(both, half, torch.where(a.valid, 2 * half, torch.zeros_like(half)))
    zero = torch.zeros_like(half)
    apart = torch.where(both, a.slant_m, zero) - torch.where(both, b.slant_m, zero)
    variance = _mean(share, a.slant_std_m, b.slant_std_m).square() + (apart / 2).square()
    return _mixed(share, a, b, variance)


def _mixed(share: Tensor, a: RangeEstimate, b: RangeEstimate, variance: Tensor) -> RangeEstimate:
    """So much of a, the rest of b, with this variance; the reason where neither is valid is b's."""
    position = share.unsqueeze(-1) * a.position_m + (1 - share).unsqueeze(-1) * b.position_m
    length = torch.sqrt((position * position).sum(-1, keepdim=True) + 1e-12)
    reason = torch.where(a.valid | b.valid, Reason.OK.value, b.reason)
    slant = _mean(share, a.slant_m, b.slant_m)
    slant = torch.where(reason == Reason.OK.value, slant, torch.ones_like(slant))
    horizontal = _mean(share, a.horizontal_m, b.horizontal_m)
    return _estimate(slant, variance, horizontal, position * (slant.unsqueeze(-1) / length), reason)


def _mean(share: Tensor, a: Tensor, b: Tensor) -> Tensor:
    """Weighted mean, in which what has no weight may be infinite."""
    zero = torch.zeros_like(share)
    return torch.where(share > 0, share * a, zero) + torch.where(share < 1, (1 - share) * b, zero)


def _estimate(slant: Tensor, variance: Tensor, horizontal: Tensor, position: Tensor, reason: Tensor) -> RangeEstimate:
    valid = reason == Reason.OK.value
    infinite = torch.full_like(slant, float("inf"))
    return RangeEstimate(
        slant_m=torch.where(valid, slant, infinite),
        slant_std_m=torch.where(valid, torch.sqrt(variance.clamp_min(1e-12)), infinite),
        horizontal_m=torch.where(valid, horizontal, infinite),
        bearing_rad=torch.atan2(position[..., 0], position[..., 2]),
        position_m=torch.where(valid.unsqueeze(-1), position, torch.zeros_like(position)),
        valid=valid,
        reason=reason,
    )
