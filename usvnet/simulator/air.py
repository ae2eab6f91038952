"""Fog, haze and rain between the camera and what it looks at."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import AirSpec

Floats = NDArray[np.float32]

KOSCHMIEDER = 3.912
"""-ln 0.02: at the visibility's distance 2 % of the contrast is left (Koschmieder 1924)."""
RAIN_ATTENUATION = (0.365, 0.63)
"""Extinction by rain in 1/km is a R^b for R mm/h: twice the cross-section of Marshall and Palmer's drops (1948)."""
STREAKS_PER_MM_H = 2.2e-4
"""Visible streaks for each pixel and mm/h, in a layer of air."""
RAIN_LAYERS = ((1.0, 0.30), (0.55, 0.20), (0.3, 0.14))
"""Near to far: size of the streaks relative to the nearest, and how strongly they shine."""


def extinction_per_m(air: AirSpec) -> float:
    """How fast contrast is lost: by the haze of the given visibility and by rain."""
    a, b = RAIN_ATTENUATION
    return KOSCHMIEDER / air.visibility_m + a * air.rain_mm_h**b / 1000


def transmittance(depth_m: Floats, air: AirSpec, subpixels: int, fog: bool) -> Floats:
    """Share of light that arrives (H, W), the mean over the sub-pixels of ``depth_m`` (s H, s W).

    The mean is taken of the share and not of the depth, or outlines would glow. The sky's colour already is what the
    air does to it, except in fog, whose sky is nothing but air.
    """
    depth = np.where(np.isfinite(depth_m), depth_m, np.inf if fog else 0.0)
    share = np.exp(-extinction_per_m(air) * depth, dtype=np.float32)
    height, width = share.shape
    blocks = share.reshape(height // subpixels, subpixels, width // subpixels, subpixels)
    return blocks.mean((1, 3), dtype=np.float32)


def through_air(radiance: Floats, share: Floats, airlight: Floats) -> Floats:
    """Radiance (H, W, 3) after the air has taken from it and added its own light: L T + A (1 - T)."""
    clear = share[..., None]
    return (radiance * clear + airlight * (1 - clear)).astype(np.float32)


def add_rain(radiance: Floats, air: AirSpec, rng: np.random.Generator) -> Floats:
    """Streaks of falling drops in three layers of air; they refract the sky, so they brighten what is dark."""
    if not air.rain_mm_h:
        return radiance
    height, width = radiance.shape[:2]
    bright = float(np.percentile(radiance.mean(-1), 90))
    slant = rng.normal(0, 0.12)
    veil = np.zeros((height, width), np.float32)
    for size, strength in RAIN_LAYERS:
        count = rng.poisson(STREAKS_PER_MM_H * air.rain_mm_h * height * width / size)
        length = max(0.055 * height * size, 3.0)
        layer = np.zeros((height, width), np.float32)
        starts = rng.uniform([0, -length], [width, height], (count, 2))
        angles = slant + rng.normal(0, 0.03, count)
        lengths = length * rng.uniform(0.5, 1.3, count)
        for (x, y), angle, along in zip(starts, angles, lengths):
            end = (x + along * math.sin(angle), y + along * math.cos(angle))
            cv2.line(
                layer, (round(16 * x), round(16 * y)), (round(16 * end[0]), round(16 * end[1])), 1.0, 1, cv2.LINE_AA, 4
            )
        veil = np.maximum(veil, strength * cv2.GaussianBlur(layer, (0, 0), 0.4 + 0.5 * size))
    cover = veil[..., None]
    return (radiance * (1 - cover) + np.float32(bright) * cover).astype(np.float32)
