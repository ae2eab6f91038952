"""Boats put on the water at given distances and headings, and the pixels that a camera has of them."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from usvnet.evaluation.reranging import Cases
from usvnet.geometry.camera import camera_to, project, stack_cameras
from usvnet.geometry.hull_model import hull_to, stack_hulls
from usvnet.geometry.rays import level_rotation
from usvnet.geometry.water import REFRACTION, effective_radius_m
from usvnet.types import WATERLINE_KEYPOINTS, Camera, Hull


def scenario_cases(
    camera: Camera,
    hull: Hull,
    distances_m: Sequence[float],
    headings_deg: Sequence[float],
    bearing_deg: float = 0.0,
    keypoint_std_px: float = 0.0,
    curved_water: bool = False,
) -> Cases:
    """One boat for each distance and heading, seen without error.

    Args:
        camera: a batch of 1.
        hull: a batch of 1.
        distances_m: slant range to the nearer waterline keypoint.
        headings_deg: way of the boat, 0 away from the camera, clockwise seen from above.
        bearing_deg: where the ranged points are, clockwise from straight ahead.
        keypoint_std_px: how well the keypoints are said to be known.
        curved_water: put the boats on the curved earth.

    Returns:
        The boats of the first distance, then those of the second, and so on.

    Raises:
        ValueError: a distance is less than the camera's height, or the boat's ranged point is not in the picture.
    """
    camera, hull = camera_to(camera, dtype=torch.float64), hull_to(hull, dtype=torch.float64)
    height_m = float(camera.height_m[0])
    R = level_rotation(camera.pitch_rad, camera.roll_rad)[0]
    bearing_rad = math.radians(bearing_deg)
    ahead = torch.tensor([math.sin(bearing_rad), 0.0, math.cos(bearing_rad)], dtype=torch.float64)
    down = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    points_px = []
    for distance_m in distances_m:
        if distance_m <= height_m:
            raise ValueError(
                f"distances_m: expected more than the camera's {height_m:g} m of height, got {distance_m:g}"
            )
        down_m = _depth_m(distance_m, height_m, curved_water)
        for heading_deg in headings_deg:
            points = _boat_level(hull, math.radians(heading_deg))
            nearest = points[list(WATERLINE_KEYPOINTS)] @ ahead
            chosen = WATERLINE_KEYPOINTS[int(nearest.argmin())]
            points = points - points[chosen] + math.sqrt(distance_m**2 - down_m**2) * ahead + down_m * down
            pixels = project((points @ R)[None], camera)[0]
            u, v = pixels[chosen].tolist()
            width, height = camera.size_px[0].tolist()
            if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
                raise ValueError(
                    f"distances_m: a boat at {distance_m:g} m, {bearing_deg:g} degrees to the right, lies outside the "
                    "camera's picture"
                )
            points_px.append(pixels)
    keypoints_px = torch.stack(points_px)
    count = len(keypoints_px)
    boxes_px = torch.cat([keypoints_px.amin(1), keypoints_px.amax(1)], -1)
    covariance_px2 = keypoint_std_px**2 * torch.eye(2, dtype=torch.float64)
    return Cases(
        keypoints_px,
        covariance_px2.expand(count, keypoints_px.shape[1], 2, 2),
        boxes_px,
        stack_cameras([camera] * count),
        stack_hulls([hull] * count),
    )


def _depth_m(distance_m: float, height_m: float, curved_water: bool) -> float:
    """How far a point of the water at a slant range lies below the camera (see :mod:`usvnet.geometry.water`)."""
    curvature = 1 / (height_m + effective_radius_m(REFRACTION)) if curved_water else 0.0
    return (distance_m**2 * curvature + height_m * (2 - height_m * curvature)) / 2


def _boat_level(hull: Hull, heading_rad: float) -> Tensor:
    """Keypoints (7, 3) of a hull in the directions of the level frame, from amidships."""
    forward, port, up = hull.points_m[0].unbind(-1)
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    return torch.stack([forward * sine - port * cosine, -up, forward * cosine + port * sine], -1)
