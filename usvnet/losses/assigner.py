"""Which anchors answer for which boat: task-aligned assignment (Feng et al., TOOD, ICCV 2021, section 3.2)."""

from typing import NamedTuple

import torch
from torch import Tensor

from usvnet.losses.boxes import complete_iou
from usvnet.types import Boats, NetworkOutput

MIN_OVERLAP = 1e-3
"""Candidates that miss their boat still rank by score: their overlap counts as this much."""
MIN_PEAK_SCORE = 0.1
"""The least target score of a boat's best anchor. The first guesses at a far boat do not overlap it at all; a target
(and so a weight) of zero would never move them."""


class Assignment(NamedTuple):
    """What every anchor of a batch is to learn."""

    foreground: Tensor
    """(B, A) bool, True where the anchor answers for a boat."""
    boat_index: Tensor
    """(B, A) int64 the boat that it answers for, 0 on background."""
    target_score: Tensor
    """(B, A) float32 in [0, 1], 0 on background."""
    best_anchor: Tensor
    """(B, N) int64 the anchor that answers best for each boat; meaningless on padding."""


@torch.no_grad()
def assign(output: NetworkOutput, boats: Boats, topk: int = 10, alpha: float = 0.5, beta: float = 6.0) -> Assignment:
    """Give each boat the ``topk`` anchors that both score and overlap best.

    The candidates are the anchors whose centre lies inside the box, a box narrower or lower than one cell of the
    finest stride being widened to it; a boat that still holds no anchor gets the one nearest to its centre.
    Candidates rank by alignment = score^alpha * CIoU^beta; an anchor wanted by several boats goes to the one it
    overlaps best. Target scores are the alignment, scaled per boat so that the largest equals the largest overlap.

    Args:
        output: the network's answer with one class.
        boats: the labelled boats.
        topk: anchors per boat at most.
        alpha: weight of the score.
        beta: weight of the overlap.

    Returns:
        The assignment; all background where no boat is present.
    """
    batch, anchors = output.class_logits.shape[:2]
    count = boats.present.shape[1]
    if count == 0:
        background = torch.zeros(batch, anchors, dtype=torch.bool, device=boats.present.device)
        return Assignment(background, background.long(), background.float(), background.new_zeros(batch, 0).long())

    candidate = _candidates(output, boats)
    picture, boat, anchor = candidate.nonzero(as_tuple=True)  # few: only they need an overlap
    overlap = candidate.new_full(candidate.shape, -1.0, dtype=torch.float32)
    ranking = overlap.clone()
    ciou = complete_iou(output.boxes_px[picture, anchor].float(), boats.boxes_px[picture, boat].float()).clamp(min=0)
    score = output.class_logits[picture, anchor, 0].float().sigmoid()
    overlap[candidate] = ciou
    ranking[candidate] = score.pow(alpha) * ciou.clamp(min=MIN_OVERLAP).pow(beta)

    best = ranking.topk(min(topk, anchors), dim=-1)
    wanted = torch.zeros_like(candidate).scatter_(-1, best.indices, best.values >= 0)
    owner = torch.where(wanted, overlap, -1.0).argmax(dim=1)
    foreground = wanted.any(dim=1)
    owned = wanted & (owner.unsqueeze(1) == torch.arange(count, device=owner.device).view(1, -1, 1))

    owned_alignment = torch.where(owned, ranking, 0.0)
    peak_alignment = owned_alignment.amax(dim=-1, keepdim=True).clamp(min=torch.finfo(torch.float32).tiny)
    peak_score = torch.where(owned, overlap, 0.0).amax(dim=-1, keepdim=True).clamp(min=MIN_PEAK_SCORE)
    target_score = (owned_alignment / peak_alignment * peak_score).amax(dim=1)
    lost_all = ~owned.any(dim=-1, keepdim=True)  # to its neighbours: it still points at the anchor it wanted most
    best_anchor = torch.where(owned | lost_all, ranking, -1.0).argmax(dim=-1)
    return Assignment(foreground, owner, target_score, best_anchor)


def best_keypoints(output: NetworkOutput, assignment: Assignment) -> Tensor:
    """(B, N, 7, 2) coarse keypoints of each boat's best anchor, about which its heatmaps are read."""
    picture = torch.arange(len(assignment.best_anchor), device=assignment.best_anchor.device).unsqueeze(1)
    return output.keypoints_px[picture, assignment.best_anchor]


def _candidates(output: NetworkOutput, boats: Boats) -> Tensor:
    """(B, N, A) bool: the anchors that may answer for each boat that is present."""
    boxes = boats.boxes_px.float()
    centre = (boxes[..., :2] + boxes[..., 2:]) / 2
    half_size = ((boxes[..., 2:] - boxes[..., :2]) / 2).clamp(min=float(output.strides_px.min()) / 2)
    offset = (output.anchors_px.float() - centre.unsqueeze(2)).abs()
    inside = (offset <= half_size.unsqueeze(2)).all(dim=-1)
    nearest = offset.square().sum(-1).argmin(dim=-1, keepdim=True)
    lonely = ~inside.any(dim=-1, keepdim=True)
    inside = inside.scatter(-1, nearest, lonely | inside.gather(-1, nearest))
    return inside & boats.present.unsqueeze(-1)
