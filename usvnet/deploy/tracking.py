"""From the boats of one frame to boats over time: what the tracker needs to know of each, and whose track it is on."""

import math
from collections.abc import Sequence

import numpy as np
import torch

from usvnet.deploy.outputs import FrameBoats
from usvnet.evaluation.records import BoatRecord, RangeRecord
from usvnet.geometry.camera import camera_to
from usvnet.geometry.lens import apply_matrix, focal_px
from usvnet.geometry.rays import trace_pixels
from usvnet.tracking.filter import Sighting
from usvnet.tracking.tracker import Tracker, TrackingConfig
from usvnet.types import WATERLINE_KEYPOINTS, Camera

LEAST_STD_RAD = 1e-5
"""No direction is surer than this, whatever a heatmap claims."""
UNKNOWN_SHARE = 0.5
"""Part of the variance that all frames share, where no waterline keypoint tells it."""


class BoatFollower:
    """Gives the boats of frame after frame their tracks.

    Args:
        estimator: whose ranges are followed.
        config: rules of the tracker.
    """

    def __init__(self, estimator: str, config: TrackingConfig | None = None) -> None:
        self.estimator = estimator
        self.tracker = Tracker(config)

    def follow(self, found: FrameBoats) -> FrameBoats:
        """Add to a frame the boats that are tracked in it.

        Raises:
            ValueError: the frame has no time.
        """
        if found.frame.time_s is None:
            raise ValueError(f"{found.frame.name}: has no time, which tracking needs")
        sightings = sight(found.boats, self.estimator, found.camera)
        return found._replace(tracks=self.tracker.step(found.frame.time_s, sightings))


def sight(boats: Sequence[BoatRecord], estimator: str, camera: Camera) -> list[Sighting]:
    """Say what a frame tells of its boats, and split the variance into what is new in it and what all frames share.

    The bearing is that of the hull's middle, between the two waterline keypoints: the range belongs to the nearer of
    them, and which that is may change from frame to frame while a boat lies broadside. Where only one of the two has a
    ray, its bearing stands for the middle's, and where neither has one, that of the range does, both no surer than half
    the box is wide. Without a range either, nothing is sighted: the bearing is nan.

    The range is the estimator's, its standard deviation too. Pitch, roll, focal length and height of the camera are
    common to all frames; keypoints and waves are new. In which proportion is computed for the nearer waterline keypoint
    on flat water, to first order, and taken to hold for the other estimators as well. With t the tangent of the
    depression of a ray and h the height, 1 / range is t / h, and one radian of pitch moves t by (1 + t^2) cos(bearing).

    Args:
        boats: in the frame's pixels.
        estimator: whose ranges to take.
        camera: the frame's (a batch of 1).
    """
    if not boats:
        return []
    camera = camera_to(camera, dtype=torch.float64)
    ends = list(WATERLINE_KEYPOINTS)
    points = torch.from_numpy(np.stack([boat.keypoints_px[ends] for boat in boats])).double()
    covariance = torch.from_numpy(np.stack([boat.keypoint_covariance_px2[ends] for boat in boats])).double()
    rays = trace_pixels(points.flatten(0, 1)[None], camera)
    seen = rays.valid[0].reshape(-1, 2)
    direction = rays.direction[0].reshape(-1, 2, 3)
    x, y, z = direction.unbind(-1)
    level = torch.hypot(x, z)
    bearing, tangent = torch.atan2(x, z), y / level
    dx, dy, dz = rays.direction_by_xy[0].reshape(-1, 2, 3, 2).unbind(-2)  # each (boats, 2, 2)
    x, y, z, level = (value.unsqueeze(-1) for value in (x, y, z, level))
    bearing_by_px = (z * dx - x * dz) / level**2 / focal_px(camera)[0]
    tangent_by_xy = dy / level - y * (x * dx + z * dz) / level**3
    tangent_by_px = tangent_by_xy / focal_px(camera)[0]
    bearing_variance = (bearing_by_px * apply_matrix(covariance, bearing_by_px)).sum(-1)
    height, pitch = camera.height_m, camera.pitch_rad
    new = (tangent_by_px * apply_matrix(covariance, tangent_by_px)).sum(-1) + (
        tangent * camera.wave_std_m / height
    ) ** 2
    tilted = 1 + tangent**2
    by_log_focal = (tangent_by_xy * rays.distorted_xy[0].reshape(-1, 2, 2)).sum(-1)
    common = (
        (tilted * torch.cos(bearing) * camera.pitch_std_rad) ** 2
        + (tilted * torch.sin(bearing) * torch.cos(pitch) * camera.roll_std_rad) ** 2
        + (by_log_focal * camera.focal_std_px / camera.K[:, 1, 1]) ** 2
        + (tangent * camera.height_std_m / height) ** 2
    )
    nearer = tangent.masked_fill(~seen, -math.inf).argmax(1, keepdim=True)
    shared = (common / (common + new + LEAST_STD_RAD**2)).gather(1, nearer)[:, 0]
    middle = bearing[:, 0] + torch.remainder(bearing[:, 1] - bearing[:, 0] + math.pi, 2 * math.pi) / 2 - math.pi / 2
    boxes = torch.from_numpy(np.stack([boat.box_px for boat in boats])).double()
    half_box = (boxes[:, 2] - boxes[:, 0]) / 2 / focal_px(camera)[0, 0, 0]
    both, none = seen.all(1), ~seen.any(1)
    bearings = torch.where(both, middle, torch.where(seen[:, 0], bearing[:, 0], bearing[:, 1]))
    variance = torch.where(both, bearing_variance.sum(1) / 4, (bearing_variance * seen).sum(1) + half_box**2)
    stds = torch.sqrt(variance + LEAST_STD_RAD**2)
    bearings, shared = bearings.masked_fill(none, math.nan), shared.masked_fill(none, UNKNOWN_SHARE)
    return [
        _sighting(boat.ranges[estimator], towards, std, share)
        for boat, towards, std, share in zip(boats, bearings.tolist(), stds.tolist(), shared.tolist())
    ]


def _sighting(estimate: RangeRecord, bearing_rad: float, bearing_std_rad: float, shared: float) -> Sighting:
    """Turn slant range and its sigma into 1 / horizontal range, the shared part of the variance apart.

    A bearing of nan is that of the range.
    """
    if not (estimate.usable and math.isfinite(estimate.slant_std_m) and estimate.horizontal_m > 0):
        return Sighting(bearing_rad, bearing_std_rad, math.nan, math.nan, math.nan)
    std = estimate.slant_std_m * estimate.slant_m / estimate.horizontal_m**3
    inverse = 1 / estimate.horizontal_m
    if math.isnan(bearing_rad):
        bearing_rad = estimate.bearing_rad
    return Sighting(bearing_rad, bearing_std_rad, inverse, std * math.sqrt(1 - shared), std * math.sqrt(shared))
