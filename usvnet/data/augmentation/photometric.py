"""Other light and other air: colours, glare, fog, dusk, blur and noise on uint8, without moving anything."""

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.data.augmentation.config import AugmentationConfig
from usvnet.data.augmentation.water import depression_sine, horizon_row
from usvnet.data.pictures import Picture
from usvnet.data.records import Frame
from usvnet.types import Camera

LEVELS = np.arange(256)
DISPLAY_GAMMA = 2.2
FOG_GREY = (170, 225)
"""Grey that fog tends to, darkest and brightest."""
FOG_TRANSMISSION = (0.5, 0.9)
"""Share of a boat's own light that comes through."""
CLEAR_SINE = 0.03
"""Sine of the depression from which fog is fully thick in a frame without boats: 33 times the camera's height."""
DUSK_EXPOSURE = (0.12, 0.6)
"""Share of the light that is left."""
GRAIN = (1.0, 8.0)
"""Standard deviation of noise in grey levels. Photon noise grows as the root of the light, and a display's gamma is
nearly a root: in the levels of a picture it is about the same everywhere."""


def change_light(
    picture: Picture, frame: Frame, config: AugmentationConfig, rng: np.random.Generator, one_camera: bool = True
) -> Picture:
    """Change colours a little always, and the rest now and then.

    Args:
        picture: (H, W, 3) RGB, left as it is.
        frame: the picture's camera and boats, which say where the water is and how near the nearest boat.
        config: how far and how often.
        rng: what decides.
        one_camera: False for a mosaic, whose water is anywhere.
    """
    camera = frame.camera if one_camera else None
    changed = change_colours(picture, config, rng)
    if rng.random() < config.glare:
        changed = add_glare(changed, camera, rng)
    if rng.random() < config.fog:
        thickness = fog_thickness(camera, frame.boxes_px, picture.shape) if camera is not None else np.ones(())
        changed = add_fog(changed, thickness, rng)
    if rng.random() < config.dim:
        changed = add_noise(darken(changed, rng.uniform(*DUSK_EXPOSURE)), rng)
    if rng.random() < config.blur:
        changed = cv2.GaussianBlur(changed, (0, 0), rng.uniform(0.5, 1.5)).astype(np.uint8, copy=False)
    if rng.random() < config.noise:
        changed = add_noise(changed, rng)
    return changed


def change_colours(picture: Picture, config: AugmentationConfig, rng: np.random.Generator) -> Picture:
    """Change hue, saturation and brightness."""
    hue, saturation, value = rng.uniform(-1, 1, 3) * (config.hue, config.saturation, config.value)
    hues = (LEVELS + 180 * hue) % 180  # OpenCV counts hue in steps of two degrees
    tables = np.stack((hues, LEVELS * (1 + saturation), LEVELS * (1 + value)), -1).clip(0, 255).astype(np.uint8)
    hsv = cv2.LUT(cv2.cvtColor(picture, cv2.COLOR_RGB2HSV), tables[None])
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB).astype(np.uint8, copy=False)


def add_glare(picture: Picture, camera: Camera | None, rng: np.random.Generator) -> Picture:
    """Add a streak of glitter from the horizon down (from the top where there is no camera), saturating as sensors do.

    It lies on boats too, as light on a lens would: it must not tell where the boats are.
    """
    height, width = picture.shape[:2]
    middle, spread = rng.uniform(0, width), width * rng.uniform(0.03, 0.12)
    top = -1.0 if camera is None else horizon_row(camera, middle)
    across = np.exp(-((np.arange(width, dtype=np.float32) - middle) ** 2) / (2 * spread**2))
    below = (np.arange(height) > top).astype(np.float32)
    glitter = rng.random((height // 2, max(width // 6, 1)), np.float32) ** 3  # wide and low, as wavelets are
    glitter = cv2.resize(glitter, (width, height), interpolation=cv2.INTER_LINEAR)
    light = glitter * below[:, None] * (rng.uniform(150, 400) * across)
    return cv2.add(picture, cv2.merge([light.clip(0, 255).astype(np.uint8)] * 3)).astype(np.uint8, copy=False)


def fog_thickness(camera: Camera, boxes_px: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Optical depth (H, W) of the air before the water, as a fraction of that before the nearest boat, at most 1.

    Above the nearest boat's waterline it is that boat's own all the way up: a boat stands upright before water that is
    further away, and fog that thickened behind its outline would draw it.
    """
    height, width = shape[:2]
    coarse_u, coarse_v = np.linspace(0, width - 1, width // 4), np.linspace(0, height - 1, height // 4)
    sine = cv2.resize(depression_sine(camera, coarse_u, coarse_v[:, None]), (width, height))
    nearest = CLEAR_SINE
    if len(boxes_px):
        nearest = float(depression_sine(camera, boxes_px[:, [0, 2]].mean(-1), boxes_px[:, 3]).max())
    nearest = max(nearest, 1e-3)
    return np.asarray(nearest / np.maximum(sine, nearest), np.float32)


def add_fog(picture: Picture, thickness: NDArray[np.floating], rng: np.random.Generator) -> Picture:
    """Mix in grey by Koschmieder's law: what comes through is t^thickness, t being what comes from the nearest boat."""
    through = np.exp(np.log(rng.uniform(*FOG_TRANSMISSION)) * thickness).astype(np.float32)
    through = np.ascontiguousarray(np.broadcast_to(through, picture.shape[:2]))
    grey = np.full_like(picture, round(rng.uniform(*FOG_GREY)))
    return cv2.blendLinear(picture, grey, through, 1 - through).astype(np.uint8, copy=False)


def darken(picture: Picture, exposure: float) -> Picture:
    """Show a picture as it would be with a fraction ``exposure`` of its light."""
    table = LEVELS * exposure ** (1 / DISPLAY_GAMMA)
    return cv2.LUT(picture, table.astype(np.uint8)).astype(np.uint8, copy=False)


def add_noise(picture: Picture, rng: np.random.Generator) -> Picture:
    """Add Gaussian noise, each channel its own."""
    noise = np.empty(picture.shape, np.int16)
    cv2.setRNGSeed(int(rng.integers(2**31)))  # OpenCV draws it three times faster than numpy
    cv2.randn(noise, (0.0,) * 3, (rng.uniform(*GRAIN),) * 3)
    return cv2.add(picture, noise, dtype=cv2.CV_8U).astype(np.uint8, copy=False)
