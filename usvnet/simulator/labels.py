"""What is true of every boat in a picture, from the same hull, water and Camera that drew it."""

import math

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.air import extinction_per_m
from usvnet.simulator.frame_spec import AirSpec, BoatSpec
from usvnet.simulator.hulls.hull import Hull
from usvnet.simulator.optics import Optics
from usvnet.simulator.pose import HeightAt, Pose, camera_from_world, eye_of
from usvnet.simulator.rendered import BoatTruth
from usvnet.simulator.scene import Scene
from usvnet.types import Camera

Doubles = NDArray[np.float64]

HIDDEN_BEHIND = 0.022
"""A keypoint counts as hidden when something stands before it by more than this share of the hull's length."""
FEWEST_SEEN_PX = 9
"""A boat of which fewer pixels show is not labelled: nobody could."""
FAINTEST = 0.05
"""A boat whose contrast the air takes beyond this share is not labelled either (the WMO's limit of visibility)."""
LASER_AIM = 0.35
"""Share of the freeboard, above the resting waterline, at which the laser aims."""
BISECTIONS = 50


def waterline_point(curve_m: Doubles, height_at: HeightAt) -> Doubles:
    """Where a curve (n, 3), upward through the water, crosses the drawn surface: (3,), to float64 precision.

    The curve goes on straight down and up beyond its ends, so that a stem that a trough lays bare still has the point
    of the water below it.
    """
    ends = np.array([[0, 0, -3.0], [0, 0, 3.0]])
    curve = np.concatenate([curve_m[:1] + ends[:1], curve_m, curve_m[-1:] + ends[1:]])
    above = curve[:, 2] - height_at(curve[:, 0], curve[:, 1]) > 0
    rising = np.nonzero(~above[:-1] & above[1:])[0]
    if not len(rising):
        return np.full(3, np.nan)  # outside the drawn water
    low, high = curve[rising[-1]], curve[rising[-1] + 1]
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        dry = middle[2] > height_at(middle[:1], middle[1:2])[0]
        low, high = (low, middle) if dry else (middle, high)
    point: Doubles = (low + high) / 2
    return point


def keypoints_in_world(hull: Hull, pose: Pose, height_at: HeightAt) -> Doubles:
    """The seven keypoints (7, 3) in the world frame, the two waterline points on the drawn water."""
    points = pose.to_world(hull.keypoints_m)
    points[3] = waterline_point(pose.to_world(hull.stem_curve_m), height_at)
    points[6] = waterline_point(pose.to_world(hull.stern_curve_m), height_at)
    return points


def label_boat(
    spec: BoatSpec, hull: Hull, pose: Pose, seen: NDArray[np.bool_], scene: Scene, camera: Camera, optics: Optics,
    height_at: HeightAt, air: AirSpec,
) -> BoatTruth | None:  # fmt: skip
    """Everything true of one boat, or None where too little of it can be seen to be labelled.

    Args:
        spec: what was asked for.
        hull: its shape.
        pose: where it floats.
        seen: (s H, s W) the sub-pixels of the picture that show it, s along each side of a pixel.
        scene: what rays can meet.
        camera: the camera in the middle of the exposure.
        optics: its lens and shutter.
        height_at: the drawn water.
        air: what the boat is seen through.
    """
    fine = seen.shape[0] // optics.height
    rows, columns = np.nonzero(seen)
    seen_px = len(rows) / fine**2
    eye = eye_of(camera)
    contrast = math.exp(-extinction_per_m(air) * float(np.linalg.norm(pose.origin_m - eye)))
    if seen_px < FEWEST_SEEN_PX or contrast < FAINTEST:
        return None
    box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]) / fine - 0.5
    keypoints = keypoints_in_world(hull, pose, height_at)
    pixels = optics.project((keypoints - eye) @ camera_from_world(camera).T)
    waterline = keypoints[[3, 6]]
    laser = _laser(hull, pose, eye, scene)
    size_px = (optics.width, optics.height)
    return BoatTruth(
        spec=spec,
        box_px=box,
        keypoints_px=pixels,
        visibility=_visibility(keypoints, pixels, eye, hull.length_m, scene, size_px),
        keypoints_m=keypoints,
        hull_keypoints_m=hull.keypoints_m,
        water_height_m=waterline[:, 2],
        origin_m=pose.origin_m,
        yaw_rad=pose.yaw_rad,
        pitch_rad=pose.pitch_rad,
        roll_rad=pose.roll_rad,
        slant_m=np.linalg.norm(waterline - eye, axis=1),
        horizontal_m=np.hypot(waterline[:, 0], waterline[:, 1]),
        laser_hit_m=laser,
        laser_on_boat=_on_boat(laser, hull, pose),
        seen_px=round(seen_px),
        truncated=_truncated(hull, pose, camera, optics, size_px),
    )


def _visibility(
    keypoints: Doubles, pixels: Doubles, eye: Doubles, length_m: float, scene: Scene, size_px: tuple[int, int]
) -> NDArray[np.int64]:
    width, height = size_px
    with np.errstate(invalid="ignore"):  # points without a pixel are NaN, and outside
        inside = (pixels > -0.5).all(1) & (pixels[:, 0] < width - 0.5) & (pixels[:, 1] < height - 0.5)
    visibility = np.zeros(len(keypoints), np.int64)
    if not inside.any():  # no ray at all is one too few for the renderer
        return visibility
    rays = keypoints[inside] - eye
    distance = np.linalg.norm(rays, axis=1)
    clear = scene.distance(eye, rays / distance[:, None]) > distance - HIDDEN_BEHIND * length_m
    visibility[inside] = np.where(clear, 2, 1)
    return visibility


def _laser(hull: Hull, pose: Pose, eye: Doubles, scene: Scene) -> Doubles:
    aim = pose.to_world(np.array([0, 0, LASER_AIM * hull.freeboard_m])) - eye
    aim /= np.linalg.norm(aim)
    distance = float(scene.distance(eye, aim[None])[0])
    return eye + aim * distance if math.isfinite(distance) else np.full(3, np.nan)


def _on_boat(point: Doubles, hull: Hull, pose: Pose) -> bool:
    """Whether a point lies on a triangle of the boat."""
    if not np.isfinite(point).all():
        return False
    a, b, c = np.moveaxis(pose.to_world(hull.mesh.vertices_m.astype(np.float64))[hull.mesh.faces], 1, 0)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    real = area > 0
    a, b, c, normal, area = a[real], b[real], c[real], normal[real], area[real]
    off_plane = np.abs(np.einsum("ij,ij->i", point - a, normal)) / area
    parts = [np.linalg.norm(np.cross(p - point, q - point), axis=1) for p, q in ((a, b), (b, c), (c, a))]
    inside = sum(parts) <= area * (1 + 1e-3) + 1e-9  # barycentric areas of a point inside add up to the whole
    tolerance = 1e-4 * hull.length_m + 1e-5 * float(np.linalg.norm(point))
    return bool((inside & (off_plane < tolerance)).any())


def _truncated(hull: Hull, pose: Pose, camera: Camera, optics: Optics, size_px: tuple[int, int]) -> bool:
    corners = hull.mesh.vertices_m
    extremes = corners[np.unique(np.concatenate([corners.argmin(0), corners.argmax(0)]))].astype(np.float64)
    points = np.concatenate([extremes, hull.keypoints_m])
    pixels = optics.project((pose.to_world(points) - eye_of(camera)) @ camera_from_world(camera).T)
    outside = ~((pixels > -0.5) & (pixels < np.array(size_px) - 0.5)).all(1)
    return bool(outside.any())
