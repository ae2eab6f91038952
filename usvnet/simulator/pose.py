"""How boats and the camera stand in the world frame (x right, y forward, z up)."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import BoatSpec
from usvnet.types import Camera

Doubles = NDArray[np.float64]
HeightAt = Callable[[NDArray, NDArray], NDArray]
"""Height (m) of the drawn water at x and y; NaN where no water is drawn."""

LEVEL_FROM_WORLD = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""World axes (right, forward, up) to the level frame's (right, down, forward)."""
FEWEST_HEIGHTS = 6
"""A plane through the water under a boat wants at least so many of its samples inside the drawn water."""


class Pose(NamedTuple):
    """Where a hull is."""

    rotation: Doubles
    """(3, 3) from the hull frame to the world frame."""
    origin_m: Doubles
    """(3,)"""
    yaw_rad: float
    pitch_rad: float
    roll_rad: float

    def to_world(self, points_m: Doubles) -> Doubles:
        """Move points (..., 3) of the hull frame to the world frame."""
        return points_m @ self.rotation.T + self.origin_m


def eye_of(camera: Camera) -> Doubles:
    """The optical centre (3,) in the world frame."""
    return np.array([0.0, 0.0, float(camera.height_m[0])])


def camera_from_world(camera: Camera) -> Doubles:
    """Rotation (3, 3) from the world frame to the camera frame: the inverse of Rx(pitch) Rz(roll)."""
    pitch, roll = float(camera.pitch_rad[0]), float(camera.roll_rad[0])
    c, s = math.cos(pitch), math.sin(pitch)
    tilt = np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    c, s = math.cos(roll), math.sin(roll)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    rotation: Doubles = (tilt @ turn).T @ LEVEL_FROM_WORLD
    return rotation


def hull_rotation(yaw_rad: float, pitch_rad: float, roll_rad: float) -> Doubles:
    """Rotation (3, 3) from the hull frame: rolled to starboard, then bow up, then turned from world x to the left."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    yaw = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    c, s = math.cos(pitch_rad), math.sin(pitch_rad)
    pitch = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    c, s = math.cos(roll_rad), math.sin(roll_rad)
    roll = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    rotation: Doubles = yaw @ pitch @ roll
    return rotation


def float_boat(spec: BoatSpec, length_m: float, beam_m: float, height_at: HeightAt) -> Pose:
    """Lay a boat of some length and beam on the plane that fits the water under it best, and add its own motion.

    A boat is moved by waves longer than itself and rides through the short ones, which is what a least-squares plane
    under its waterline does.
    """
    places = np.meshgrid(np.linspace(-0.45, 0.45, 9) * length_m, np.linspace(-0.4, 0.4, 3) * beam_m, indexing="ij")
    along, across = (place.ravel() for place in places)
    c, s = math.cos(spec.yaw_rad), math.sin(spec.yaw_rad)
    heights = height_at(spec.x_m + c * along - s * across, spec.y_m + s * along + c * across)
    drawn = np.isfinite(heights)
    heave, bow_up, port_up = 0.0, 0.0, 0.0
    if drawn.sum() >= FEWEST_HEIGHTS:
        plane = np.stack([np.ones(drawn.sum()), along[drawn], across[drawn]], -1)
        heave, bow_up, port_up = np.linalg.lstsq(plane, heights[drawn], rcond=None)[0]
    pitch = spec.pitch_rad + math.atan(bow_up)
    roll = spec.roll_rad + math.atan(port_up)
    origin = np.array([spec.x_m, spec.y_m, heave + spec.heave_m])
    return Pose(hull_rotation(spec.yaw_rad, pitch, roll), origin, spec.yaw_rad, pitch, roll)
