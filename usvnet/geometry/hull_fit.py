"""The pose of a boat of known shape from its seven keypoints.

Ten numbers are fitted by damped Gauss-Newton, each boat by itself: range and bearing of the hull's origin along the
water, heading, and seven that are known beforehand up to their standard deviations: the boat's size, its roll and
pitch, the camera's height above the water at the boat (mount and wave), and the camera's pitch, roll and focal length.
These seven are counted in those standard deviations, so that each has a unit Gaussian as its prior, and one that is
known exactly simply has no effect. What is minimised is

    sum_i rho(r_i' S_i^-1 r_i) + sum_k u_k^2,

with r_i the residual of keypoint i on the plane z = 1 once the lens is taken away, S_i its covariance (the heatmap's
and the shape's own), u_k the seven, and rho(s) = s up to :data:`ROBUST` and bounded beyond, so that a keypoint that is
far off loses its say. The inverse of the Gauss-Newton matrix is the covariance of all ten.

The number of steps is fixed and nothing branches on data, so the fit scripts and exports. All steps but the last two
run outside the graph; these two carry the gradient.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from usvnet.geometry.elimination import solve_positive
from usvnet.geometry.hull_sight import HullSight, predict_keypoints
from usvnet.geometry.hull_starts import best_starts, choose
from usvnet.geometry.lens import apply_matrix, inverse_2x2

ROBUST = 6.0
"""Squared residual, a chi-squared of 2, up to which a keypoint counts in full: 95 % of them."""
SEARCH_STEPS = 4
"""Gauss-Newton steps from each of the two starts, before the two that carry the gradient."""
DAMPING = 0.01
"""Levenberg's, relative to the diagonal, in these."""
Z_99 = 2.3263478740408408
"""99 % quantile of a unit Gaussian."""
HEADING_INFORMATION = 3 / math.pi**2
"""No heading is less certain than one drawn evenly from the circle."""


class HullFit(NamedTuple):
    """The fitted boats."""

    state: Tensor
    """(B, N, 10) in the order and units of :mod:`usvnet.geometry.hull_sight`."""
    covariance: Tensor
    """(B, N, 10, 10) of the state."""
    gain: Tensor
    """(B, N, 7, 2, 10) how the state follows the keypoints on the plane z = 1."""
    weight: Tensor
    """(B, N, 7) what each keypoint's information was multiplied by: 1, or less where it is far off."""
    cost: Tensor
    """(B, N) what was minimised: a chi-squared, were it not for the keypoints beyond its bound."""
    degrees_of_freedom: Tensor
    """(B, N) of that chi-squared: two a usable keypoint, less range, bearing and heading."""


class Normal(NamedTuple):
    """The normal equations at a state: information x step = slope."""

    information: Tensor
    """(..., 10, 10)"""
    slope: Tensor
    """(..., 10)"""
    weighted_jacobian: Tensor
    """(..., 7, 2, 10) the keypoints' weights times their derivative."""
    weight: Tensor
    """(..., 7) the robust weight of each keypoint, 0 where not usable."""
    cost: Tensor
    """(...)"""


def fit_hulls(sight: HullSight, search_steps: int = SEARCH_STEPS, damping: float = DAMPING) -> HullFit:
    """Fit N boats in B pictures."""
    with torch.no_grad():
        state = best_starts(sight)
        damped = 1 + damping * torch.eye(state.shape[-1], dtype=state.dtype, device=state.device)
        for _ in range(search_steps):
            normal = normal_equations(state, sight, searching=True)
            state = step(state, normal.information * damped, normal.slope)
        state = choose(state, normal_equations(state, sight).cost)
    normal = normal_equations(state, sight)
    state = step(state, normal.information, normal.slope)
    normal = normal_equations(state, sight)
    unit = torch.eye(state.shape[-1], dtype=state.dtype, device=state.device)
    covariance = solve_positive(normal.information, unit.expand_as(normal.information))
    gain = (covariance[..., None, None, :, :] * normal.weighted_jacobian.unsqueeze(-2)).sum(-1)
    return HullFit(
        state=(state + limited(apply_matrix(covariance, normal.slope)))[:, :, 0],
        covariance=covariance[:, :, 0],
        gain=gain[:, :, 0],
        weight=normal.weight[:, :, 0],
        cost=normal.cost[:, :, 0],
        degrees_of_freedom=(2 * sight.usable.to(state.dtype).sum(-1) - 3)[:, :, 0],
    )


def step(state: Tensor, information: Tensor, slope: Tensor) -> Tensor:
    """The state after one Gauss-Newton step."""
    return state + limited(solve_positive(information, slope.unsqueeze(-1))[..., 0])


def normal_equations(
    state: Tensor,
    sight: HullSight,
    searching: bool = False,
    robust: float = ROBUST,
    heading_information: float = HEADING_INFORMATION,
) -> Normal:
    """Linearise the keypoints about states (B, N, K, 10).

    A keypoint with squared residual s > ``robust`` has the weight (robust / s)^2, so that its pull on the state dies
    away: rho(s) = 2 robust - robust^2 / s. While ``searching``, ``robust`` grows with the median residual: far from
    home everything is off, and what is off like most others is no outlier.
    """
    view = predict_keypoints(state, sight)
    shape = (sight.point_std_m / view.depth_m).square()
    unit = torch.eye(2, dtype=state.dtype, device=state.device)
    precision = inverse_2x2(sight.covariance + shape[..., None, None] * unit)
    residual = torch.where(sight.usable.unsqueeze(-1), sight.xy - view.xy, torch.zeros_like(view.xy))
    squared = (residual * apply_matrix(precision, residual)).sum(-1)
    limit = torch.full_like(squared, robust)
    if searching:
        limit = robust * squared.sort(-1).values[..., 3:4].clamp_min(1.0)
    beyond = limit / torch.maximum(squared, limit)
    weight = torch.where(sight.usable, beyond * beyond, torch.zeros_like(beyond))
    pull = (precision.unsqueeze(-1) * view.jacobian.unsqueeze(-3)).sum(-2) * weight[..., None, None]
    flat = pull.flatten(-3, -2)
    known = torch.tensor([0.0, 0.0, 0.0] + 7 * [1.0], dtype=state.dtype, device=state.device)
    identity = torch.eye(state.shape[-1], dtype=state.dtype, device=state.device)
    least = torch.tensor([1e-6, 1e-6, heading_information] + 7 * [1.0], dtype=state.dtype, device=state.device)
    information = (flat.unsqueeze(-1) * view.jacobian.flatten(-3, -2).unsqueeze(-2)).sum(-3) + least * identity
    slope = (flat * residual.flatten(-2).unsqueeze(-1)).sum(-2) - known * state
    bounded = torch.where(squared > limit, limit * (2 - beyond), squared).sum(-1)
    return Normal(information, slope, pull, weight, bounded + (known * state * state).sum(-1))


def limited(step: Tensor) -> Tensor:
    """Keep a step (..., 10) short, so that one from far off does not overshoot."""
    longest = torch.tensor([0.7, 0.3, 0.6] + 7 * [3.0], dtype=step.dtype, device=step.device)
    return torch.minimum(torch.maximum(step, -longest), longest)


def chi_squared_limit(degrees_of_freedom: Tensor, z: float = Z_99) -> Tensor:
    """The 99 % quantile (...) of a chi-squared, by Wilson and Hilferty (1931): 24.77 for 11, where 24.72 is exact."""
    k = degrees_of_freedom.clamp_min(1.0)
    return k * (1 - 2 / (9 * k) + z * torch.sqrt(2 / (9 * k))) ** 3
