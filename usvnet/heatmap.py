"""Keypoint heatmaps: where a keypoint sits on a map, and how to read it back to a fraction of a pixel.

This file owns the stride rule. With integer pixel centres, the first cell of a map at stride s covers pixels 0 to
s - 1, so its centre is at (s - 1) / 2 and cell i sits at s * i + (s - 1) / 2. 0.5 px at 100 m is metres.

The network is trained so that the softmax of the logits around a keypoint is a Gaussian of ``sigma_cells`` about the
true position (:mod:`usvnet.losses`). Where the network is unsure, the best such answer is the Gaussian convolved with
its own doubt, so the spread beyond ``sigma_cells`` is the keypoint's covariance.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

HEATMAP_STRIDE = 4
WINDOW_RADIUS = 6
"""Half width in cells of the window that is read around a coarse keypoint."""
SEARCH_FACTOR = 2
"""How many window radii around a coarse keypoint the peak is sought, and the heatmaps are taught."""
SIGMA_CELLS = 1.0
"""Spread of the Gaussian that the heatmaps are trained towards."""
COVARIANCE_FLOOR_PX2 = 0.01
"""No keypoint is claimed to be better than a tenth of a pixel: the moments are not known better than that."""


class Moments(NamedTuple):
    """What the softmax in the window around each of (B, N, K) coarse keypoints says, in cells."""

    mean: Tensor
    """(B, N, K, 2)"""
    spread: Tensor
    """(B, N, K, 2, 2) covariance of the softmax itself, the Gaussian of the training included."""
    readable: Tensor
    """(B, N, K, 1) bool, False where the coarse keypoint lies outside the map and neither means a thing."""


def cell_to_px(cell: Tensor, stride: int) -> Tensor:
    """Map position in cells (any shape) to input pixels."""
    return cell * stride + (stride - 1) / 2


def px_to_cell(px: Tensor, stride: int) -> Tensor:
    """Position in input pixels (any shape) to cells, the inverse of :func:`cell_to_px`."""
    return (px - (stride - 1) / 2) / stride


def gaussian_logits(cells: Tensor, centre_cell: Tensor, sigma_cells: float) -> Tensor:
    """Logarithm of an unnormalised Gaussian. (..., 2) and (..., 2), broadcast -> (...)."""
    return -(cells - centre_cell).square().sum(-1) / (2 * sigma_cells**2)


def encode(keypoints_px: Tensor, height_cells: int, width_cells: int, stride: int, sigma_cells: float) -> Tensor:
    """The heatmap logits of perfectly known keypoints.

    Args:
        keypoints_px: (..., 2) in input pixels.
        height_cells: rows of the map.
        width_cells: columns of the map.
        stride: pixels per cell.
        sigma_cells: spread of the Gaussian.

    Returns:
        (..., height_cells, width_cells), 0 at the keypoint and falling away from it.
    """
    v = torch.arange(height_cells, device=keypoints_px.device, dtype=keypoints_px.dtype)
    u = torch.arange(width_cells, device=keypoints_px.device, dtype=keypoints_px.dtype)
    cells = torch.stack([u.expand(height_cells, width_cells), v[:, None].expand(height_cells, width_cells)], -1)
    return gaussian_logits(cells, px_to_cell(keypoints_px, stride)[..., None, None, :], sigma_cells)


def highest_px(logits: Tensor, stride: int) -> Tensor:
    """Where maps (B, K, h, w) are highest, (B, K, 2) in input pixels; whole cells, without a gradient."""
    width = logits.shape[3]
    number = logits.detach().flatten(2).argmax(-1)
    row = torch.div(number, width, rounding_mode="floor")
    return cell_to_px(torch.stack([number - width * row, row], -1).to(logits.dtype), stride)


def gather_windows(logits: Tensor, centre_cell: Tensor, radius: int) -> tuple[Tensor, Tensor]:
    """Cut a square window around one cell of each map, for several boats at once.

    Args:
        logits: (B, K, h, w) one map per keypoint, shared by all boats.
        centre_cell: (B, N, K, 2) int64 column and row of each window's centre; may lie outside the map.
        radius: S = 2 * radius + 1 cells on a side.

    Returns:
        (B, N, K, S * S) window logits, -1e4 where the window leaves the map (no probability, and finite), and
        (B, N, K, S * S, 2) the column and row of each of its cells.
    """
    b, k, h, w = logits.shape
    n = centre_cell.shape[1]
    side = torch.arange(-radius, radius + 1, device=logits.device)
    s = side.shape[0]
    offsets = torch.stack([side.expand(s, s), side[:, None].expand(s, s)], -1).view(-1, 2)
    cells = centre_cell[..., None, :] + offsets
    u, v = cells[..., 0], cells[..., 1]
    inside = (u >= 0) & (u < w) & (v >= 0) & (v < h)
    flat = v.clamp(0, h - 1) * w + u.clamp(0, w - 1)
    by_keypoint = flat.transpose(1, 2).reshape(b, k, n * s * s)
    window = logits.flatten(2).gather(2, by_keypoint).view(b, k, n, s * s).transpose(1, 2)
    return window.masked_fill(~inside, -1e4), cells.to(logits.dtype)


def decode(
    logits: Tensor,
    coarse_px: Tensor,
    stride: int = HEATMAP_STRIDE,
    radius: int = WINDOW_RADIUS,
    sigma_cells: float = SIGMA_CELLS,
    floor_px2: float = COVARIANCE_FLOOR_PX2,
) -> tuple[Tensor, Tensor]:
    """Local soft-argmax: keypoint and covariance from the heatmap around a coarse keypoint.

    First the highest peak is sought twice as far out as the window reaches, nearer ones preferred: a coarse keypoint
    that is off by half a boat still finds its own, and two boats side by side are not averaged. There the window is
    read twice, the second time centred on the first answer. Differentiable in ``logits``; the windows' places have no
    gradient. Works in float32 or wider, whatever comes in.

    Args:
        logits: (B, K, h, w) one map per keypoint.
        coarse_px: (B, N, K, 2) where to look, in input pixels.
        stride: pixels per cell.
        radius: half width of the window in cells.
        sigma_cells: spread that the maps were trained towards; only what is beyond it is doubt.
        floor_px2: least variance along either axis.

    Returns:
        (B, N, K, 2) keypoints in input pixels and (B, N, K, 2, 2) their covariance. Where a coarse keypoint lies
        outside the map there is nothing to read: it is returned as it is, with the window's width as its sigma.
    """
    moments = window_moments(logits, coarse_px, stride, radius, sigma_cells)
    return keypoints_from_moments(moments, coarse_px, stride, radius, sigma_cells, floor_px2)


def keypoints_from_moments(
    moments: Moments,
    coarse_px: Tensor,
    stride: int = HEATMAP_STRIDE,
    radius: int = WINDOW_RADIUS,
    sigma_cells: float = SIGMA_CELLS,
    floor_px2: float = COVARIANCE_FLOOR_PX2,
) -> tuple[Tensor, Tensor]:
    """The second half of :func:`decode`: what the windows say in pixels; arguments and answer as there."""
    identity = torch.eye(2, device=coarse_px.device, dtype=moments.mean.dtype)
    doubt = clamp_eigenvalues(moments.spread - sigma_cells**2 * identity, floor_px2 / stride**2)
    covariance = torch.where(moments.readable[..., None], doubt, float(radius) ** 2 * identity) * stride**2
    return torch.where(moments.readable, cell_to_px(moments.mean, stride), coarse_px), covariance


def window_moments(
    logits: Tensor,
    coarse_px: Tensor,
    stride: int = HEATMAP_STRIDE,
    radius: int = WINDOW_RADIUS,
    sigma_cells: float = SIGMA_CELLS,
) -> Moments:
    """The first half of :func:`decode`, arguments as there."""
    logits = logits.to(torch.promote_types(logits.dtype, torch.float32))
    h, w = logits.shape[2], logits.shape[3]
    coarse = px_to_cell(coarse_px, stride)
    # not torch.tensor([w, h]): a trace would hold the size of the map that it was made with
    limit = torch.cat([torch.full([1], side, device=logits.device, dtype=logits.dtype) for side in [w, h]])
    readable = ((coarse > -0.5) & (coarse < limit - 0.5)).all(-1, keepdim=True)
    centre = find_peak(logits.detach(), torch.minimum(coarse.detach().clamp(min=0), limit - 1), radius)
    first_look, cells = gather_windows(logits.detach(), centre, radius)
    centre = (first_look.softmax(-1)[..., None] * cells).sum(-2).round().to(torch.int64)
    window, cells = gather_windows(logits, centre, radius)
    probability = window.softmax(-1)
    mean = (probability[..., None] * cells).sum(-2)
    mean = mean + _edge_correction(mean, limit, radius, sigma_cells)
    du, dv = torch.unbind(cells - mean[..., None, :], -1)
    uu, uv, vv = (probability * du * du).sum(-1), (probability * du * dv).sum(-1), (probability * dv * dv).sum(-1)
    covariance = torch.stack([torch.stack([uu, uv], -1), torch.stack([uv, vv], -1)], -2)
    return Moments(mean, covariance, readable)


def find_peak(logits: Tensor, near_cell: Tensor, radius: int, search_factor: int = SEARCH_FACTOR) -> Tensor:
    """The highest cell within ``search_factor * radius``, nearer ones preferred: a Gaussian of deviation ``radius``.

    Sought among the best of every ``search_factor`` x ``search_factor`` cells, which makes it as quick as a window.

    Args:
        logits: (B, K, h, w)
        near_cell: (B, N, K, 2) where to look.
        radius: in cells.
        search_factor: how many radii to look in each direction.

    Returns:
        (B, N, K, 2) int64 column and row, on the map.
    """
    height, width = logits.shape[2], logits.shape[3]
    maxima = functional.max_pool2d(logits, [search_factor, search_factor], ceil_mode=True)
    near = px_to_cell(near_cell, search_factor)
    centre = near.round().to(torch.int64)
    window, cells = gather_windows(maxima, centre, radius)
    best = (window + gaussian_logits(cells, near[..., None, :], radius / search_factor)).argmax(-1, keepdim=True)
    block = cells.gather(-2, best[..., None].expand(-1, -1, -1, 1, 2)).to(torch.int64) * search_factor
    number = torch.arange(search_factor * search_factor, device=logits.device)
    row = torch.div(number, search_factor, rounding_mode="floor")
    u = (block[..., 0] + number - search_factor * row).clamp(0, width - 1)
    v = (block[..., 1] + row).clamp(0, height - 1)
    flat = (v * width + u).transpose(1, 2)
    peak = logits.flatten(2).gather(2, flat.flatten(2)).view_as(flat).transpose(1, 2).argmax(-1, keepdim=True)
    return torch.cat([u.gather(-1, peak), v.gather(-1, peak)], -1)


def _edge_correction(mean: Tensor, limit: Tensor, radius: int, sigma_cells: float) -> Tensor:
    """What to add to the mean (..., 2) of a Gaussian that the map's edge cuts, to have its centre again.

    At the edge itself the mean lies 0.75 cells inside. Newton's method on "the cut Gaussian about p has this mean",
    along each axis by itself, since the window is a rectangle. Nothing further in than about 3 sigma.
    """
    side = torch.arange(-radius, radius + 1, device=mean.device)
    cells = mean.round()[..., None] + side
    inside = (cells >= 0) & (cells < limit[:, None])
    centre = mean
    for _ in range(4):
        weight = torch.exp(-(cells - centre[..., None]).square() / (2 * sigma_cells**2)) * inside
        weight = weight / weight.sum(-1, keepdim=True)
        cut_mean = (weight * cells).sum(-1)
        cut_variance = (weight * (cells - cut_mean[..., None]).square()).sum(-1)
        step = (mean - cut_mean) * sigma_cells**2 / cut_variance.clamp(min=0.1 * sigma_cells**2)
        centre = centre + step.clamp(-1.0, 1.0)
    return torch.minimum(centre.clamp(min=-1.0), limit) - mean


def clamp_eigenvalues(matrix: Tensor, floor: float) -> Tensor:
    """Raise both eigenvalues of symmetric matrices (..., 2, 2) to at least ``floor``, in closed form.

    With half trace m and half spread r, the eigenvalues are m - r and m + r and the matrix is m I + r D with D
    traceless; only m and r change. Finite gradients where r = 0.
    """
    half_trace = (matrix[..., 0, 0] + matrix[..., 1, 1]) / 2
    difference = (matrix[..., 0, 0] - matrix[..., 1, 1]) / 2
    cross = matrix[..., 0, 1]
    spread = (difference.square() + cross.square() + 1e-12).sqrt()
    low = (half_trace - spread).clamp(min=floor)
    high = (half_trace + spread).clamp(min=floor)
    scale = (high - low) / 2 / spread
    mean = (high + low) / 2
    row1 = torch.stack([mean + scale * difference, scale * cross], -1)
    row2 = torch.stack([scale * cross, mean - scale * difference], -1)
    return torch.stack([row1, row2], -2)
