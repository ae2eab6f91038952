"""The loss of the keypoints' covariance: is a keypoint as wrong as its heatmap says?

The divergence of :func:`usvnet.losses.keypoints.heatmap_loss` asks for the right spread too, but hardly notices it: a
doubt of half a pixel widens the Gaussian of one cell (4 px) by under 1 %. Here the spread beyond that Gaussian, which
is what decoding reports as covariance, is held against the error itself.
"""

import torch
from torch import Tensor

from usvnet import heatmap
from usvnet.types import Boats

FREEDOM = 4.0
"""Degrees of freedom of the Student t: a swapped bow and stern, tens of pixels off, must not rule the spread."""
GAUSSIAN_SCALE = 2.906990
"""kappa of :func:`robust_nll`, for which Gaussian errors ask for their own covariance. With q = m^2 / 2 exponentially
distributed and a = kappa / 2 the condition is E[q / (a + q)] = 1 / 3."""


def robust_nll(error: Tensor, covariance: Tensor) -> Tensor:
    """Negative log likelihood of 2-vectors under a Student t, without its constant.

    log det(covariance) / 2 + (nu + 2) / 2 log(1 + m^2 / kappa), with m^2 = error^T covariance^-1 error, nu = 4 degrees
    of freedom and kappa such that the expectation over Gaussian errors is least at their own covariance.

    Args:
        error: (..., 2)
        covariance: (..., 2, 2) symmetric and positive definite, in the square of the error's unit.

    Returns:
        (...)
    """
    uu, uv, vv = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    determinant = uu * vv - uv * uv
    u, v = error[..., 0], error[..., 1]
    mahalanobis2 = (vv * u * u - 2 * uv * u * v + uu * v * v) / determinant
    return determinant.log() / 2 + (FREEDOM + 2) / 2 * torch.log1p(mahalanobis2 / GAUSSIAN_SCALE)


def covariance_loss(
    moments: heatmap.Moments,
    boats: Boats,
    sigma_cells: float,
    floor_px2: float,
    stride: int = heatmap.HEATMAP_STRIDE,
) -> Tensor:
    """Robust likelihood of the labels under the decoded keypoints and their covariance.

    Only the covariance is taught: the error is a constant here, the position has its own losses. Each keypoint counts
    with its variance along the narrow axis, up to the target's (beta-NLL with beta = 1, Seitzer et al., ICLR 2022):
    without it the slope grows as 1 / variance and the surest keypoints alone would be heard. Where decoding raises a
    variance to its floor, the slope passes through to the raw one, or a heatmap too sharp could never learn better.

    Args:
        moments: of the heatmaps of the N labelled boats, read as in use (:func:`usvnet.heatmap.window_moments`).
        boats: the N labelled boats; hidden keypoints count, those of visibility 0 do not.
        sigma_cells: standard deviation of the heatmap's target.
        floor_px2: least variance, as in decoding.
        stride: pixels per cell.

    Returns:
        Mean over the labelled keypoints of the weighted likelihood less that of the best that decoding can say, in
        nats: 0 for exact keypoints with the floor as their covariance, and where there is no keypoint.
    """
    floor = floor_px2 / stride**2
    mean, spread, readable = moments
    counts = (boats.visibility > 0) & boats.present.unsqueeze(-1) & readable.squeeze(-1)
    raw = spread - sigma_cells**2 * torch.eye(2, device=spread.device, dtype=spread.dtype)
    covariance = raw + (heatmap.clamp_eigenvalues(raw, floor) - raw).detach()
    labels = heatmap.px_to_cell(boats.keypoints_px.to(mean.dtype), stride)
    error = torch.where(counts.unsqueeze(-1), mean.detach() - labels, 0.0)
    weight = (torch.linalg.eigvalsh(covariance.detach())[..., 0] / sigma_cells**2).clamp(max=1.0)
    excess = robust_nll(error, covariance) - torch.tensor(floor).log()
    return (torch.where(counts, weight * excess, 0.0)).sum() / counts.sum().clamp(min=1)
