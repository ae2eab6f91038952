"""Small batches for the tests of the losses: labels, guesses and the perfect answer."""

import torch
from torch import Tensor

from usvnet import heatmap
from usvnet.types import FLIP_INDEX, NEAREST_WATERLINE, NUM_KEYPOINTS, Boats, NetworkOutput

BINS = 16


def grid(size_px: int, strides: tuple[int, ...] = (8, 16, 32)) -> tuple[Tensor, Tensor]:
    """Anchors (A, 2) and strides (A,) of a square picture."""
    levels = []
    for stride in strides:
        line = torch.arange(size_px // stride) * float(stride) + (stride - 1) / 2
        levels.append(torch.cartesian_prod(line, line).flip(-1))
    return torch.cat(levels), torch.cat([torch.full((len(a),), float(s)) for a, s in zip(levels, strides)])


def label(boxes: list[list[list[float]]], range_m: float = 0.0) -> Boats:
    """Boats of B pictures, the same number in each, with all keypoints seen on the box's diagonal."""
    boxes_px = torch.tensor(boxes).reshape(len(boxes), -1, 4)
    share = torch.linspace(0.1, 0.9, NUM_KEYPOINTS)[:, None]
    shape = boxes_px.shape[:2]
    return Boats(
        boxes_px=boxes_px,
        keypoints_px=boxes_px[:, :, None, :2] * (1 - share) + boxes_px[:, :, None, 2:] * share,
        visibility=torch.full((*shape, NUM_KEYPOINTS), 2),
        present=torch.ones(shape, dtype=torch.bool),
        range_m=torch.full(shape, range_m),
        range_std_m=torch.zeros(shape),
        reference=torch.full(shape, NEAREST_WATERLINE),
    )


def guess(batch: int, size_px: int = 64, strides: tuple[int, ...] = (8, 16, 32)) -> NetworkOutput:
    """A random answer whose tensors are leaves that want a gradient."""
    anchors_px, strides_px = grid(size_px, strides)
    count = len(anchors_px)
    half_px = strides_px[:, None] * (0.5 + 2 * torch.rand(batch, count, 2))
    box_centre_px = anchors_px + 4 * torch.randn(batch, count, 2)
    cells = size_px // heatmap.HEATMAP_STRIDE
    answers = (
        torch.cat([box_centre_px - half_px, box_centre_px + half_px], -1),
        torch.randn(batch, count, 4, BINS),
        torch.randn(batch, count, 1) - 2,
        anchors_px[:, None] + 8 * torch.randn(batch, count, NUM_KEYPOINTS, 2),
        torch.randn(batch, count, NUM_KEYPOINTS),
        torch.randn(batch, NUM_KEYPOINTS, cells, cells),
    )
    return NetworkOutput(*(answer.requires_grad_() for answer in answers), anchors_px, strides_px)


def perfect(boats: Boats, size_px: int) -> NetworkOutput:
    """The right answer, and sure of it, to one boat a picture whose box sides lie on anchors of stride 8."""
    anchors_px, strides_px = grid(size_px, (8,))
    count = len(anchors_px)
    boxes_px = boats.boxes_px.expand(-1, count, 4)
    sides = torch.cat([anchors_px - boxes_px[..., :2], boxes_px[..., 2:] - anchors_px], -1) / strides_px[:, None]
    inside = (sides >= 0).all(-1, keepdim=True)
    cells = size_px // heatmap.HEATMAP_STRIDE
    return NetworkOutput(
        boxes_px,
        40 * torch.nn.functional.one_hot(sides.round().long().clamp(0, BINS - 1), BINS).float(),
        torch.where(inside, 20.0, -20.0),
        boats.keypoints_px.expand(-1, count, NUM_KEYPOINTS, 2),
        torch.where(boats.visibility == 2, 20.0, -20.0).expand(-1, count, NUM_KEYPOINTS),
        heatmap.encode(boats.keypoints_px[:, 0], cells, cells, heatmap.HEATMAP_STRIDE, heatmap.SIGMA_CELLS),
        anchors_px,
        strides_px,
    )


def mirror(output: NetworkOutput, boats: Boats, size_px: int) -> tuple[NetworkOutput, Boats]:
    """The same answer and labels seen in a mirror: u becomes W - 1 - u, port becomes starboard."""
    flip = list(FLIP_INDEX)
    edge = size_px - 1

    def boxes(box_px: Tensor) -> Tensor:
        return torch.stack([edge - box_px[..., 2], box_px[..., 1], edge - box_px[..., 0], box_px[..., 3]], -1)

    def points(point_px: Tensor) -> Tensor:
        return torch.stack([edge - point_px[..., 0], point_px[..., 1]], -1)

    mirrored = output._replace(
        boxes_px=boxes(output.boxes_px),
        box_logits=output.box_logits[:, :, [2, 1, 0, 3]],
        keypoints_px=points(output.keypoints_px[:, :, flip]),
        visibility_logits=output.visibility_logits[:, :, flip],
        heatmap_logits=output.heatmap_logits[:, flip].flip(-1),
        anchors_px=points(output.anchors_px),
    )
    labels = boats._replace(
        boxes_px=boxes(boats.boxes_px),
        keypoints_px=points(boats.keypoints_px[:, :, flip]),
        visibility=boats.visibility[:, :, flip],
    )
    return mirrored, labels
