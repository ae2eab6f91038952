"""Where the sea ends, as the camera's attitude has it: a look tells whether pitch and roll are right."""

import numpy as np
import torch

from usvnet.geometry.camera import camera_to
from usvnet.geometry.horizon import edge_px, sea_horizon
from usvnet.types import Camera
from usvnet.visualize.canvas import INK, WHITE, FloatArray, Picture, around, line, text, text_size, translucent

POINTS = 41
WIDEST_RAD = 1.4
"""Azimuth up to which the horizon is followed to either side."""


def horizon_px(camera: Camera) -> FloatArray:
    """Pixels (P, 2) of the sea's horizon, from left to right, that one camera (a batch of 1) has; bent by its lens."""
    camera = camera_to(camera, dtype=torch.float64)
    azimuth = torch.linspace(-WIDEST_RAD, WIDEST_RAD, 8 * POINTS, dtype=torch.float64)
    points = edge_px(camera, sea_horizon(camera).depression_rad, azimuth.unsqueeze(0))[0].numpy()
    width = float(camera.size_px[0, 0])
    near = np.isfinite(points).all(axis=1) & (np.abs(points[:, 0] - width / 2) < width)
    return np.asarray(points[near], np.float64)


def draw_horizon(canvas: Picture, camera: Camera, unit: float) -> None:
    """Draw the horizon of a camera that is the canvas's, dashed, with its name.

    Args:
        canvas: (H, W, 3) RGB.
        camera: one (a batch of 1), scaled to the canvas.
        unit: thickness of what is thin.
    """
    points = horizon_px(camera)
    height, width = canvas.shape[:2]
    if len(points) < 2:
        return
    dash = 14 * unit
    lengths = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    starts = np.arange(0, lengths[-1], 2 * dash)
    begin, end = (_along(points, lengths, starts + offset) for offset in (0.0, dash))
    inside = (begin[:, 0] > -dash) & (end[:, 0] < width + dash) & (begin[:, 1] > -dash) & (begin[:, 1] < height + dash)
    begin, end = begin[inside], end[inside]
    if not len(begin):
        return
    thin = max(1, round(1.2 * unit))
    with translucent(canvas, 0.6, around(np.concatenate([begin, end]), 2 * thin)):
        for a, b in zip(begin, end):
            line(canvas, a + 0.8 * thin, b + 0.8 * thin, INK, thin)
        for a, b in zip(begin, end):
            line(canvas, a, b, WHITE, thin)
    scale = 0.42 * unit
    _, letters = text_size("horizon", scale)
    left = begin[np.argmin(np.abs(begin[:, 0] - 10 * unit))]
    place = (round(10 * unit), round(left[1] - 0.6 * letters))
    if letters < place[1] < height:
        text(canvas, "horizon", (place[0] + 1, place[1] + 1), scale, INK)
        text(canvas, "horizon", place, scale, WHITE)


def _along(points: FloatArray, lengths: FloatArray, at: FloatArray) -> FloatArray:
    """Points (N, 2) of a line at lengths (N,) from its beginning."""
    return np.stack([np.interp(at, lengths, points[:, axis]) for axis in (0, 1)], axis=1)
