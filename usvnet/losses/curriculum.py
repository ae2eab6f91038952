"""When laser ranges may teach: once the keypoints that they are read from are sensible."""

import math

import torch
from torch import Tensor

from usvnet.types import Boats

MEMORY = 0.95
"""Share of the running error that a batch leaves: it looks back over some twenty batches."""


class RangeCurriculum:
    """A smooth rise of the range's weight as the keypoints' error falls, measured on the training batches themselves.

    The range of a keypoint on the wrong end of the boat, or on the horizon, says nothing about where it should be. How
    many epochs it takes until keypoints are better than that depends on data, network and batch; their error does not.

    Args:
        full_error: error of the keypoints, see :func:`keypoint_error`, from which the range has its full weight; at
            twice that it has none. None gives it its full weight always.

    Raises:
        ValueError: it is not a positive number.
    """

    def __init__(self, full_error: float | None) -> None:
        if full_error is not None and not (math.isfinite(full_error) and full_error > 0):
            raise ValueError(f"range_loss_error: got {full_error}, expected a number above 0, or null")
        self.full_error = full_error
        self.error = torch.ones(())
        """Running error; it starts from 1, "as wrong as the boat is large", whatever the first batches say."""

    def update(self, batch_error: Tensor) -> None:
        """Take in the error () of a batch; NaN, from one without keypoints, changes nothing."""
        self.error = self.error.to(batch_error.device)
        self.error = torch.where(batch_error.isnan(), self.error, self.error.lerp(batch_error, 1 - MEMORY))

    def scale(self) -> Tensor:
        """Factor () on the range's weight, 0 to 1, smooth at both ends."""
        if self.full_error is None:
            return torch.ones_like(self.error)
        share = (2 - self.error / self.full_error).clamp(0, 1)
        return share * share * (3 - 2 * share)


@torch.no_grad()
def keypoint_error(keypoints_px: Tensor, boats: Boats) -> Tensor:
    """Median distance of keypoints from their labels, as a fraction of their boat's size (the root of its box's area).

    A median, because even a good network mistakes the two ends of some boats.

    Args:
        keypoints_px: (B, N, 7, 2) the keypoints found for each labelled boat.
        boats: the labelled boats; keypoints of visibility 0 are left out.

    Returns:
        () at most 1; NaN where there is no labelled keypoint.
    """
    size_px = (boats.boxes_px[..., 2:] - boats.boxes_px[..., :2]).prod(-1).clamp(min=1).sqrt()
    error = ((keypoints_px - boats.keypoints_px).norm(dim=-1) / size_px.unsqueeze(-1)).clamp(max=1)
    labelled = (boats.visibility > 0) & boats.present.unsqueeze(-1)
    return error.masked_fill(~labelled, torch.nan).nanmedian()
