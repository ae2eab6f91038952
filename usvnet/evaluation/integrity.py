"""Boats that are not what they seem, made on purpose, and the share of them that the hull's fit refuses.

The keypoints are labels with Gaussian noise, so that what is wrong with a boat is known; the network's own noise by
distance makes the noise an honest one.
"""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from usvnet.detector_errors import exchange_ends
from usvnet.evaluation.reranging import Cases
from usvnet.geometry.camera import project
from usvnet.geometry.ranging import RangingLayer
from usvnet.geometry.rays import level_rays, level_rotation
from usvnet.types import FLIP_INDEX, WATERLINE_KEYPOINTS

DECK = [0, 1, 2, 4, 5]


def reflect(cases: Cases) -> Tensor:
    """Keypoints (C, 7, 2) of which those above the water are seen in its mirror."""
    camera, height_m = cases.camera, cases.camera.height_m[:, None]
    direction = level_rays(cases.keypoints_px, camera)
    drop_m = height_m - cases.hull.points_m[..., 2]
    level_m = direction * (drop_m / direction[..., 1].clamp(min=1e-6)).unsqueeze(-1)
    mirrored_m = torch.stack([level_m[..., 0], 2 * height_m - level_m[..., 1], level_m[..., 2]], -1)
    seen_px = project(mirrored_m @ level_rotation(camera.pitch_rad, camera.roll_rad), camera)
    afloat = torch.zeros(7, dtype=torch.bool).index_fill(0, torch.tensor(WATERLINE_KEYPOINTS), True)
    return torch.where(afloat[:, None] | ~seen_px.isfinite(), cases.keypoints_px, seen_px)


def swap_ends(cases: Cases) -> Tensor:
    """Keypoints (C, 7, 2) of boats whose bow is taken for the stern."""
    return exchange_ends(cases.keypoints_px)


def swap_sides(cases: Cases) -> Tensor:
    """Keypoints (C, 7, 2) of boats whose port is taken for starboard."""
    return cases.keypoints_px[:, list(FLIP_INDEX)]


WRONG: dict[str, Callable[[Cases], Tensor]] = {
    "reflection": reflect,
    "swapped ends": swap_ends,
    "swapped sides": swap_sides,
}
"""What can be wrong with a boat, by name."""


def misfits(cases: Cases, ranging: RangingLayer, draws: int, generator: torch.Generator) -> Tensor:
    """Misfit (draws, C) of boats whose keypoints stray by their covariances, drawn anew each time."""
    drawn = cases.repeat(draws)
    root = torch.linalg.cholesky(drawn.covariance_px2)
    noise = torch.randn(drawn.keypoints_px.shape, dtype=torch.float64, generator=generator)
    keypoints_px = drawn.keypoints_px + (root @ noise.unsqueeze(-1)).squeeze(-1)
    with torch.inference_mode():
        ranges = ranging(
            keypoints_px.unsqueeze(1),
            drawn.covariance_px2.unsqueeze(1),
            drawn.boxes_px.unsqueeze(1),
            drawn.camera,
            drawn.hull,
        )
    return ranges.misfit.squeeze(1).view(draws, cases.count)


def shares_caught(
    cases: Cases, ranging: RangingLayer, false_alarms: float = 0.01, draws: int = 20, seed: int = 0
) -> tuple[float, dict[str, Tensor]]:
    """How many boats of each kind are refused at a given share of good ones.

    Args:
        cases: C boats with the keypoints of their labels and the noise to draw as covariances.
        ranging: the geometry.
        false_alarms: share of good boats that may be refused.
        draws: how often each boat's noise is drawn.
        seed: of the noise.

    Returns:
        The limit of the misfit, and by kind the share (C,) of the draws in which each boat is refused.
    """
    generator = torch.Generator().manual_seed(seed)
    limit = float(misfits(cases, ranging, draws, generator).quantile(1 - false_alarms))
    caught = {}
    for name, spoil in WRONG.items():
        spoilt = replace(cases, keypoints_px=spoil(cases))
        caught[name] = (misfits(spoilt, ranging, draws, generator) > limit).double().mean(0)
    return limit, caught
