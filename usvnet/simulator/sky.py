"""The light of a picture: a map of the radiance from everywhere, with the sun's disc in it."""

import functools
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from usvnet.simulator.clouds import cloud_layer
from usvnet.simulator.daylight import clear_sky, luminance, sun_colour
from usvnet.simulator.frame_spec import SkySpec

Floats = NDArray[np.float32]

HEIGHT, WIDTH = 512, 1024
DISC_RADIUS_RAD = np.radians(0.85)
"""Three times the true sun: several texels, so that its glint is no single white point."""
NADIR = 0.55
"""Radiance looking straight down, as a share of the horizon's."""
LOWEST = 0.004
"""Sine of the elevation from which airlight is taken for whatever is looked at below it."""


@dataclass(frozen=True)
class Sky:
    """Radiance from everywhere; a white matt level surface in the sky's light alone has radiance 1."""

    radiance: Floats
    """(H, W, 3) linear RGB. The centre of texel (row, column) looks to u = (column + 0.5) / W, v = (row + 0.5) / H
    with u = atan2(x, y) / (2 pi) mod 1 and v = acos(z) / pi: column 0 ahead (y), W / 4 to the right (x), row 0 up.
    Mitsuba's envmap shows it so with to_world = rotate([1, 0, 0], 90)."""
    sun_direction: NDArray[np.float64]
    """(3,) unit vector to the sun, world frame."""
    airlight_map: Floats
    """(h, w, 3) the same, blurred, without the sun, and level below the horizon."""

    def airlight(self, directions: ArrayLike) -> Floats:
        """What endless haze looks like: radiance (..., 3) in the world directions (..., 3), which need no unit length.

        Below the horizon it is the horizon's.
        """
        along = np.asarray(directions, np.float32)
        level = np.hypot(along[..., 0], along[..., 1])
        height, width = self.airlight_map.shape[:2]
        pad, row = 2, 4096
        count = level.size
        rows = max(-(-count // row), 1)  # cv2.remap wants pictures of less than 32768 a side
        at = np.zeros((2, rows * row), np.float32)
        turn = np.arctan2(along[..., 0], along[..., 1]) / (2 * np.pi) % 1
        at[0, :count] = (turn * width - 0.5 + pad).ravel()
        polar = np.arctan2(level, np.maximum(along[..., 2], LOWEST * level))
        at[1, :count] = (polar / np.pi * height - 0.5).ravel()
        padded = np.pad(self.airlight_map, ((0, 0), (pad, pad), (0, 0)), mode="wrap")
        colours = cv2.remap(
            padded,
            at[0].reshape(rows, row),
            at[1].reshape(rows, row),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return colours.reshape(-1, 3)[:count].reshape(along.shape)


@functools.cache
def texel_directions() -> Floats:
    """Where each texel of :attr:`Sky.radiance` looks: unit vectors (H, W, 3), world frame."""
    v = (np.arange(HEIGHT)[:, None] + 0.5) / HEIGHT * np.pi
    u = (np.arange(WIDTH)[None] + 0.5) / WIDTH * 2 * np.pi
    directions = np.stack(np.broadcast_arrays(np.sin(v) * np.sin(u), np.sin(v) * np.cos(u), np.cos(v)), -1)
    directions = directions.astype(np.float32)
    directions.flags.writeable = False
    return directions


def texel_solid_angles() -> Floats:
    """Solid angle (H, 1) of a texel of each row, steradians."""
    edges = np.cos(np.linspace(0, np.pi, HEIGHT + 1))
    return ((edges[:-1] - edges[1:]) * 2 * np.pi / WIDTH).astype(np.float32)[:, None]


def level_irradiance(radiance: Floats) -> float:
    """Irradiance (luminance) that a level surface gets from the upper half of a map (H or H / 2, W, 3)."""
    half = HEIGHT // 2
    weight = texel_solid_angles()[:half] * texel_directions()[:half, :1, 2]
    return float((luminance(radiance[:half]) * weight).sum())


def build_sky(spec: SkySpec) -> Sky:
    """The sky and the sun of a picture.

    ``sun_strength`` is the irradiance of a surface that faces the sun over that of level ground by the sky, clouds
    included, before a cloud in front of the sun takes its part.

    Raises:
        ValueError: the kind is unknown, the cloud cover is outside 0 to 1 or the sun's strength is negative.
    """
    if spec.kind not in ("clear", "overcast", "dusk", "fog"):
        raise ValueError(f"sky is {spec.kind}, expected clear, overcast, dusk or fog")
    if not 0 <= spec.cloud_cover <= 1:
        raise ValueError(f"cloud_cover is {spec.cloud_cover}, expected 0 to 1")
    if not spec.sun_strength >= 0:
        raise ValueError(f"sun_strength is {spec.sun_strength}, expected 0 or more")
    rng = np.random.default_rng([spec.seed, 1])
    level = np.cos(spec.sun_elevation_rad)
    sun = np.array(
        [level * np.sin(spec.sun_azimuth_rad), level * np.cos(spec.sun_azimuth_rad), np.sin(spec.sun_elevation_rad)]
    )
    directions = texel_directions()[: HEIGHT // 2]
    cos_to_sun = np.clip(directions @ sun.astype(np.float32), -1, 1)
    angle = np.arccos(cos_to_sun)
    if spec.kind == "clear":
        upper = clear_sky(directions[..., 2], cos_to_sun, spec.sun_elevation_rad, spec.turbidity)
    elif spec.kind == "overcast":
        upper = overcast_sky(directions, sun, rng)
    elif spec.kind == "dusk":
        upper = dusk_sky(directions[..., 2], angle, rng)
    else:
        upper = fog_sky(directions[..., 2], angle, rng)
    upper *= np.float32(np.pi / level_irradiance(upper))
    opacity = np.zeros(upper.shape[:2], np.float32)
    if spec.cloud_cover > 0 and spec.kind in ("clear", "dusk"):
        opacity = add_clouds(upper, directions, sun, angle, spec, rng)
    upper *= np.float32(np.pi / level_irradiance(upper))
    radiance = fill_below(upper)
    airlight = blur_for_air(radiance)
    if spec.sun_strength > 0 and spec.sun_elevation_rad > -DISC_RADIUS_RAD:
        add_sun(radiance, angle, opacity, spec)
    return Sky(radiance, sun, airlight)


def overcast_sky(directions: Floats, sun: NDArray, rng: np.random.Generator) -> Floats:
    """The CIE overcast sky (Moon and Spencer 1942), three times as bright overhead, with a cloud base to be seen."""
    up = directions[..., 2]
    warmth, contrast = rng.uniform(-0.02, 0.03), rng.uniform(0.15, 0.55)
    veil, relief = cloud_layer(directions, sun, 0.6, 2.5, rng)
    base = 1 + contrast * np.clip(up / 0.15, 0, 1) * (relief * (0.6 + 0.4 * veil) - 0.8)
    tint = np.array([0.955 + warmth, 1.0, 1.065 - warmth], np.float32)
    return ((1 + 2 * up) / 3 * base)[..., None].astype(np.float32) * tint


def gradient(up: NDArray, horizon: ArrayLike, zenith: ArrayLike, power: float) -> Floats:
    """From the colour of the horizon (3,) to that of the zenith (3,); a high power keeps the change low."""
    share = ((1 - up) ** power)[..., None]
    return (share * np.asarray(horizon, np.float32) + (1 - share) * np.asarray(zenith, np.float32)).astype(np.float32)


def dusk_sky(up: NDArray, angle: NDArray, rng: np.random.Generator) -> Floats:
    """Blue overhead, dull red around, and a glow where the sun goes down."""
    sky = gradient(up, np.array([0.55, 0.50, 0.55]) * rng.uniform(0.85, 1.15, 3), [0.16, 0.22, 0.40], rng.uniform(3, 5))
    glow = np.array([1.5, rng.uniform(0.65, 0.9), rng.uniform(0.25, 0.5)]) * rng.uniform(0.2, 1.0)
    shape = np.exp(-((angle / rng.uniform(0.5, 0.9)) ** 2)) * np.exp(-up / 0.25)
    return sky + shape[..., None] * glow.astype(np.float32)


def fog_sky(up: NDArray, angle: NDArray, rng: np.random.Generator) -> Floats:
    """Pale and even, a little brighter overhead and towards the sun."""
    warm = rng.uniform(-0.03, 0.03)
    tint = np.array([warm, 0, -warm])
    sky = gradient(up, np.array([0.92, 0.94, 0.96]) + tint, np.array([1.25, 1.25, 1.26]) + tint, rng.uniform(1.3, 2.0))
    shape = np.exp(-((angle / 0.9) ** 2)) * np.exp(-up / 0.25)
    return sky + shape[..., None] * (np.array([0.25, 0.24, 0.20]) * rng.uniform(0.4, 1.2)).astype(np.float32)


def add_clouds(
    upper: Floats, directions: Floats, sun: NDArray, angle: NDArray, spec: SkySpec, rng: np.random.Generator
) -> Floats:
    """Put clouds into the upper half, in place, and return their opacity (H / 2, W)."""
    up = directions[..., 2]
    opacity, brightness = cloud_layer(directions, sun, spec.cloud_cover, rng.uniform(0.5, 1.3), rng)
    opacity *= rng.uniform(0.88, 1.0)
    direct = spec.sun_strength * max(np.sin(spec.sun_elevation_rad), 0.08)
    if spec.kind == "dusk":  # the last light is the sky's own, from below and from where the sun went down
        colour = np.array([0.50, 0.46, 0.55], np.float32)
        warm = np.exp(-((angle / 0.9) ** 2))[..., None] * np.array([1.1, 0.42, 0.16], np.float32)
        light = (colour + warm) * brightness[..., None]
    else:
        silver = 1 + 0.9 * np.exp(-angle / 0.3) * (1.35 - brightness)  # thin edges scatter forwards
        colour = 0.75 + 0.4 * direct * (0.35 + 0.65 * sun_colour(spec.sun_elevation_rad, spec.turbidity))
        light = (brightness * silver)[..., None] * colour.astype(np.float32)
    # Far clouds fade into the haze in front of them.
    near = np.exp(-0.035 / np.maximum(up, 1e-3))
    share = (opacity * near)[..., None]
    upper += share * (light - upper)
    return opacity


def fill_below(upper: Floats) -> Floats:
    """The whole map from its upper half: the horizon goes on below itself and dims slowly towards the nadir."""
    horizon = upper[-3:].mean(0)
    horizon = cv2.GaussianBlur(np.concatenate([horizon] * 3)[None], (0, 0), 8)[0, WIDTH : 2 * WIDTH]
    down = np.arcsin(-texel_directions()[HEIGHT // 2 :, 0, 2])
    dim = NADIR + (1 - NADIR) * np.exp(-down / np.radians(12))
    return np.concatenate([upper, (dim[:, None, None] * horizon).astype(np.float32)])


def blur_for_air(radiance: Floats) -> Floats:
    """A quarter of the map, smooth over 4 degrees, with the brightest of the sky held down."""
    half = len(radiance) // 2
    upper = cv2.resize(radiance[:half], (WIDTH // 4, half // 4), interpolation=cv2.INTER_AREA)
    upper = np.minimum(upper, np.percentile(upper, 97, axis=(0, 1)))
    whole = np.concatenate([upper, np.broadcast_to(upper[-1:], upper.shape)])
    wrapped = np.concatenate([whole[:, -16:], whole, whole[:, :16]], 1)
    return np.ascontiguousarray(cv2.GaussianBlur(wrapped, (0, 0), 3)[:, 16:-16].astype(np.float32))


def add_sun(radiance: Floats, angle: NDArray, opacity: Floats, spec: SkySpec) -> None:
    """Put the sun's disc and its glare into the upper half, in place, behind the clouds."""
    half = len(angle)
    through = (1 - 0.97 * opacity)[..., None]
    colour = sun_colour(spec.sun_elevation_rad, spec.turbidity)
    edge = np.clip((DISC_RADIUS_RAD - angle) / (0.5 * DISC_RADIUS_RAD) + 0.5, 0, 1)
    disc = edge * edge * (3 - 2 * edge)
    spread = max(float((disc * texel_solid_angles()[:half]).sum()), 1e-6)
    glare = 0.5 * min(1.0, spec.sun_strength / 4) * np.exp(-angle / np.radians(3))
    strength = np.pi * spec.sun_strength / spread
    radiance[:half] += (strength * disc + glare)[..., None].astype(np.float32) * (colour * through)
