"""Labels as a detector might find them: what the second look learns from, and what the hull's fit has to notice."""

import torch
from torch import Tensor

OTHER_END = [0, 5, 4, 6, 2, 1, 3]
"""Where each keypoint comes from when bow and stern are taken for each other; the bow goes amid the stern's corners."""


def jitter_boxes(boxes_px: Tensor, shift: float = 0.15, log_scale: float = 0.25) -> Tensor:
    """Labelled boxes (..., 4) as a detector might find them.

    Args:
        boxes_px: the boxes.
        shift: how far the centre moves at most, along each axis, as a fraction of the longer side.
        log_scale: largest change of the logarithm of the size.
    """
    low, high = boxes_px[..., :2], boxes_px[..., 2:]
    longer_px = (high - low).amax(-1, keepdim=True)
    centre = (low + high) / 2 + shift * longer_px * (2 * torch.rand_like(low) - 1)
    half = (high - low) / 2 * torch.exp(log_scale * (2 * torch.rand_like(longer_px) - 1))
    return torch.cat([centre - half, centre + half], -1)


def jitter_keypoints(keypoints_px: Tensor, boxes_px: Tensor, smallest: float = 0.005, largest: float = 0.08) -> Tensor:
    """Labelled keypoints (..., 7, 2) as a detector might find them, of some boats well and of others badly.

    Each boat is given a standard deviation, a fraction of its longer side drawn evenly on a logarithmic scale; by that
    much its keypoints move together, and each by as much again.

    Args:
        keypoints_px: the keypoints.
        boxes_px: (..., 4) of the same boats.
        smallest: least of those fractions.
        largest: greatest of them.
    """
    longer_px = (boxes_px[..., 2:] - boxes_px[..., :2]).amax(-1)[..., None, None]
    std_px = longer_px * smallest * (largest / smallest) ** torch.rand_like(longer_px)
    together = torch.randn_like(keypoints_px[..., :1, :])
    return keypoints_px + std_px * (together + torch.randn_like(keypoints_px))


def exchange_ends(keypoints_px: Tensor) -> Tensor:
    """Keypoints (..., 7, 2) of boats whose bow is taken for the stern."""
    exchanged = keypoints_px[..., OTHER_END, :]  # a copy, as indexing by a list makes
    exchanged[..., 0, :] = keypoints_px[..., 4:6, :].mean(-2)
    return exchanged


def confuse_ends(keypoints_px: Tensor, visibility: Tensor, share: float = 0.2) -> Tensor:
    """Labelled keypoints (..., 7, 2) of which some boats have theirs at the wrong end, or between both.

    A detector that does not know which end it sees puts keypoints at the other one, or where both costs are least.

    Args:
        keypoints_px: the keypoints.
        visibility: (..., 7); boats with a keypoint that is not labelled (0) keep theirs.
        share: of the others, those that change: half of them end for end, half by any part of the way.
    """
    chosen = (torch.rand_like(keypoints_px[..., 0, 0]) < share) & (visibility > 0).all(-1)
    part = (2 * torch.rand_like(keypoints_px[..., :1, :1])).clamp(max=1) * chosen[..., None, None]
    return torch.lerp(keypoints_px, exchange_ends(keypoints_px), part)
