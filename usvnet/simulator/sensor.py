"""From radiance to a stored picture: exposure, bloom, blur, noise, tone curve."""

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import SensorSpec

Floats = NDArray[np.float32]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
BRIGHTEST = 97.0
"""Percentile of luminance that the exposure is not led astray by: sun and glint lie above it."""
MIXED_VARIANCE = 0.7012
"""Of 3/4 white noise and 1/2 of the same blurred by 1 px: 9/16 + 3/4 g(0) + 1/4 sum g^2 over the kernel g."""
BLOOM = ((0.08, 1.2), (0.02, 4.0), (0.006, 16.0), (0.002, 60.0))
"""Share of the light above white that spreads, and how far in pixels of a picture 640 wide."""


def expose(radiance: Floats, spec: SensorSpec) -> NDArray[np.uint8]:
    """The picture (H, W, 3) RGB, 8 bit sRGB, that a camera keeps of linear ``radiance`` (H, W, 3)."""
    rng = np.random.default_rng([spec.seed, 2])
    vignette, sharpening, contrast = rng.uniform([0.03, 0.1, 0.0], [0.16, 0.5, 0.1])
    balance = np.array([rng.uniform(0.95, 1.06), 1.0, rng.uniform(0.93, 1.07)], np.float32)
    light = _meter(radiance, spec.exposure_key)
    light = light + _bloom(light)
    light = light / _vignette(light.shape[:2], vignette) * balance
    if spec.blur_px > 0:
        light = cv2.GaussianBlur(light, (0, 0), spec.blur_px)
    light = _tone(np.clip(light + _noise(light, spec.noise_gain, rng), 0, None))
    light += contrast * (light - 0.5) * (1 - (2 * light - 1) ** 2)
    light += sharpening * (light - cv2.GaussianBlur(light, (0, 0), 1.0))
    return (np.clip(light, 0, 1) * 255 + 0.5).astype(np.uint8)


def _meter(radiance: Floats, key: float) -> Floats:
    """Scale the log-average luminance to the key (Reinhard et al. 2002), not misled by the sun."""
    luminance = radiance @ LUMINANCE
    ceiling = np.percentile(luminance[::2, ::2], BRIGHTEST)
    average = np.exp(np.log(np.clip(luminance, 1e-6, max(float(ceiling), 2e-6))).mean())
    return (radiance * np.float32(key / average)).astype(np.float32)


def _bloom(light: Floats) -> Floats:
    """Light that scatters in the lens around what is brighter than white; wide blurs work on small pictures."""
    height, width = light.shape[:2]
    above = np.clip(light - 1, 0, 40)
    glow = np.zeros_like(light)
    if not above.any():
        return glow
    for share, spread in BLOOM:
        sigma = spread * width / 640
        shrink = max(int(sigma / 2), 1)
        size = (max(width // shrink, 1), max(height // shrink, 1))
        small = above if shrink == 1 else cv2.resize(above, size, interpolation=cv2.INTER_AREA)
        small = cv2.GaussianBlur(small, (0, 0), max(sigma / shrink, 0.3))
        glow += share * (small if shrink == 1 else cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR))
    return glow


def _vignette(size: tuple[int, int], strength: float) -> Floats:
    height, width = size
    x = (np.arange(width, dtype=np.float32) - (width - 1) / 2) / (width / 2)
    y = (np.arange(height, dtype=np.float32) - (height - 1) / 2) / (width / 2)
    return ((1 + np.float32(strength) * (x[None] ** 2 + y[:, None] ** 2)) ** 2)[..., None]


def _noise(light: Floats, gain: float, rng: np.random.Generator) -> Floats:
    """Shot noise with variance ``gain`` at light 1, and read noise; part of it spread as by demosaicing."""
    white = rng.standard_normal(light.shape, dtype=np.float32)
    mixed = 0.75 * white + 0.5 * cv2.GaussianBlur(white, (0, 0), 1.0)
    variance = gain * np.clip(light, 0, None) + (0.9 * gain) ** 2 + 2e-6
    return mixed * np.sqrt(variance / MIXED_VARIANCE)


def _tone(light: Floats) -> Floats:
    """Shoulder of the highlights, then the sRGB curve (IEC 61966-2-1)."""
    light = np.clip(light * (1 + light / 6) / (1 + 0.55 * light), 0, None)
    curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.power(light, 1 / 2.4) - 0.055)
    return np.clip(curve, 0, 1).astype(np.float32)
