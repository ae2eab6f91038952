"""Augmentation that moves the picture, its labels and its camera together, so that a laser range stays true.

One affine matrix A holds zoom and translation: the picture is warped by it, boxes and keypoints are multiplied by it,
the camera becomes K' = A K. A mirror is kept apart, because it also swaps port and starboard. Colours are changed by
lookup tables on uint8.
"""

import dataclasses
import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from usvnet.data.pictures import Picture
from usvnet.data.records import Frame
from usvnet.geometry.camera import flip_camera, scale_matrix, transform_camera
from usvnet.geometry.hull_model import mirror_hull
from usvnet.types import FLIP_INDEX, NEAREST_WATERLINE, WATERLINE_KEYPOINTS

Affine = NDArray[np.float64]
"""(3, 3) pixel to pixel: positive scale on the diagonal, translation in the last column."""

FILL = 114
"""Grey of the padding."""
FOG = 200
"""Grey that fog tends to."""
MIN_AREA_LEFT = 0.2
"""A boat that keeps less of its box than this in the frame is dropped."""


@dataclass(frozen=True)
class AugmentationConfig:
    """How far a training picture is changed. Zero (and a zoom of 1 to 1) turns a change off."""

    mirror: float = 0.5
    """Probability of left for right."""
    zoom: tuple[float, float] = (0.6, 1.6)
    """Smallest and largest scale, drawn evenly on a logarithmic scale."""
    translate: float = 0.15
    """Widest empty border that a shift may open, as a fraction of the frame."""
    hue: float = 0.015
    """Largest shift, as a fraction of the colour circle."""
    saturation: float = 0.5
    """Largest relative change."""
    value: float = 0.4
    """Largest relative change of brightness."""
    fog: float = 0.1
    """Probability of a grey veil."""
    blur: float = 0.05
    """Probability of a Gaussian blur of 0.5 to 1.5 px."""
    noise: float = 0.05
    """Probability of sensor noise, up to 8 grey levels."""

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            ValueError: a value is out of its bounds.
        """
        for name in ("mirror", "translate", "hue", "saturation", "value", "fog", "blur", "noise"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"augmentation.{name} is {getattr(self, name)}, expected 0 to 1")
        if not 0 < self.zoom[0] <= self.zoom[1]:
            raise ValueError(f"augmentation.zoom is {list(self.zoom)}, expected a smallest and a largest scale above 0")


def random_affine(
    config: AugmentationConfig,
    size_px: tuple[int, int],
    rng: np.random.Generator,
    focus_px: NDArray[np.float64] | None = None,
) -> Affine:
    """Draw a zoom and a shift for a frame of ``size_px`` (width, height).

    The picture keeps the frame filled (or, when it shrinks, stays whole), give or take ``translate`` of the frame.
    Within that, ``focus_px`` (a boat's centre) is sent to a place drawn evenly from the frame's middle 70 %: a plain
    zoom about the centre would cut off nearly every boat that is not in the middle.
    """
    zoom = math.exp(rng.uniform(math.log(config.zoom[0]), math.log(config.zoom[1])))
    size = np.array(size_px, np.float64)
    slack = config.translate * size
    low, high = np.minimum(0, size * (1 - zoom)) - slack, np.maximum(0, size * (1 - zoom)) + slack
    if focus_px is None:
        shift = rng.uniform(low, high)
    else:
        shift = (rng.uniform(0.15, 0.85, 2) * size - zoom * focus_px).clip(low, high)
    A = np.diag((zoom, zoom, 1.0))
    A[:2, 2] = (zoom - 1) / 2 + shift  # a picture's upper left corner is at -0.5
    return A


def resize_matrix(size_px: tuple[int, int], target_px: tuple[int, int]) -> Affine:
    """Say where the pixels of a picture of ``size_px`` (width, height) go when it is resized to ``target_px``."""
    return scale_matrix(torch.tensor(size_px, dtype=torch.float64), target_px).numpy()


def warp(picture: Picture, A: Affine, size_px: tuple[int, int]) -> Picture:
    """Show a picture in a frame of ``size_px`` (width, height), its pixel p at A p, grey around it.

    Fine detail would turn into false detail in a picture that shrinks, so it is first halved by averaging while it has
    to shrink by two or more, and then blurred for what is left (Gaussian, of the deviation that the coarser grid asks).
    """
    while max(A[0, 0], A[1, 1]) < 0.51:  # a little more than a half: rounded sizes scale one side by 0.5003
        height, width = picture.shape[:2]
        half_px = ((width + 1) // 2, (height + 1) // 2)
        picture = cv2.resize(picture, half_px, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        A = A @ resize_matrix(half_px, (width, height))
    if picture.shape[1::-1] == size_px and np.allclose(A, np.eye(3), atol=1e-6):
        return picture
    sigma_px = 0.5 * math.sqrt(max(0.0, 1 / (A[0, 0] * A[1, 1]) - 1))
    if sigma_px > 0.2:
        picture = cv2.GaussianBlur(picture, (3, 3), sigma_px).astype(np.uint8, copy=False)
    return cv2.warpAffine(picture, A[:2], size_px, borderValue=(FILL, FILL, FILL)).astype(np.uint8, copy=False)


def move_frame(frame: Frame, A: Affine, size_px: tuple[int, int]) -> Frame:
    """Move camera and labels by A into a frame of ``size_px`` (width, height).

    Boxes are clipped, keypoints that leave the frame get visibility 0, boats that keep less than a fifth of their box
    are dropped, and so is a range whose keypoint has left the frame.
    """
    camera = transform_camera(frame.camera, torch.from_numpy(A), size_px)
    scale, shift = np.diag(A)[:2], A[:2, 2]
    low, high = -0.5, np.array(size_px) - 0.5
    corners = frame.boxes_px.reshape(-1, 2, 2) * scale + shift
    clipped = corners.clip(low, high)
    keep = _areas(clipped) >= MIN_AREA_LEFT * _areas(corners)
    keypoints = frame.keypoints_px * scale + shift
    inside = ((keypoints >= low) & (keypoints <= high)).all(-1)
    lost = (frame.visibility > 0) & ~inside
    waterline_lost = lost[:, list(WATERLINE_KEYPOINTS)].any(-1)  # which of the two was the nearer is not known here
    own_lost = np.take_along_axis(lost, frame.reference.clip(0)[:, None], 1)[:, 0]
    range_lost = np.where(frame.reference == NEAREST_WATERLINE, waterline_lost, own_lost)
    return dataclasses.replace(
        frame,
        camera=camera,
        boxes_px=clipped.reshape(-1, 4)[keep],
        keypoints_px=keypoints[keep],
        visibility=np.where(inside, frame.visibility, 0)[keep],
        range_m=np.where(range_lost, 0.0, frame.range_m)[keep],
        range_std_m=np.where(range_lost, 0.0, frame.range_std_m)[keep],
        reference=frame.reference[keep],
    )


def _areas(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2, 2) low and high corners to (n,) areas."""
    return (corners[:, 1] - corners[:, 0]).prod(-1)


def mirror_picture(picture: Picture) -> Picture:
    """Mirror a picture left for right."""
    return cv2.flip(picture, 1).astype(np.uint8, copy=False)


def mirror_frame(frame: Frame) -> Frame:
    """Mirror camera, hull and labels left for right; port and starboard change places."""
    width, _ = frame.size_px
    boxes = frame.boxes_px.copy()
    boxes[:, [0, 2]] = width - 1 - frame.boxes_px[:, [2, 0]]
    keypoints = frame.keypoints_px[:, list(FLIP_INDEX)].copy()
    keypoints[..., 0] = width - 1 - keypoints[..., 0]
    index = np.array(FLIP_INDEX)
    return dataclasses.replace(
        frame,
        camera=flip_camera(frame.camera),
        hull=mirror_hull(frame.hull),
        boxes_px=boxes,
        keypoints_px=keypoints,
        visibility=frame.visibility[:, index],
        reference=np.where(frame.reference == NEAREST_WATERLINE, NEAREST_WATERLINE, index[frame.reference.clip(0)]),
    )


def change_colours(picture: Picture, config: AugmentationConfig, rng: np.random.Generator) -> Picture:
    """Change hue, saturation and brightness, and now and then add fog, blur or noise."""
    hue, saturation, value = rng.uniform(-1, 1, 3) * (config.hue, config.saturation, config.value)
    levels = np.arange(256)
    hues = (levels + 180 * hue) % 180  # OpenCV counts hue in steps of two degrees
    tables = np.stack((hues, levels * (1 + saturation), levels * (1 + value)), -1).clip(0, 255).astype(np.uint8)
    hsv = cv2.LUT(cv2.cvtColor(picture, cv2.COLOR_RGB2HSV), tables[None])
    changed = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)
    if rng.random() < config.fog:
        veil = rng.uniform(0.1, 0.6)
        changed = cv2.LUT(changed, (levels * (1 - veil) + FOG * veil).astype(np.uint8))
    if rng.random() < config.blur:
        changed = cv2.GaussianBlur(changed, (0, 0), rng.uniform(0.5, 1.5))
    if rng.random() < config.noise:
        grain = rng.standard_normal(picture.shape[:2], np.float32)[..., None] * rng.uniform(1, 8)
        changed = (changed + grain).clip(0, 255)
    return changed.astype(np.uint8, copy=False)
