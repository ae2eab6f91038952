"""Whitecaps: patches of foam on the open water, wider across the wind than along it."""

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import SeaSpec
from usvnet.simulator.froth import tear
from usvnet.simulator.noise import Floats, noise_tile, sample_tile
from usvnet.simulator.waves import resolved_share

TILE_CELLS = 512
ACROSS = 2.5
"""How much wider than long a patch is."""
CAP_WAVES, CAP_M = 0.15, (0.12, 1.2)
"""Length of a cap along the wind: in waves of the peak wavelength, and its limits."""
LACE = 0.2
"""Size of the patches that a cap tears into, relative to its length."""
CELLS_A_CAP = 8.0
SEED = 77
"""Keeps the patches' random numbers apart from the waves'."""


def whitecaps(spec: SeaSpec, x_m: NDArray, y_m: NDArray, spacing_m: NDArray) -> Floats:
    """Share 0 to 1 of foam at the points of a grid whose rows have one spacing each.

    Args:
        spec: of the sea; ``foam`` is the mean of what comes out.
        x_m: (R, C)
        y_m: (R, C)
        spacing_m: (R,) distance between neighbours; rows too coarse for patches get the mean.
    """
    foam = np.full(np.shape(x_m), spec.foam, np.float32)
    if spec.foam <= 0:
        return foam
    cap_m = float(np.clip(CAP_WAVES * spec.peak_wavelength_m, *CAP_M))
    share = resolved_share(cap_m, spacing_m)
    rows = np.flatnonzero(share > 0)
    if not len(rows):
        return foam
    block = slice(rows[0], rows[-1] + 1)
    cells = CELLS_A_CAP / cap_m
    c, s = np.cos(spec.wind_rad), np.sin(spec.wind_rad)
    along, across = c * x_m[block] + s * y_m[block], c * y_m[block] - s * x_m[block]
    caps = sample_tile(_caps(spec), cells / ACROSS * across, cells * along, smooth=False)
    white = np.flatnonzero(caps > 0)  # few points
    spacing = np.broadcast_to(spacing_m[block, None], caps.shape).ravel()[white]
    caps.ravel()[white] = tear(caps.ravel()[white], along.ravel()[white], across.ravel()[white], LACE * cap_m, spacing)
    foam[block] += share[block, None] * (caps - np.float32(spec.foam))
    return foam


def _caps(spec: SeaSpec) -> Floats:
    """A tile of foam whose mean is the spec's share."""
    rng = np.random.default_rng([spec.seed, SEED])
    waves = TILE_CELLS / CELLS_A_CAP
    lumps = noise_tile(TILE_CELLS, 2.4, rng, lowest=int(waves / 3))
    gusts = noise_tile(TILE_CELLS, 2.0, rng, highest=int(waves / 3))  # caps come in groups
    field = lumps + np.float32(0.6) * gusts
    level = float(np.quantile(field, 1 - spec.foam))
    soft = 0.6 * float(field.std())
    tile: Floats = np.clip((field - level) / soft + 0.5, 0, 1).astype(np.float32)
    return np.minimum(tile * np.float32(spec.foam / max(float(tile.mean()), 1e-9)), 1)
