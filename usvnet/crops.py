"""A second look at a boat: a square crop of the native picture, and the way between its pixels and the image's.

The image is what the detector sees: the native picture shrunk and shifted (:class:`usvnet.types.Native`). A crop is
placed in the image's pixels and filled from the native picture's, so that whatever is found in it has its place beside
what the detector found, under the same camera. M counts crops; pixel (0, 0) of a crop lies at ``corner_px`` and its
neighbours ``step_px`` apart. Only a scale and a shift happen, so both directions are exact and differentiable; the
places themselves have no gradient.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from usvnet.heatmap import Moments
from usvnet.types import Native

CROP_SIZE_PX = 192
"""Side of a crop in its own pixels."""
MARGIN = 1.5
"""Side of a crop over the longer side of the boat's box."""
MIN_STEP_NATIVE_PX = 0.5
"""Small boats are enlarged at most twice: beyond that there is nothing more to see."""
REFINED_STRIDE = 2
"""Pixels of the crop per cell of the refined heatmaps."""
SAMPLES = 2
"""Points averaged in each pixel of a crop, along each axis: shrinking must not alias."""


class Crops(NamedTuple):
    """Where M crops lie in the image."""

    corner_px: Tensor
    """(M, 2) centre of the first pixel."""
    step_px: Tensor
    """(M, 1) from one pixel to the next, along both axes."""


class Refinement(NamedTuple):
    """What a second look at M of B x N boats has found (see :mod:`usvnet.network.refiner`)."""

    keypoints_px: Tensor
    """(B, N, 7, 2) in the image; those of boats that were not looked at are as they were."""
    covariance_px2: Tensor
    """(B, N, 7, 2, 2)"""
    picture: Tensor
    """(M,) int64, which of the B pictures each boat is in."""
    boat: Tensor
    """(M,) int64, which of its N boats it is."""
    crops: Crops
    """Where the crops lie in the images."""
    hints_px: Tensor
    """(M, 7, 2) where the detector saw the keypoints, in the crop."""
    heatmap_logits: Tensor
    """(M, 7, h, w) at :data:`REFINED_STRIDE` pixels of the crop per cell."""
    moments: Moments
    """Of these about their highest cells, one boat a crop: (M, 1, 7, ...)."""


def place_crops(
    boxes_px: Tensor,
    to_image: Tensor,
    size_px: int = CROP_SIZE_PX,
    margin: float = MARGIN,
    min_step_native_px: float = MIN_STEP_NATIVE_PX,
) -> Crops:
    """Centre a crop on each box, large enough for it and its margin.

    Args:
        boxes_px: (M, 4) in the image.
        to_image: (M, 3, 3) map from the native picture of each box to its image.
        size_px: side of a crop in its own pixels.
        margin: side of a crop over the longer side of its box.
        min_step_native_px: the crop's pixels are at least so many native ones apart.
    """
    low, high = boxes_px[:, :2].detach(), boxes_px[:, 2:].detach()
    fitting_px = (high - low).amax(1) * (margin / size_px)
    step_px = torch.maximum(fitting_px, to_image[:, 0, 0] * min_step_native_px).unsqueeze(1)
    return Crops((low + high) / 2 - step_px * ((size_px - 1) / 2), step_px)


def to_crop(points_px: Tensor, crops: Crops) -> Tensor:
    """Points (M, K, 2) of the image in the pixels of their crops."""
    return (points_px - crops.corner_px.unsqueeze(1)) / crops.step_px.unsqueeze(1)


def from_crop(points_px: Tensor, crops: Crops) -> Tensor:
    """Points (M, K, 2) of the crops in the pixels of the image, the inverse of :func:`to_crop`."""
    return points_px * crops.step_px.unsqueeze(1) + crops.corner_px.unsqueeze(1)


def inside_crop(points_px: Tensor, size_px: int = CROP_SIZE_PX) -> Tensor:
    """Whether points (..., 2) in a crop's own pixels lie on it."""
    return ((points_px > -0.5) & (points_px < size_px - 0.5)).all(-1)


def cut(native: Native, picture: Tensor, crops: Crops, size_px: int = CROP_SIZE_PX, samples: int = SAMPLES) -> Tensor:
    """Cut crops out of the native pictures; beyond the edge the edge's pixels are repeated.

    Args:
        native: B pictures.
        picture: (M,) int64, which of them each crop shows.
        crops: where, in the image.
        size_px: side of a crop in its own pixels.
        samples: points of the native picture averaged in each of them, along each axis.

    Returns:
        (M, 3, size_px, size_px) RGB in [0, 1].
    """
    line = (torch.arange(size_px * samples, device=crops.step_px.device) - (samples - 1) / 2) / samples
    to_image = native.to_image[picture]
    lines = crops.corner_px.unsqueeze(2) + crops.step_px.unsqueeze(2) * line  # along u and v
    lines = (lines - to_image[:, :2, 2:]) / torch.stack([to_image[:, 0, 0], to_image[:, 1, 1]], 1).unsqueeze(2)
    colours = bilinear(native.picture, picture, lines[:, 0], lines[:, 1]) / 255
    averaged = colours.view(picture.shape[0], size_px, samples, size_px, samples, 3).mean([2, 4])
    return averaged.permute(0, 3, 1, 2)


def bilinear(pictures: Tensor, index: Tensor, u_px: Tensor, v_px: Tensor) -> Tensor:
    """Interpolate on a rectangular grid of points in each of several windows.

    Whole pictures are neither converted nor copied, which :func:`torch.nn.functional.grid_sample` would need.

    Args:
        pictures: (B, C, H, W), of any type; quickest when channels_last, as pictures of cameras are.
        index: (M,) int64, which picture each window lies in.
        u_px: (M, w) columns.
        v_px: (M, h) rows.

    Returns:
        (M, h, w, C) in the type of ``u_px``.
    """
    height, width = pictures.shape[2], pictures.shape[3]
    pixels = pictures.permute(0, 2, 3, 1).reshape(-1, pictures.shape[1])
    u, v = u_px.clamp(0, width - 1), v_px.clamp(0, height - 1)
    left, top = u.floor(), v.floor()
    across, down = (u - left)[:, None, :, None], (v - top)[:, :, None, None]
    column, row = left.long(), top.long() + (index * height).unsqueeze(1)
    next_column = (column + 1).clamp(max=width - 1)
    next_row = torch.minimum(row + 1, (index * height + height - 1).unsqueeze(1))
    upper = torch.lerp(_pick(pixels, row, column, width, u), _pick(pixels, row, next_column, width, u), across)
    lower = torch.lerp(
        _pick(pixels, next_row, column, width, u), _pick(pixels, next_row, next_column, width, u), across
    )
    return torch.lerp(upper, lower, down)


def _pick(pixels: Tensor, row: Tensor, column: Tensor, width: int, like: Tensor) -> Tensor:
    """Rows (M, h) and columns (M, w) of the pixels (B * H * W, C) of pictures ``width`` wide -> (M, h, w, C)."""
    place = row.unsqueeze(2) * width + column.unsqueeze(1)
    picked = pixels.index_select(0, place.flatten()).to(like.dtype)
    return picked.view(place.shape[0], place.shape[1], place.shape[2], pixels.shape[1])
