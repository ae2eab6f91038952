"""From the network's dense answer to a few boats: non-maximum suppression in plain torch."""

import torch
from torch import Tensor

from usvnet.types import Detections, NetworkOutput

MAX_CANDIDATES = 128
"""Boxes of a picture that may become boats."""


def pairwise_iou(boxes_px: Tensor) -> Tensor:
    """Intersection over union of every pair. (B, M, 4) -> (B, M, M)."""
    top_left = torch.maximum(boxes_px[:, :, None, :2], boxes_px[:, None, :, :2])
    bottom_right = torch.minimum(boxes_px[:, :, None, 2:], boxes_px[:, None, :, 2:])
    overlap = (bottom_right - top_left).clamp(min=0).prod(-1)
    area = (boxes_px[..., 2:] - boxes_px[..., :2]).clamp(min=0).prod(-1)
    return overlap / (area[:, :, None] + area[:, None, :] - overlap).clamp(min=1e-9)


def suppress(boxes_px: Tensor, iou_threshold: float) -> Tensor:
    """Which boxes greedy suppression keeps. (B, M, 4), best first -> (B, M) bool.

    A box falls if a *kept* better box overlaps it. Starting from "all kept", applying that rule until nothing changes
    gives exactly the greedy answer, a whole batch at a time, in as many rounds as the longest chain of falls.
    """
    better_overlaps = (pairwise_iou(boxes_px) > iou_threshold).triu(1)
    if not torch.jit.is_scripting():  # noqa: SIM102 (scripting skips a block of its own)
        if torch.compiler.is_exporting():
            return _settle_exported(better_overlaps)
    return _settle(better_overlaps)


@torch.jit.script_if_tracing  # a trace, and so an ONNX file, holds the loop and not as many rounds as one picture took
def _settle(better_overlaps: Tensor) -> Tensor:
    """Apply the rule of :func:`suppress` to (B, M, M) bool until nothing changes -> (B, M) bool."""
    keep = torch.ones_like(better_overlaps[:, 0])
    for _ in range(better_overlaps.shape[1]):
        survivors = ~(better_overlaps & keep[:, :, None]).any(1)
        if bool((survivors == keep).all()):
            break
        keep = survivors
    return keep


def _settle_exported(better_overlaps: Tensor) -> Tensor:
    """The same for ``torch.export``, whose graphs have a loop of their own."""

    def unsettled(keep: Tensor, before: Tensor) -> Tensor:
        return (keep != before).any()

    def apply(keep: Tensor, before: Tensor) -> tuple[Tensor, Tensor]:
        return ~(better_overlaps & keep[:, :, None]).any(1), keep.clone()

    keep = torch.ones_like(better_overlaps[:, 0])
    return torch.while_loop(unsettled, apply, (keep, torch.zeros_like(keep)))[0]


def select_boats(
    output: NetworkOutput,
    max_boats: int,
    score_threshold: float,
    iou_threshold: float,
    max_candidates: int = MAX_CANDIDATES,
) -> Detections:
    """The best boats of each picture, best first, padded with zeros to ``max_boats``.

    Gradients reach the boxes and keypoints of the chosen boats; the choice itself has none.

    Args:
        output: dense answer for B pictures.
        max_boats: N, boats kept a picture.
        score_threshold: lowest score kept.
        iou_threshold: overlap above which the lower-scored box falls.
        max_candidates: boxes considered a picture, best first.
    """
    scores = output.class_logits.sigmoid().amax(-1)
    scores, candidate = scores.topk(min(max_candidates, scores.shape[1]), dim=1)
    batch = torch.arange(scores.shape[0], device=scores.device)[:, None]
    keep = suppress(output.boxes_px[batch, candidate].detach(), iou_threshold) & (scores >= score_threshold)
    # The kept boats to the front without disturbing their order: no two of these are equal.
    count = keep.shape[1]
    order = (keep * count + torch.arange(count, 0, -1, device=keep.device)).topk(min(max_boats, count), dim=1)[1]
    present = keep.gather(1, order)
    chosen = candidate.gather(1, order)
    return Detections(
        boxes_px=output.boxes_px[batch, chosen] * present[..., None],
        scores=scores.gather(1, order) * present,
        keypoints_px=output.keypoints_px[batch, chosen] * present[..., None, None],
        visibility=output.visibility_logits[batch, chosen].sigmoid() * present[..., None],
        present=present,
    )
