"""Where a frame's camera sees the water: for fog, glare and pasted boats, through a lens taken as perfect."""

import numpy as np
from numpy.typing import NDArray

from usvnet.types import Camera


def depression_sine(camera: Camera, u: NDArray[np.floating], v: NDArray[np.floating]) -> NDArray[np.float32]:
    """Sine of the angle below the horizontal of the ray through pixel (u, v), broadcast; 0 at the horizon.

    The water lies ``height_m`` over this sine away. Row Y of Rx(pitch) Rz(roll), without the lens's distortion.
    """
    K, pitch, roll = camera.K[0].double().numpy(), float(camera.pitch_rad[0]), float(camera.roll_rad[0])
    x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    down = np.cos(pitch) * (np.sin(roll) * x + np.cos(roll) * y) + np.sin(pitch)
    return (down / np.sqrt(x * x + y * y + 1)).astype(np.float32)


def horizon_row(camera: Camera, u: float) -> float:
    """Row of the horizon in column ``u``: there the sine is 0."""
    K, pitch, roll = camera.K[0].double().numpy(), float(camera.pitch_rad[0]), float(camera.roll_rad[0])
    y = -(np.tan(pitch) + np.sin(roll) * (u - K[0, 2]) / K[0, 0]) / np.cos(roll)
    return float(K[1, 2] + K[1, 1] * y)
