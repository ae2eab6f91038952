"""How well two boxes agree: intersection over union, plain and complete."""

import math

import torch
from torch import Tensor

EPSILON = 1e-7
"""Keeps every quotient finite for boxes without width or height; far below a pixel."""


def iou(a: Tensor, b: Tensor) -> Tensor:
    """Intersection over union of boxes that correspond (or broadcast).

    Args:
        a: (..., 4) boxes x1, y1, x2, y2 in pixels; the width is x2 - x1.
        b: (..., 4) boxes in the same convention.

    Returns:
        (...) in [0, 1]; 0 where both boxes have no area.
    """
    size_a = (a[..., 2:] - a[..., :2]).clamp(min=0)
    size_b = (b[..., 2:] - b[..., :2]).clamp(min=0)
    shared = (torch.minimum(a[..., 2:], b[..., 2:]) - torch.maximum(a[..., :2], b[..., :2])).clamp(min=0)
    intersection = shared[..., 0] * shared[..., 1]
    union = size_a[..., 0] * size_a[..., 1] + size_b[..., 0] * size_b[..., 1] - intersection
    return intersection / (union + EPSILON)


def complete_iou(a: Tensor, b: Tensor) -> Tensor:
    """Complete IoU (Zheng et al., Distance-IoU Loss, AAAI 2020, equations 8 to 11).

    CIoU = IoU - rho^2 / c^2 - alpha v: the overlap, less the distance of the centres over the diagonal of the
    enclosing box, less the disagreement v of the aspect ratios. Unlike IoU it has a gradient where boxes do not meet.
    The paper holds alpha constant in the backward pass; here it is differentiated like the rest, so that the
    gradient is that of the number returned.

    Args:
        a: (..., 4) boxes x1, y1, x2, y2 in pixels.
        b: (..., 4) boxes in the same convention.

    Returns:
        (...) in (-2, 1], 1 for equal boxes; finite, with finite gradients, for degenerate boxes too.
    """
    overlap = iou(a, b)
    enclosing = torch.maximum(a[..., 2:], b[..., 2:]) - torch.minimum(a[..., :2], b[..., :2])
    diagonal2 = enclosing.square().sum(-1)
    offset2 = ((a[..., :2] + a[..., 2:]) - (b[..., :2] + b[..., 2:])).square().sum(-1) / 4
    aspect = 4 / math.pi**2 * (_aspect_angle(a) - _aspect_angle(b)).square()
    trade_off = aspect / (1 - overlap + aspect + EPSILON)
    return overlap - offset2 / (diagonal2 + EPSILON) - trade_off * aspect


def _aspect_angle(box: Tensor) -> Tensor:
    """(...) the angle whose tangent is width over height, of (..., 4) boxes."""
    size = (box[..., 2:] - box[..., :2]).clamp(min=EPSILON)  # atan2(0, 0) has no gradient
    return torch.atan2(size[..., 0], size[..., 1])
