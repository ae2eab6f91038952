"""The error budget of the camera that took most pictures of a dataset."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import torch

from usvnet.data.records import Frame
from usvnet.evaluation.scenario_boats import scenario_cases
from usvnet.evaluation.sensitivity import Cost, Study
from usvnet.evaluation.sensitivity_settings import SensitivitySettings
from usvnet.types import Camera, Hull

DISTANCES_M = (3.0, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0)
FAR_READINGS = 1.5
"""Distances go that far beyond the farthest reading."""
CURVES: dict[str, tuple[float, ...]] = {
    "pitch_deg": (0.1, 0.3, 1.0),
    "roll_deg": (0.3, 1.0, 3.0),
    "height_m": (0.02, 0.05, 0.1),
    "focal_px": (5.0, 20.0, 50.0),
    "wave_m": (0.02, 0.05, 0.1),
    "keypoint_px": (0.5, 1.0, 2.0),
}
KEYPOINT_STD_PX = 1.0
"""To first order the cost grows with it; how far keypoints truly stray depends on the distance."""


class CameraStudy(NamedTuple):
    """What was looked at and what it costs."""

    camera: str
    """The camera in words."""
    budget: list[Cost]
    curves: list[Cost]


def study_commonest_camera(frames: Sequence[Frame], curved_water: bool = False) -> CameraStudy | None:
    """Work out what each thing that is not known exactly costs in range, for boats where the dataset has them.

    Attitude and sigmas are the medians over the camera's pictures, the hull is that of the first of them.

    Args:
        frames: of the dataset.
        curved_water: as the predictions were made.

    Returns:
        None where there is no picture, or no distance at which the camera sees the water.
    """
    keys = [_identity(frame.camera) for frame in frames]
    if not keys:
        return None
    commonest, count = Counter(keys).most_common(1)[0]
    members = [frame for frame, key in zip(frames, keys) if key == commonest]
    camera, hull = _median_camera([frame.camera for frame in members]), members[0].hull
    bearing_deg = min(10.0, _half_view_deg(camera) / 2)
    distances_m = _seen_distances(camera, hull, bearing_deg, max((r for f in frames for r in f.range_m), default=0.0))
    if not distances_m:
        return None
    settings = SensitivitySettings(
        CURVES,
        distances_m=distances_m,
        bearing_deg=bearing_deg,
        keypoint_std_px=KEYPOINT_STD_PX,
        curved_water=curved_water,
    )
    study = Study(settings, camera, hull)
    told = _words(camera) + (f", which took {count} of {len(frames)} pictures" if count < len(frames) else "")
    return CameraStudy(told, study.budget(), study.curves())


def _identity(camera: Camera) -> tuple[float, ...]:
    return tuple(torch.cat([camera.K.flatten(), camera.distortion[0], camera.size_px[0], camera.height_m]).tolist())


def _median_camera(cameras: Sequence[Camera]) -> Camera:
    first = cameras[0]
    fields = (
        *("pitch_rad", "roll_rad", "focal_std_px", "height_std_m"),
        *("pitch_std_rad", "roll_std_rad", "wave_std_m"),
    )
    return first._replace(**{name: torch.cat([getattr(c, name) for c in cameras]).median()[None] for name in fields})


def _half_view_deg(camera: Camera) -> float:
    return math.degrees(math.atan(float(camera.size_px[0, 0] / (2 * camera.K[0, 0, 0]))))


def _seen_distances(camera: Camera, hull: Hull, bearing_deg: float, farthest_m: float) -> tuple[float, ...]:
    limit_m = FAR_READINGS * farthest_m if farthest_m > 0 else 50.0
    seen = []
    for distance_m in DISTANCES_M:
        try:
            scenario_cases(camera, hull, [distance_m], [0.0], bearing_deg)
        except ValueError:  # outside the picture
            continue
        seen.append(distance_m)
    return tuple(distance for distance in seen if distance <= max(limit_m, seen[0]))


def _words(camera: Camera) -> str:
    width, height = (int(side) for side in camera.size_px[0])
    pitch_deg, roll_deg = (math.degrees(float(angle[0])) for angle in (camera.pitch_rad, camera.roll_rad))
    return (
        f"{width} x {height} px, focal length {float(camera.K[0, 1, 1]):.0f} px, {float(camera.height_m[0]):.2f} m "
        f"above the water, pitch {pitch_deg:.1f} and roll {roll_deg:.1f} degrees"
    )
