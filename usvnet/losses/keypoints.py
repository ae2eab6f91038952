"""The losses of the keypoints: coarse position, visibility, heatmap.

F is the number of foreground anchors of the batch, K the number of keypoints.
"""

import torch
from torch import Tensor
from torch.nn import functional

from usvnet import heatmap
from usvnet.types import Boats


def keypoint_loss(
    predicted_px: Tensor, target_px: Tensor, visibility: Tensor, boxes_px: Tensor, sigma: float
) -> Tensor:
    """Object keypoint similarity (COCO) turned into a loss with a long reach.

    With e = d^2 / (2 area (2 sigma)^2) a keypoint's similarity is exp(-e). The usual loss 1 - exp(-e) is flat for a
    keypoint that is far off, as every keypoint is when training starts. log(1 + e) agrees with it to second order
    (both are e - e^2 / 2 + ...) while its slope falls only as 2 / d.

    Args:
        predicted_px: (F, K, 2)
        target_px: (F, K, 2)
        visibility: (F, K); keypoints of visibility 0 are left out, hidden ones (1) are not.
        boxes_px: (F, 4) labelled boxes, whose area (at least 1 px^2) sets the scale.
        sigma: COCO's per-keypoint constant, the same for all.

    Returns:
        Mean over the labelled keypoints of each anchor, then over the anchors that have any.
    """
    size_px = boxes_px[..., 2:] - boxes_px[..., :2]
    area_px2 = (size_px[..., 0] * size_px[..., 1]).clamp(min=1).unsqueeze(-1)
    distance2_px2 = (predicted_px - target_px).square().sum(-1)
    cost = torch.log1p(distance2_px2 / (2 * area_px2 * (2 * sigma) ** 2))
    labelled = visibility > 0
    per_anchor = (cost * labelled).sum(-1) / labelled.sum(-1).clamp(min=1)
    return per_anchor.sum() / labelled.any(-1).sum().clamp(min=1)


def visibility_loss(visibility_logits: Tensor, visibility: Tensor) -> Tensor:
    """Binary cross entropy of "is seen" for (F, K) logits and labels, over boats with any labelled keypoint.

    Hidden keypoints (1) and those outside the picture (0) both count as not seen. A boat whose keypoints are all 0
    has a box but no keypoint labels, and says nothing.
    """
    labelled = (visibility > 0).any(-1, keepdim=True).expand_as(visibility)
    seen = (visibility == 2).to(visibility_logits.dtype)
    loss = functional.binary_cross_entropy_with_logits(visibility_logits, seen, reduction="none")
    return (loss * labelled).sum() / labelled.sum().clamp(min=1)


def heatmap_loss(
    logits: Tensor,
    boats: Boats,
    sigma_cells: float,
    radius: int | None,
    jitter_cells: int = 0,
    stride: int = heatmap.HEATMAP_STRIDE,
) -> Tensor:
    """Train the distribution that the local soft-argmax reads.

    Around each labelled keypoint the softmax over a window of the heatmap is held against a Gaussian about the exact
    (sub-cell) keypoint: their Kullback-Leibler divergence, which is the cross entropy less the target's own entropy
    and so 0 when perfect. In use the window sits around a coarse keypoint that is a little off, hence the jitter.

    Args:
        logits: (B, K, h, w)
        boats: the labelled boats; hidden keypoints count, those of visibility 0 do not.
        sigma_cells: standard deviation of the target.
        radius: the window has 2 * radius + 1 cells a side; None takes the whole map, which belongs to one boat then.
        jitter_cells: the window is moved by a uniformly random whole number of cells up to this, in both axes.
        stride: pixels per cell.

    Returns:
        Mean over the labelled keypoints, in nats; 0 where there is none.
    """
    height, width = logits.shape[-2:]
    labelled = (boats.visibility > 0) & boats.present.unsqueeze(-1)
    keypoints_px = torch.where(labelled.unsqueeze(-1), boats.keypoints_px, 0.0)
    exact_cell = heatmap.px_to_cell(keypoints_px.to(logits.dtype), stride)
    if radius is None:
        window_logits = logits.flatten(2).unsqueeze(1)
        u = torch.arange(width, device=logits.device)
        v = torch.arange(height, device=logits.device)
    else:
        centre_cell = exact_cell.round().long()
        if jitter_cells > 0:
            centre_cell = centre_cell + torch.randint_like(centre_cell, -jitter_cells, jitter_cells + 1)
        window_logits, _ = heatmap.gather_windows(logits, centre_cell, radius)
        side = torch.arange(-radius, radius + 1, device=logits.device)
        u, v = (centre_cell.unsqueeze(-1) + side).unbind(-2)

    columns = _axis_target(u, width, exact_cell[..., 0], sigma_cells)
    rows = _axis_target(v, height, exact_cell[..., 1], sigma_cells)
    target = (rows.unsqueeze(-1) * columns.unsqueeze(-2)).flatten(-2)
    negative_entropy = (torch.xlogy(columns, columns).sum(-1) + torch.xlogy(rows, rows).sum(-1)) * target.sum(-1)
    divergence = negative_entropy - (target * window_logits.log_softmax(dim=-1)).sum(-1)
    return (divergence * labelled).sum() / labelled.sum().clamp(min=1)


def _axis_target(cells: Tensor, limit: int, exact_cell: Tensor, sigma_cells: float) -> Tensor:
    """The target (B, N, K, S) along one axis, for it is a product of two; all 0 for a window outside the map."""
    inside = (cells >= 0) & (cells < limit)
    logits = heatmap.gaussian_logits(cells[..., None], exact_cell[..., None, None], sigma_cells)
    return logits.masked_fill(~inside, -torch.inf).softmax(dim=-1).nan_to_num()
