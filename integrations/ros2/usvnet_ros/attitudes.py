"""Pitch and roll of the camera from sensor_msgs/Imu."""

from collections import deque
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

KEPT = 1000
"""Messages kept: five seconds at 200 a second."""


class CameraAttitude(NamedTuple):
    """In the conventions of usvnet: pitch above 0 looks down, roll above 0 is clockwise seen from behind."""

    pitch_rad: float
    roll_rad: float
    pitch_std_rad: float | None
    """None where the message does not say."""
    roll_std_rad: float | None


def camera_attitude(imu: Any, camera_from_imu: Any) -> CameraAttitude | None:
    """Pitch and roll of a camera that turns with an IMU.

    The orientation of the message turns the IMU's axes into those of a world whose z points up (REP-103, REP-145); yaw
    does not matter. Its covariance is taken about the IMU's own axes, to first order. In the optical frame (x right, y
    down, z forward) the direction of gravity is (sin(roll) cos(pitch), cos(roll) cos(pitch), sin(pitch)).

    Args:
        imu: sensor_msgs/Imu.
        camera_from_imu: geometry_msgs/Quaternion that turns the IMU's axes into those of the optical frame, as tf2
            looks it up.

    Returns:
        None where the message has no orientation (its first covariance is -1, or its quaternion is zero).
    """
    world = _xyzw(imu.orientation)
    covariance = np.asarray(imu.orientation_covariance, np.float64).reshape(3, 3)
    if covariance[0, 0] < 0 or not np.linalg.norm(world) > 0.5:
        return None
    turn = Rotation.from_quat(_xyzw(camera_from_imu)).as_matrix()
    down = turn @ Rotation.from_quat(world).inv().apply([0.0, 0.0, -1.0])
    x, y, z = down
    pitch, roll = float(np.arcsin(np.clip(z, -1, 1))), float(np.arctan2(x, y))
    if not covariance.any():
        return CameraAttitude(pitch, roll, None, None)
    moved = np.cross(np.eye(3), down)  # row k: what a small turn about axis k does to gravity, its sign apart
    level = max(x * x + y * y, 1e-12)
    J = np.array([[0, 0, 1 / np.sqrt(level)], [y / level, -x / level, 0]]) @ moved.T
    variance = np.diag(J @ turn @ covariance @ turn.T @ J.T)
    pitch_std, roll_std = np.sqrt(np.maximum(variance, 0))
    return CameraAttitude(pitch, roll, float(pitch_std), float(roll_std))


class ImuMessages:
    """The latest messages of an IMU, to find the one that was taken with an image."""

    def __init__(self) -> None:
        self.messages: deque[Any] = deque(maxlen=KEPT)

    def add(self, imu: Any) -> None:
        """Keep a message; another thread may look for one meanwhile."""
        self.messages.append(imu)

    def nearest(self, stamp: Any, max_gap_s: float) -> Any | None:
        """The message nearest to a builtin_interfaces/Time; None where none is within ``max_gap_s`` of it."""
        time_s = seconds(stamp)
        near = min(list(self.messages), key=lambda imu: abs(seconds(imu.header.stamp) - time_s), default=None)
        return near if near is not None and abs(seconds(near.header.stamp) - time_s) <= max_gap_s else None


def seconds(stamp: Any) -> float:
    """A builtin_interfaces/Time as seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def _xyzw(quaternion: Any) -> np.ndarray:
    return np.array([quaternion.x, quaternion.y, quaternion.z, quaternion.w], np.float64)
