"""The losses of the boxes and of the scores.

F is the number of foreground anchors of the batch; ``weight`` (F,) is their target score, so that the anchors that
answer best count most.
"""

import torch
from torch import Tensor
from torch.nn import functional

from usvnet.losses.boxes import complete_iou

TOP_BIN_MARGIN = 0.01
"""Bins short of the last one at which a side's distance is clamped, so that a bin above it always exists."""


def box_loss(predicted_px: Tensor, target_px: Tensor, weight: Tensor) -> Tensor:
    """Weighted mean of 1 - CIoU over (F, 4) boxes; 0 for equal boxes."""
    return _weighted_mean(1 - complete_iou(predicted_px, target_px), weight)


def distribution_focal_loss(box_logits: Tensor, distances: Tensor, weight: Tensor) -> Tensor:
    """Distribution focal loss (Li et al., Generalized Focal Loss, NeurIPS 2020, equation 6).

    Cross entropy against the two bins on either side of the true distance, shared in proportion to nearness.

    Args:
        box_logits: (F, 4, R) over the R bins 0, 1, ..., R - 1.
        distances: (F, 4) true distances in strides, clamped into the bins here.
        weight: (F,)

    Returns:
        Weighted mean over the anchors of the mean over the four sides; 0 only for a sure and right distribution.
    """
    distances = distances.clamp(min=0, max=box_logits.shape[-1] - 1 - TOP_BIN_MARGIN)
    lower = distances.floor()
    share_of_upper = distances - lower
    index = lower.long().unsqueeze(-1)
    log_probability = box_logits.log_softmax(dim=-1)
    at_lower = log_probability.gather(-1, index).squeeze(-1)
    at_upper = log_probability.gather(-1, index + 1).squeeze(-1)
    return _weighted_mean(-((1 - share_of_upper) * at_lower + share_of_upper * at_upper).mean(-1), weight)


def side_distances(boxes_px: Tensor, anchors_px: Tensor, strides_px: Tensor) -> Tensor:
    """Distances, in strides, from each anchor to the left, top, right and bottom of its box.

    Args:
        boxes_px: (F, 4)
        anchors_px: (F, 2)
        strides_px: (F,)

    Returns:
        (F, 4), negative where the anchor lies beyond that side.
    """
    sides_px = torch.cat([anchors_px - boxes_px[..., :2], boxes_px[..., 2:] - anchors_px], dim=-1)
    return sides_px / strides_px.unsqueeze(-1)


def classification_loss(class_logits: Tensor, target_score: Tensor) -> Tensor:
    """Binary cross entropy of (B, A) logits against (B, A) target scores.

    Summed over all anchors and divided by the sum of the targets (at least 1).
    """
    loss = functional.binary_cross_entropy_with_logits(class_logits, target_score, reduction="sum")
    return loss / target_score.sum().clamp(min=1)


def _weighted_mean(value: Tensor, weight: Tensor) -> Tensor:
    """Mean of (F,) values under (F,) weights; 0, with a gradient of 0, where F is 0."""
    return (value * weight).sum() / weight.sum().clamp(min=torch.finfo(weight.dtype).eps)
