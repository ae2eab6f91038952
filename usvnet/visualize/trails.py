"""Where followed boats have been: lines on the water, as the picture shows it and as the chart does."""

from itertools import pairwise

import numpy as np
import torch

from usvnet.geometry.camera import camera_to, project
from usvnet.geometry.rays import level_rotation
from usvnet.types import Camera
from usvnet.visualize.canvas import INK, WHITE, FloatArray, Picture, line


def draw_trail(canvas: Picture, places_px: FloatArray, unit: float) -> None:
    """Draw a trail (N, 2), oldest first; what is not finite is left out."""
    for colour, thickness in ((INK, max(2, round(3 * unit))), (WHITE, max(1, round(unit)))):
        for start, end in pairwise(places_px):
            line(canvas, start, end, colour, thickness)


def seen_on_water(trail_m: FloatArray, camera: Camera) -> FloatArray:
    """Pixels (N, 2) of places (N, 2), X and Z on the water, by a camera (a batch of 1); nan behind it."""
    camera = camera_to(camera, dtype=torch.float64)
    x, z = torch.from_numpy(trail_m).unbind(-1)
    level = torch.stack([x, camera.height_m.expand_as(x), z], -1)
    rotation = level_rotation(camera.pitch_rad, camera.roll_rad)[0]
    return np.asarray(project((level @ rotation)[None], camera)[0])  # a row times R is R transposed times the column
