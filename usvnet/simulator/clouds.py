"""Clouds on a level layer above the water: where they are, how thick, and how the sun lights them."""

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.noise import noise_tile, sample_tile

Floats = NDArray[np.float32]

TILE = 512
EARTH_CURVE = 0.16
"""Keeps the layer at a finite distance where one looks level at it."""
BULGE = 0.08
"""How far the noise lifts and sinks parts of the layer, as a sine of elevation."""
DETAIL_FROM = (0.04, 0.3)
"""Sines of elevation between which small billows appear; nearer to the horizon they are smaller than a texel."""


def cloud_layer(
    directions: Floats, sun_direction: NDArray, cover: float, softness: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Opacity and brightness (...) of the clouds seen in the directions (..., 3) above the horizon.

    Args:
        directions: unit vectors, rows of an equirectangular map from the zenith (row 0) to the horizon.
        sun_direction: (3,)
        cover: share of the sky's solid angle that is hidden.
        softness: width of the edges in standard deviations of the noise; 0.3 is cumulus, 1.5 is a veil.
        rng: where the clouds are drawn from.

    Returns:
        The opacity, 0 to 1, and the brightness: 1 on the average lit flank, 0.4 in the thick of it or away from the
        sun.
    """
    up = directions[..., 2]
    puffs = noise_tile(TILE, 2.6, rng, lowest=4, highest=26)
    billows = noise_tile(TILE, 2.2, rng, lowest=8)
    scale = rng.uniform(60, 130)
    stretch = rng.uniform(0.75, 1.3)
    wind_x, wind_y = rng.uniform(0, TILE, 2)
    # Clouds are as tall as they are wide: without this bulge they would lie as flat streaks above the horizon.
    turn = np.arange(up.shape[1], dtype=np.float32) * (2 * TILE / up.shape[1])
    turn, rise = np.broadcast_arrays(turn, np.arcsin(up[:, :1]) * np.float32(TILE / np.pi))
    bulge = sample_tile(puffs, turn, rise, smooth=False) - 0.5
    distance = np.float32(scale) / (up + np.float32(EARTH_CURVE) + np.float32(BULGE) * bulge)
    x, y = directions[..., 0] * distance + np.float32(wind_x), directions[..., 1] * distance * stretch + wind_y
    detail = np.clip((up - DETAIL_FROM[0]) / (DETAIL_FROM[1] - DETAIL_FROM[0]), 0, 1)
    thickness = sample_tile(puffs, x, y, smooth=False)
    thickness = thickness + 0.45 * (0.25 + 0.75 * detail) * (sample_tile(billows, x * 2.1, y * 2.1, smooth=False) - 0.5)
    level = weighted_quantile(thickness, np.sqrt(np.maximum(1 - up * up, 0)), 1 - cover)
    depth = (thickness - level) / 0.17  # noise has a standard deviation of 0.17
    opacity = np.clip(depth / softness + 0.5, 0, 1)
    opacity = opacity * opacity * (3 - 2 * opacity)

    # How much cloud stands between here and the sun, a step along the layer.
    toward = np.asarray(sun_direction[:2]) / max(float(np.hypot(*sun_direction[:2])), 1e-6)
    step = 9 * float(np.hypot(*sun_direction[:2]))
    shade = sample_tile(puffs, x + step * toward[0], y + step * toward[1] * stretch, smooth=False) - thickness
    brightness = 1 - 0.13 * np.clip(depth, 0, 3) - 0.9 * shade
    return soften(opacity), soften(np.clip(brightness, 0.4, 1.35))


def soften(field: NDArray) -> Floats:
    """A field (rows, columns) without steps from texel to texel; its columns go all around."""
    around = np.pad(field.astype(np.float32), ((0, 0), (4, 4)), mode="wrap")
    return np.ascontiguousarray(cv2.GaussianBlur(around, (0, 0), 0.8)[:, 4:-4])


def weighted_quantile(values: NDArray, weights: NDArray, share: float) -> float:
    """The value that the given share of the weight lies below, from every fifth value along each axis."""
    few, heavy = values[::5, ::5].ravel(), weights[::5, ::5].ravel()
    order = np.argsort(few, kind="stable")
    total = np.cumsum(heavy[order])
    return float(few[order][min(np.searchsorted(total, share * total[-1]), len(few) - 1)])
