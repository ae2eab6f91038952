"""A small frame to render in tests, with whatever a test wants to be different."""

import math
from typing import Any

from torch import float64

from usvnet.geometry.camera import make_camera
from usvnet.simulator import frame_spec as fs
from usvnet.types import Camera

STRONG_LENS = [-0.30, 0.11, 0.0012, -0.0008, -0.02]


def small_camera(
    size_px: tuple[int, int] = (160, 120), focal_px: float = 190.0, distortion: list[float] | None = None, **mount: Any
) -> Camera:
    width, height = size_px
    K = [[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]]
    mount = {"height_m": 1.5, "pitch_rad": math.radians(6), **mount}
    return make_camera(K, size_px, distortion, dtype=float64, **mount)


def boat(x_m: float = 0.3, y_m: float = 7.0, *, family: fs.HullFamily = "mono", **changes: Any) -> fs.BoatSpec:
    fields: dict[str, Any] = {
        "hull": fs.HullSpec("hull_1", family, changes.pop("length_m", 1.6), changes.pop("hull_seed", 3)),
        "paint_seed": 5,
        "x_m": x_m,
        "y_m": y_m,
        "yaw_rad": 0.6,
        "roll_rad": 0.02,
        "pitch_rad": 0.01,
        "heave_m": 0.0,
        "speed_mps": 0.0,
    }
    return fs.BoatSpec(**{**fields, **changes})


def frame(**changes: Any) -> fs.FrameSpec:
    """A sunny day, one boat 7 m away, trees at 80 m."""
    fields: dict[str, Any] = {
        "number": 0,
        "split": "train",
        "scene": "I",
        "camera_name": "cam",
        "camera": small_camera(),
        "measured_pitch_deg": 6.0,
        "measured_roll_deg": 0.0,
        "attitude_std_deg": 0.05,
        "shutter": fs.ShutterSpec(),
        "sky": fs.SkySpec("clear", 2.0, 0.6, 5.0, 2.5, 0.3, 1),
        "air": fs.AirSpec(20_000.0, 0.0),
        "sea": fs.SeaSpec(0.05, 2.0, 0.4, 0.01, 6.0, 0.0, (0.012, 0.024, 0.028), 2),
        "shore": fs.ShoreSpec("trees", 80.0, 4),
        "clutter": (),
        "boats": (boat(),),
        "sensor": fs.SensorSpec(0.2, 0.0008, 0.5, 90, 7),
        "laser_std_m": 0.01,
        "has_laser": True,
    }
    return fs.FrameSpec(**{**fields, **changes})
