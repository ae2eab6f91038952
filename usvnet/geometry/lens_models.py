"""Which lenses of ROS and OpenCV there are plumb-bob coefficients for: their own, or the nearest of a rational lens."""

from collections.abc import Sequence

import numpy as np
from torch import Tensor

LENS_MODELS = ("plumb_bob", "rational_polynomial")
"""ROS names of the lenses that are read."""
MOST_ERROR_PX = 0.25
"""Largest difference between a rational lens and the plumb bob that takes its place."""
WIDEST = 4.0
"""How far from the axis a rational lens is looked at, on the plane z = 1: 76 degrees."""


def plumb_bob(coefficients: Sequence[float], K: Tensor, size_px: Sequence[float], where: str) -> list[float]:
    """The plumb-bob coefficients k1, k2, p1, p2, k3 of a lens that ROS or OpenCV describes.

    A rational lens (k1, k2, p1, p2, k3, k4, k5, k6) scales a point at the radius r by
    g = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6); its p1 and p2 are those of a plumb bob. Least
    squares over the picture's area find the k1, k2, k3 that come nearest to g.

    Args:
        coefficients: 4, 5, 8, 12 or 14 of them, in the order of ROS and OpenCV.
        K: (3, 3) pinhole matrix, pixels.
        size_px: width and height of the picture.
        where: names the file and key, or the message, in the error.

    Raises:
        ValueError: another number of coefficients, a lens with a thin prism or a tilted sensor, or a rational one that
            no plumb bob resembles within MOST_ERROR_PX.
    """
    if len(coefficients) not in (4, 5, 8, 12, 14):
        expected = "4 or 5 numbers (k1, k2, p1, p2, k3), or 8 of a rational polynomial"
        raise ValueError(f"{where}: expected {expected}, got {len(coefficients)}")
    if any(coefficients[8:]):
        found = ", ".join(f"{value:g}" for value in coefficients[8:])
        raise ValueError(f"{where}: expected zeros after the eighth (thin prism, tilted sensor), got {found}")
    if not any(coefficients[5:8]):
        return list(coefficients[:5])

    k1, k2, p1, p2, k3, k4, k5, k6 = coefficients[:8]
    focal = np.array([float(K[0, 0]), float(K[1, 1])])
    centre = np.array([float(K[0, 2]), float(K[1, 2])])
    edges = (np.array([[-0.5, -0.5], np.asarray(size_px) - 0.5]) - centre) / focal
    corner = np.hypot(*np.abs(edges).max(axis=0))  # the farthest place in the picture, distorted

    radius = np.linspace(0, WIDEST, 4001)
    square = radius**2
    with np.errstate(all="ignore"):  # what is not finite counts as folded
        scale = (1 + square * (k1 + square * (k2 + square * k3))) / (1 + square * (k4 + square * (k5 + square * k6)))
        shown = radius * scale
        folds = np.flatnonzero(~(np.diff(shown) > 0))  # from there on the lens shows nothing new
    end = folds[0] + 1 if len(folds) else len(shown)
    if shown[end - 1] < corner:
        raise ValueError(f"{where}: expected a lens that shows the whole picture, but this one folds over inside it")
    seen = np.interp(corner * np.sqrt(np.linspace(0, 1, 500)), shown[:end], radius[:end])
    moved = np.interp(seen, radius[:end], shown[:end]) - seen
    powers = seen[:, None] ** (3, 5, 7)
    radial, *_ = np.linalg.lstsq(powers, moved, rcond=None)
    error_px = float(np.abs(powers @ radial - moved).max() * focal.max())
    if not error_px <= MOST_ERROR_PX:
        raise ValueError(
            f"{where}: expected a lens that five coefficients describe within {MOST_ERROR_PX} px, but they miss this "
            f"rational one by {error_px:.1f} px; calibrate again with five, or take rectified pictures"
        )
    return [float(radial[0]), float(radial[1]), p1, p2, float(radial[2])]
