"""What a camera would see of a hull: where its keypoints come to lie, and how they move with everything unknown.

The ten unknowns, in the order of a state (..., 10):

    0 logarithm of the horizontal range of the hull's origin (m)
    1 its bearing (rad)
    2 heading (rad), the bow's direction, clockwise from the optical axis seen from above
    3 logarithm of the size over the given one, in its standard deviations
    4, 5 roll to starboard and pitch bow up of the boat, in their standard deviations
    6 height of the camera above the boat's own waterline over the mount's, in its standard deviation
    7, 8, 9 the camera's pitch, roll and focal length over the given ones, in their standard deviations
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from usvnet.geometry.lens import Undistorted, apply_matrix, focal_px
from usvnet.geometry.rays import level_rotation
from usvnet.types import Camera, Hull

MIN_DEPTH_M = 0.01
"""Keypoints nearer to the camera's plane are taken there: only a fit gone astray has any."""
MIN_STD_PX = 0.05
"""Added to every keypoint's own, so that one that claims to be exact has a weight that is finite."""

WAVE_SHARE = 0.5
"""Of the variance of the water's height at stem and stern, what goes along with the boat; the rest is waves as long as
the boat, which rise and fall beside it. The boat itself heaves by as much as the water. (In 954 rendered pictures of
boats of 0.9 to 1.8 m the water's standard deviation was 1.4 cm, that of the boats' heave 1.4 cm, the correlation of the
water with it 0.7, and waterline points strayed from the rigid hull by 1.1 cm.)"""


class HullSight(NamedTuple):
    """N boats in B pictures as the fit sees them; camera frame, with the lens taken away. K counts starts."""

    xy: Tensor
    """(B, N, 1, 7, 2) keypoints on the plane z = 1."""
    covariance: Tensor
    """(B, N, 1, 7, 2, 2) theirs, there."""
    usable: Tensor
    """(B, N, 1, 7) bool, False where the pixel has no ray."""
    by_camera: Tensor
    """(B, N, 1, 7, 2, 3) how they move with the camera's pitch, roll and focal length, one standard deviation each."""
    right: Tensor
    """(B, 1, 1, 3) the level frame's X axis."""
    down: Tensor
    """(B, 1, 1, 3) its Y axis."""
    forward: Tensor
    """(B, 1, 1, 3) its Z axis."""
    height_m: Tensor
    """(B, 1, 1) of the camera above mean water."""
    points_m: Tensor
    """(B, 1, 1, 7, 3) the hull's keypoints."""
    leans: Tensor
    """(7,) 1 for keypoints that roll and pitch with the boat, 0 for the two that stay on the water."""
    rides: Tensor
    """(B, 1, 1, 7) how far they go along with the boat's heave: 1, and less for the two that stay on the water."""
    point_std_m: Tensor
    """(B, 1, 1, 7) of each coordinate of them: the shape's, and for the two on the water what waves add to it."""
    shape_std_m: Tensor
    """(B, 1, 1) the shape's alone."""
    wave_std_m: Tensor
    """(B, 1, 1) of the water at stem and stern about what goes along with the boat."""
    std: Tensor
    """(B, 1, 1, 4) of log size, the boat's roll and pitch (rad), and the height above its waterline (m)."""
    curvature_per_m: float
    """Of the water."""


def sight_hulls(
    lens: Undistorted,
    covariance_px2: Tensor,
    camera: Camera,
    hull: Hull,
    boat_roll_std_rad: float,
    boat_pitch_std_rad: float,
    curvature_per_m: float,
    min_std_px: float = MIN_STD_PX,
    wave_share: float = WAVE_SHARE,
) -> HullSight:
    """Prepare keypoints of N boats in B pictures: lens undone (B, N * 7), covariances (B, N, 7, 2, 2)."""
    batch, boats, points = covariance_px2.shape[0], covariance_px2.shape[1], covariance_px2.shape[2]
    R = level_rotation(camera.pitch_rad, camera.roll_rad)  # its rows are the level axes in the camera frame
    right, down, forward = R[:, None, 0], R[:, None, 1], R[:, None, 2]

    ray = torch.cat([lens.xy, torch.ones_like(lens.xy[..., :1])], -1)
    ahead, below = (ray * forward).sum(-1, keepdim=True), (ray * down).sum(-1, keepdim=True)
    turned = below * forward - ahead * down  # a camera that looks down further moves every ray up
    by_pitch = turned[..., :2] - lens.xy * turned[..., 2:]
    by_roll = torch.stack([lens.xy[..., 1], -lens.xy[..., 0]], -1)
    by_focal = apply_matrix(lens.inverse_jacobian, lens.distorted_xy)
    focal_std = camera.focal_std_px / camera.K[:, 1, 1]
    std = torch.stack([camera.pitch_std_rad, camera.roll_std_rad, focal_std], -1)[:, None, None]

    to_xy = lens.inverse_jacobian / focal_px(camera).unsqueeze(-2)
    unit = torch.eye(2, dtype=to_xy.dtype, device=to_xy.device)
    own = torch.where(lens.valid[..., None, None], covariance_px2.flatten(1, 2), unit) + min_std_px**2 * unit
    half = (to_xy.unsqueeze(-1) * own.unsqueeze(-3)).sum(-2)
    covariance = (half.unsqueeze(-2) * to_xy.unsqueeze(-3)).sum(-1)

    # The boat and the water at its stem are equally uncertain in height; they share the mount's and part of the waves'.
    one = torch.ones_like(camera.height_m)
    mount, wave = camera.height_std_m.square() + 1e-12, camera.wave_std_m.square()
    follows = (mount + math.sqrt(wave_share) * wave) / (mount + wave)
    height_std = torch.sqrt(mount + wave)  # the root's gradient is infinite at 0
    wave = (mount + wave) * (1 - follows.square())
    leans = torch.tensor([1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0], dtype=wave.dtype, device=wave.device)
    point_std = torch.sqrt(hull.point_std_m.square().unsqueeze(-1) + wave.unsqueeze(-1) * (1 - leans) + 1e-12)
    hull_std = torch.stack([hull.scale_std, boat_roll_std_rad * one, boat_pitch_std_rad * one, height_std], -1)
    return HullSight(
        xy=lens.xy.view(batch, boats, 1, points, 2),
        covariance=covariance.view(batch, boats, 1, points, 2, 2),
        usable=lens.valid.view(batch, boats, 1, points),
        by_camera=(std * torch.stack([by_pitch, by_roll, by_focal], -1)).view(batch, boats, 1, points, 2, 3),
        right=right.unsqueeze(1),
        down=down.unsqueeze(1),
        forward=forward.unsqueeze(1),
        height_m=camera.height_m[:, None, None],
        points_m=hull.points_m[:, None, None],
        leans=leans,
        rides=(leans + (1 - leans) * follows.unsqueeze(-1))[:, None, None],
        point_std_m=point_std[:, None, None],
        shape_std_m=hull.point_std_m[:, None, None],
        wave_std_m=torch.sqrt(wave + 1e-12)[:, None, None],
        std=hull_std[:, None, None],
        curvature_per_m=curvature_per_m,
    )


class Placement(NamedTuple):
    """A hull put into the camera frame."""

    along_m: Tensor
    """(..., 3) horizontally from below the camera to the hull's origin."""
    across_m: Tensor
    """(..., 3) that, a quarter turn to the right."""
    bow: Tensor
    """(..., 3) unit vector ahead."""
    port: Tensor
    """(..., 3) unit vector to port."""
    still_m: Tensor
    """(..., 7, 3) keypoints ahead, to port and up from the hull's origin, were it upright."""
    leaning_m: Tensor
    """(..., 7, 3) with its roll and pitch, which those on the water do not follow."""
    relative_m: Tensor
    """(..., 7, 3) keypoints from the hull's origin."""
    points_m: Tensor
    """(..., 7, 3) keypoints."""


def place_hull(state: Tensor, sight: HullSight) -> Placement:
    """Put the hulls of states (B, N, K, 10) into the camera frame."""
    range_m, bearing, heading = state[..., 0:1].exp(), state[..., 1:2], state[..., 2:3]
    toward = bearing.sin() * sight.right + bearing.cos() * sight.forward
    aside = bearing.cos() * sight.right - bearing.sin() * sight.forward
    bow = heading.sin() * sight.right + heading.cos() * sight.forward
    port = heading.sin() * sight.forward - heading.cos() * sight.right

    given = state[..., 3:7] * sight.std
    size, roll, pitch = given[..., 0:1].exp(), given[..., 1:2] * sight.leans, given[..., 2:3] * sight.leans
    still = size.unsqueeze(-1) * sight.points_m
    x, y, z = still[..., 0], still[..., 1], still[..., 2]
    leaning = torch.stack([x - pitch * z, y - roll * z, z + pitch * x + roll * y], -1)
    relative = (
        leaning[..., 0:1] * bow.unsqueeze(-2)
        + leaning[..., 1:2] * port.unsqueeze(-2)
        - leaning[..., 2:3] * sight.down.unsqueeze(-2)
    )
    sag = 0.5 * sight.curvature_per_m * range_m**2
    below_m = sight.height_m.unsqueeze(-1) + sag + given[..., 3:4] * sight.rides
    points = relative + (range_m * toward).unsqueeze(-2) + below_m.unsqueeze(-1) * sight.down.unsqueeze(-2)
    return Placement(range_m * toward, range_m * aside, bow, port, still, leaning, relative, points)


def move_hull(placed: Placement, state: Tensor, sight: HullSight) -> Tensor:
    """Derivative (..., 7, 3, 7) of the placed keypoints to the first seven of the state; the camera's own move none."""
    bow, port = placed.bow.unsqueeze(-2), placed.port.unsqueeze(-2)
    still, leaning = placed.still_m, placed.leaning_m
    lever = still * sight.leans.unsqueeze(-1)
    std, down = sight.std.unsqueeze(-2), sight.down.unsqueeze(-2)
    falling = sight.curvature_per_m * (2 * state[..., 0:1]).exp() * sight.down
    return torch.stack(
        [
            (placed.along_m + falling).unsqueeze(-2).expand_as(still),
            placed.across_m.unsqueeze(-2).expand_as(still),
            leaning[..., 1:2] * bow - leaning[..., 0:1] * port,
            std[..., 0:1] * placed.relative_m,
            -std[..., 1:2] * (lever[..., 2:3] * port + lever[..., 1:2] * down),
            -std[..., 2:3] * (lever[..., 2:3] * bow + lever[..., 0:1] * down),
            (std[..., 3:4] * sight.rides.unsqueeze(-1) * down).expand_as(still),
        ],
        -1,
    )


class HullView(NamedTuple):
    """Where keypoints come to lie on the plane z = 1."""

    xy: Tensor
    """(..., 7, 2)"""
    jacobian: Tensor
    """(..., 7, 2, 10) derivative to the state."""
    depth_m: Tensor
    """(..., 7) along the optical axis."""


def predict_keypoints(state: Tensor, sight: HullSight, min_depth_m: float = MIN_DEPTH_M) -> HullView:
    """Project the hulls of states (B, N, K, 10), with the derivative to the state."""
    placed = place_hull(state, sight)
    by_state = move_hull(placed, state, sight)
    depth = placed.points_m[..., 2:].clamp_min(min_depth_m)
    xy = placed.points_m[..., :2] / depth
    by_hull = (by_state[..., :2, :] - xy.unsqueeze(-1) * by_state[..., 2:, :]) / depth.unsqueeze(-1)
    by_camera = sight.by_camera.expand_as(by_hull[..., :3])
    shift = (sight.by_camera * state[..., None, None, 7:]).sum(-1)
    return HullView(xy + shift, torch.cat([by_hull, by_camera], -1), depth[..., 0])
