"""Moving a picture, its labels and its camera together, so that a laser range stays true.

A picture is warped by one affine matrix from its own pixels to the new frame's, and boxes, keypoints and camera follow
it: :func:`move_frame` for scale and shift, :func:`turn_frame` for a turn about the optical axis, :func:`mirror_frame`
for left and right.
"""

import dataclasses
import math
from functools import lru_cache

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from usvnet.data.pictures import Picture
from usvnet.data.records import Frame
from usvnet.geometry.camera import (
    flip_camera,
    letterbox_matrix,
    scale_matrix,
    transform_camera,
    turn_camera,
)
from usvnet.geometry.hull_model import mirror_hull
from usvnet.types import FLIP_INDEX, NEAREST_WATERLINE, WATERLINE_KEYPOINTS

Affine = NDArray[np.float64]
"""(3, 3) pixel to pixel."""

FILL = 114
"""Grey of the padding."""
MIN_AREA_LEFT = 0.2
"""A boat that keeps less of its box than this in the frame is dropped."""
GRID_PX = 4
"""Parts of pictures are cut out along this grid."""


@lru_cache(maxsize=64)
def resize_matrix(size_px: tuple[int, int], target_px: tuple[int, int]) -> Affine:
    """Say where the pixels of a picture of ``size_px`` (width, height) go when it is resized to ``target_px``."""
    return _constant(scale_matrix(torch.tensor(size_px, dtype=torch.float64), target_px))


@lru_cache(maxsize=64)
def fit_matrix(size_px: tuple[int, int], target_px: tuple[int, int]) -> Affine:
    """Say where the pixels of a picture of ``size_px`` go when it is fitted whole into the middle of ``target_px``."""
    return _constant(letterbox_matrix(torch.tensor(size_px, dtype=torch.float64), target_px))


def _constant(matrix: torch.Tensor) -> Affine:
    """Make an array that may be kept: nobody can change it."""
    array = matrix.numpy()
    array.setflags(write=False)
    return array


def warp(picture: Picture, A: Affine, size_px: tuple[int, int]) -> Picture:
    """Show a picture in a frame of ``size_px`` (width, height), its pixel p at A p, grey around it.

    Fine detail would turn into false detail in a picture that shrinks, so it is first halved by averaging while it has
    to shrink by two or more, and then blurred for what is left (Gaussian, of the deviation that the coarser grid asks).
    Only the part that the frame shows is looked at.
    """
    picture, A = _part_shown(picture, A, size_px)
    # not below 0.5: rounded sizes scale one side by 0.5003; and a row of pixels outside the frame cannot be halved
    while np.linalg.norm(A[:2, :2], axis=0).max() < 0.51 and min(picture.shape[:2]) > 1:
        height, width = picture.shape[:2]
        half_px = ((width + 1) // 2, (height + 1) // 2)
        picture = cv2.resize(picture, half_px, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        A = A @ resize_matrix(half_px, (width, height))
    if picture.shape[1::-1] == size_px and np.allclose(A, np.eye(3), atol=1e-6):
        return picture
    sigma_px = 0.5 * math.sqrt(max(0.0, 1 / abs(np.linalg.det(A[:2, :2])) - 1))
    if sigma_px > 0.2:
        picture = cv2.GaussianBlur(picture, (3, 3), sigma_px).astype(np.uint8, copy=False)
    return cv2.warpAffine(picture, A[:2], size_px, borderValue=(FILL, FILL, FILL)).astype(np.uint8, copy=False)


def _part_shown(picture: Picture, A: Affine, size_px: tuple[int, int]) -> tuple[Picture, Affine]:
    """Cut out what the frame shows, with a border for averaging and blurring, and say where its pixels go.

    From and to a multiple of ``GRID_PX``, so that the part can be halved twice: odd sides take OpenCV ten times longer.
    """
    height, width = picture.shape[:2]
    u, v = size_px
    corners = np.linalg.inv(A)[:2] @ np.array([[-1, u, -1, u], [-1, -1, v, v], [1, 1, 1, 1]])
    border = 4 / math.sqrt(abs(np.linalg.det(A[:2, :2])))
    low = np.floor((corners.min(1) - border) / GRID_PX).astype(int) * GRID_PX
    low = low.clip(0, (width - 1, height - 1))
    high = np.ceil((corners.max(1) + border) / GRID_PX).astype(int) * GRID_PX
    high = high.clip(low + 1, (width, height))
    shift = np.eye(3)
    shift[:2, 2] = low
    return picture[low[1] : high[1], low[0] : high[0]], A @ shift


def move_frame(frame: Frame, A: Affine, size_px: tuple[int, int]) -> Frame:
    """Move camera and labels by A, a scale and a shift, into a frame of ``size_px`` (width, height).

    Boxes are clipped, keypoints that leave the frame get visibility 0, boats that keep less than a fifth of their box
    are dropped, and so is a range whose keypoint has left the frame.
    """
    camera = transform_camera(frame.camera, torch.tensor(A), size_px)
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


def turn_matrix(K: NDArray[np.float64], angle_rad: float) -> Affine:
    """Say where the pixels of a camera with ``K`` (3, 3) go when :func:`turn_camera` turns it.

    The picture turns the other way, about the principal point: A = K Rz(-angle) K^-1.
    """
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return K @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.linalg.inv(K)


def turn_frame(frame: Frame, angle_rad: float) -> tuple[Frame, Affine]:
    """Turn camera and labels about the optical axis; the map goes from the old pixels to the new.

    The frame keeps its size and nothing is cut off: :func:`move_frame` does that once, at the end.

    A box does not say what fills it. The new one bounds the labelled keypoints and the ellipse that the old box held:
    the box of the turned corners would grow with every turn.
    """
    A = turn_matrix(frame.camera.K[0].double().numpy(), angle_rad)
    keypoints = frame.keypoints_px @ A[:2, :2].T + A[:2, 2]
    corners = frame.boxes_px.reshape(-1, 2, 2)
    centre = corners.mean(1) @ A[:2, :2].T + A[:2, 2]
    half = np.sqrt((((corners[:, 1] - corners[:, 0]) / 2) ** 2) @ (A[:2, :2] ** 2).T)
    labelled = (frame.visibility > 0)[..., None]
    low = np.minimum(centre - half, np.where(labelled, keypoints, np.inf).min(1))
    high = np.maximum(centre + half, np.where(labelled, keypoints, -np.inf).max(1))
    turned = dataclasses.replace(
        frame,
        camera=turn_camera(frame.camera, angle_rad),
        boxes_px=np.concatenate((low, high), -1),
        keypoints_px=keypoints,
    )
    return turned, A


def mirror_matrix(width_px: int) -> Affine:
    """Say where the pixels of a picture of that width go when left and right change places."""
    return np.array([[-1.0, 0.0, width_px - 1], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


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
