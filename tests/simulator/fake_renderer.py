"""A renderer of milliseconds: flat pictures with exact labels, and the misfortunes of a real one on demand.

Workers find it by its dotted name; the environment tells it which frames fail or kill their process.
"""

import math
import os
import signal
import time
from pathlib import Path

import cv2
import numpy as np
import torch

from usvnet.geometry.camera import project
from usvnet.geometry.rays import level_rotation
from usvnet.simulator.frame_spec import BoatSpec, FrameSpec
from usvnet.simulator.rendered import BoatTruth, RenderedFrame

HULL = np.array(
    [
        *([0.5, 0, 0.2], [0.4, 0.15, 0.2], [0.4, -0.15, 0.2], [0.48, 0, 0]),
        *([-0.5, 0.15, 0.2], [-0.5, -0.15, 0.2], [-0.5, 0, 0]),
    ]
)
"""Keypoints of a boat of one metre."""


def render_frame(spec: FrameSpec, quality: str) -> RenderedFrame:
    """Draw the boxes of the boats on a plain ground."""
    if spec.number in numbers_in("FAKE_FAILS"):
        raise RuntimeError("the paint\nis not dry")
    if spec.number in numbers_in("FAKE_DIES"):
        if "FAKE_LEAVES" in os.environ:
            Path(os.environ["FAKE_LEAVES"]).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(float(os.environ.get("FAKE_SECONDS", "0")))
    width, height = (int(size) for size in spec.camera.size_px[0])
    rng = np.random.default_rng(spec.sensor.seed)
    small = rng.integers(60, 200, (8, 8, 3)).astype(np.uint8)
    picture = cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR)
    boats = [truth for boat in spec.boats if (truth := label(boat, spec)) is not None]
    for truth in boats:
        x1, y1, x2, y2 = np.round(truth.box_px).astype(int)
        picture[max(y1, 0) : y2 + 1, max(x1, 0) : x2 + 1] = (200, 60, 40)
    return RenderedFrame(spec, picture, tuple(boats), sea_height_std_m=0.01, seconds={"drawing": 0.001})


def numbers_in(variable: str) -> set[int]:
    return {int(word) for word in os.environ.get(variable, "").split()}


def label(boat: BoatSpec, spec: FrameSpec) -> BoatTruth | None:
    """A hull of simple shape on water that stands 3 cm high at its bow and 1 cm low at its stern."""
    hull = HULL * boat.hull.length_m
    c, s = math.cos(boat.yaw_rad), math.sin(boat.yaw_rad)
    world = hull @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + [boat.x_m, boat.y_m, 0]
    world[[3, 6], 2] = 0.03, -0.01
    camera = spec.camera
    eye = np.array([0, 0, camera.height_m.item()])
    level = (world - eye) @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]).T
    rotation = level_rotation(camera.pitch_rad, camera.roll_rad)[0].numpy()
    pixels = project(torch.from_numpy(level @ rotation)[None], camera)[0].numpy()
    size = camera.size_px[0].numpy()
    inside = ((pixels >= -0.5) & (pixels <= size - 0.5)).all(1)
    if inside.sum() < 2:
        return None
    box = np.concatenate([pixels[inside].min(0) - 0.2, pixels[inside].max(0) + 0.2])
    waterline = world[[3, 6]]
    return BoatTruth(
        spec=boat,
        box_px=box.reshape(2, 2).clip(-0.5, size - 0.5).reshape(4),
        keypoints_px=pixels,
        visibility=np.where(inside, 2, 0),
        keypoints_m=world,
        hull_keypoints_m=hull,
        water_height_m=waterline[:, 2],
        origin_m=np.array([boat.x_m, boat.y_m, 0.0]),
        yaw_rad=boat.yaw_rad,
        pitch_rad=0.0,
        roll_rad=0.0,
        slant_m=np.linalg.norm(waterline - eye, axis=1),
        horizontal_m=np.hypot(*waterline[:, :2].T),
        laser_hit_m=np.full(3, np.nan) if spec.number % 5 == 0 else np.array([boat.x_m, boat.y_m - 0.1, 0.1]),
        laser_on_boat=spec.number % 5 != 0,
        seen_px=40,
        truncated=bool((~inside).any()),
    )
