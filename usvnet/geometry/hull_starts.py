"""Where to begin the fit of a hull."""

import math

import torch
from torch import Tensor

from usvnet.geometry.hull_sight import MIN_DEPTH_M, HullSight, place_hull

HEADINGS = 12
"""Drawn, evenly over the circle."""
ROUNDS = 2
"""Of laying a drawing on the keypoints, each with the weights that the last one left."""
FARTHEST_LENGTHS = 300.0
"""A boat further away than this many of its lengths is looked for no further."""
MIN_SCALE = 0.05
"""A drawing is never laid on smaller than this share of what was drawn, nor the wrong way round."""


def best_starts(
    sight: HullSight,
    headings: int = HEADINGS,
    rounds: int = ROUNDS,
    farthest_lengths: float = FARTHEST_LENGTHS,
    min_scale: float = MIN_SCALE,
    min_depth_m: float = MIN_DEPTH_M,
) -> Tensor:
    """Where to begin: states (B, N, 2, 10), the best of some headings and the best of those that point elsewhere.

    The keypoints' middle and the water tell the range. The hull is drawn there at each heading, and the drawing is laid
    on the keypoints by the best shift and scale, with Cauchy weights. How much larger it has to be drawn makes the boat
    larger or nearer, whichever is known less well.
    """
    number = sight.usable.float().sum(-1, keepdim=True).clamp_min(1)
    middle = torch.where(sight.usable.unsqueeze(-1), sight.xy, torch.zeros_like(sight.xy)).sum(-2) / number
    ray = torch.cat([middle, torch.ones_like(number)], -1)
    x, y, z = (ray * sight.right).sum(-1), (ray * sight.down).sum(-1), (ray * sight.forward).sum(-1)
    deck_m = sight.points_m[..., 2].mean(-1)
    drop_m = torch.maximum(sight.height_m - deck_m, 0.2 * sight.height_m)
    length_m = sight.points_m[..., 0].amax(-1) - sight.points_m[..., 0].amin(-1)
    farthest_m = farthest_lengths * length_m * (2 * sight.std[..., 0]).exp()
    tangent = torch.maximum(y / torch.sqrt(x * x + z * z + 1e-12), drop_m / farthest_m)
    log_range, bearing = torch.log(drop_m / tangent), torch.atan2(x, z)

    turns = torch.arange(headings, dtype=bearing.dtype, device=bearing.device) * (2 * math.pi / headings)
    heading = bearing + turns
    still = torch.zeros_like(heading)
    rest = torch.zeros_like(heading).unsqueeze(-1).expand(-1, -1, -1, 7)
    state = torch.cat([torch.stack([log_range + still, bearing + still, heading], -1), rest], -1)
    placed = place_hull(state, sight)
    drawn = placed.points_m[..., :2] / placed.points_m[..., 2:].clamp_min(min_depth_m)

    variance = (sight.covariance[..., 0, 0] + sight.covariance[..., 1, 1]) / 2
    shape = (sight.point_std_m / log_range.exp().unsqueeze(-1)).square()
    trust = torch.where(sight.usable, 1 / (variance + shape), torch.zeros_like(variance))
    weight, scale, squared = trust, heading, trust + 0 * drawn[..., 0]
    for _ in range(rounds):
        total = weight.sum(-1, keepdim=True).clamp_min(1e-12)
        drawn_from = drawn - (weight.unsqueeze(-1) * drawn).sum(-2, keepdim=True) / total.unsqueeze(-1)
        seen_from = sight.xy - (weight.unsqueeze(-1) * sight.xy).sum(-2, keepdim=True) / total.unsqueeze(-1)
        both = (weight * (drawn_from * seen_from).sum(-1)).sum(-1)
        scale = (both / (weight * drawn_from.square().sum(-1)).sum(-1).clamp_min(1e-12)).clamp_min(min_scale)
        squared = trust * (seen_from - scale[..., None, None] * drawn_from).square().sum(-1)
        weight = trust / (1 + squared / (1 + squared.mean(-1, keepdim=True)))
    cost = torch.log1p(squared).sum(-1)

    of_water = (variance + sight.by_camera.square().sum((-1, -2))).mean(-1) / tangent.square() + 0.05**2
    of_size = sight.std[..., 0].square()
    larger = scale.log() / (of_size + of_water)
    log_range, size = log_range - larger * of_water, larger * sight.std[..., 0]
    state = torch.cat([torch.stack([log_range, bearing + still, heading, size], -1), rest[..., 1:]], -1)
    best = choose(state, cost)
    elsewhere = torch.cos(heading - best[..., 2]) < 0.1
    other = choose(state, torch.where(elsewhere, cost, torch.full_like(cost, 1e30)))
    return torch.cat([best, other], 2)


def choose(state: Tensor, cost: Tensor) -> Tensor:
    """The cheapest (B, N, 1, 10) of states (B, N, K, 10) with costs (B, N, K)."""
    best = cost.argmin(-1, keepdim=True).unsqueeze(-1)
    return state.gather(2, best.expand(-1, -1, -1, state.shape[-1]))
