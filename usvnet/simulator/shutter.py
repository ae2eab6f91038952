"""How a camera turns while it takes a picture.

A camera that turns by the rotation vector w t from the middle of the exposure to time t shows a point p (camera frame
at time 0) where exp([w] t)^T p projects. With rates of nose down, right and clockwise, w = (-pitch, yaw, roll).
"""

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import ShutterSpec

Doubles = NDArray[np.float64]


def turn_of(shutter: ShutterSpec) -> Doubles:
    """Rotation vector (3,) in a second, camera frame; 0 where the shutter is too quick to see any."""
    if not (shutter.exposure_s or shutter.readout_s):
        return np.zeros(3)
    return np.array([-shutter.pitch_rate_rad_s, shutter.yaw_rate_rad_s, shutter.roll_rate_rad_s])


def rotations(turn_rad_s: Doubles, time_s: Doubles) -> Doubles:
    """Rotations (N, 3, 3) from the camera frame at moments (N,) to that of mid-exposure (Rodrigues)."""
    rate = float(np.linalg.norm(turn_rad_s))
    x, y, z = turn_rad_s / rate if rate else np.zeros(3)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = (rate * time_s)[:, None, None]
    turned: Doubles = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
    return turned
