"""The loss of the distance: what the geometry layer says against what the laser read."""

import torch
from torch import Tensor
from torch.nn import functional

from usvnet.types import Boats

TOLERANCE = 0.05
"""Relative error at which the loss turns from quadratic to linear: a few bad laser readings must not rule."""


def range_loss(predicted_m: Tensor, valid: Tensor, boats: Boats) -> tuple[Tensor, Tensor]:
    """Huber loss of the logarithm of the slant range, that is of the relative error.

    A reading with a standard deviation teaches with the weight t^2 / (t^2 + (std / range)^2), t being the tolerance:
    all of it for a laser, half for a reading that is itself uncertain by the tolerance. The mean is over the number of
    boats and not over their weights: poor readings teach less even when there are no others.

    Args:
        predicted_m: (B, N) slant range to the point that the laser hit; may be inf where not valid.
        valid: (B, N) bool, False for a ray at or above the horizon: such boats are left out.
        boats: boats without a range (``range_m`` 0) and padding are left out.

    Returns:
        The mean over the boats that count, and their number (int64). Without any the loss is 0 but still part of
        the graph, so that no parameter goes without a gradient.
    """
    counts = boats.present & valid & (boats.range_m > 0)
    # Left-out entries are replaced before the logarithm: 0 times the gradient of log(inf) would be NaN.
    log_predicted = torch.where(counts, predicted_m, 1.0).log()
    log_measured = torch.where(counts, boats.range_m.to(predicted_m.dtype), 1.0).log()
    loss = functional.smooth_l1_loss(log_predicted, log_measured, beta=TOLERANCE, reduction="none")
    relative_std = torch.where(
        counts, boats.range_std_m / boats.range_m.clamp(min=torch.finfo(torch.float32).tiny), 0.0
    )
    weight = counts / (1 + (relative_std / TOLERANCE).square())
    number = counts.sum()
    return (weight * loss).sum() / number.clamp(min=1), number
