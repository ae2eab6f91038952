"""How foam tears: thin foam is white patches on dark water, not an even grey."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.noise import Floats, noise_tile, sample_tile
from usvnet.simulator.waves import resolved_share

TILE_CELLS = 256
PATCHES = 24
"""Patches across the tile."""
SOFT = 0.3
"""How far the edge of a patch reaches, as a share of the patches' range."""


def tear(share: NDArray, along_m: NDArray, across_m: NDArray, patch_m: float, spacing_m: NDArray | float) -> Floats:
    """Turn the share of water that is white into patches that cover that share.

    Args:
        share: 0 to 1, of any shape; where it is 0 or 1 it stays so.
        along_m: coordinates on the water, like ``share``.
        across_m: like ``share``.
        patch_m: size of a patch.
        spacing_m: distance between neighbouring points, like ``share`` or one; too coarse for patches keeps the share.
    """
    cells = TILE_CELLS / PATCHES / patch_m
    level = SOFT / 2 + (1 - SOFT) * sample_tile(_levels(), cells * along_m, cells * across_m, smooth=False)
    torn = np.clip((share - level) / SOFT + 0.5, 0, 1)
    return (share + resolved_share(patch_m, np.maximum(spacing_m, 1e-6)) * (torn - share)).astype(np.float32)


@cache
def _levels() -> Floats:
    """Values spread evenly over 0 to 1, in patches; all foam tears alike."""
    tile = noise_tile(TILE_CELLS, 2.0, np.random.default_rng([1887]), lowest=PATCHES // 2)
    ranks = np.argsort(np.argsort(tile, axis=None, kind="stable"), kind="stable")
    return (ranks.reshape(tile.shape) / (tile.size - 1)).astype(np.float32)
