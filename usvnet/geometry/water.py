"""Where a ray meets the water: flat, or curved with the earth and the air's refraction.

Both are one formula. With s the sine of the ray's angle below the horizontal, h the camera's height and c the
curvature of the sphere through the camera (0 for flat water), the nearer root of the ray-sphere quadratic in its
stable form (constant term over the large root, so nothing cancels) is

    D = h (2 - h c) / (s + root),    root^2 = s^2 - h c (2 - h c),

which for c = 0 is h / s. Refraction bends rays by k of the earth's curvature, which is a straight ray over an
earth of radius R / (1 - k).
"""

from typing import NamedTuple

import torch
from torch import Tensor

EARTH_RADIUS_M = 6_371_008.8
"""Mean radius of the earth (IUGG)."""
REFRACTION = 0.13
"""The usual coefficient k of terrestrial refraction (Gauss)."""
MIN_SINE = 1e-5
"""Sine of the depression up to which a ray counts as level: float32 knows such an angle to no better than 1 %."""


class WaterHit(NamedTuple):
    """Where rays meet the water, and how that moves."""

    slant_m: Tensor
    """(...) distance along the ray; the camera's height where not valid, so that sums stay finite."""
    horizontal_m: Tensor
    """(...) along the water from the point below the camera: an arc where the water is curved."""
    slant_by_sine_m: Tensor
    """(...) derivative of the slant range to the sine of the ray's depression."""
    slant_by_height: Tensor
    """(...) derivative of the slant range to the camera's height."""
    valid: Tensor
    """(...) bool, False for a ray at or above the horizon."""


def effective_radius_m(refraction: float = REFRACTION, earth_radius_m: float = EARTH_RADIUS_M) -> float:
    """Radius of the earth over which refracted rays are straight."""
    return earth_radius_m / (1.0 - refraction)


def horizon_dip_rad(height_m: Tensor, refraction: float = REFRACTION) -> Tensor:
    """How far (rad, >= 0) the water's horizon lies below the horizontal, seen from ``height_m`` (...)."""
    radius = effective_radius_m(refraction)
    return torch.atan(torch.sqrt(height_m * (height_m + 2 * radius)) / radius)


def meet_water(
    direction: Tensor,
    height_m: Tensor,
    curved: bool = False,
    refraction: float = REFRACTION,
    min_sine: float = MIN_SINE,
) -> WaterHit:
    """Follow unit rays ``direction`` (..., 3) of the level frame from ``height_m`` (...) down to the water.

    Gradients are finite for every ray: those without a hit are replaced before any division.

    Args:
        direction: (..., 3) unit rays.
        height_m: (...) or broadcastable to it, above 0.
        curved: follow the earth's curvature, or take the water as flat.
        refraction: coefficient k of terrestrial refraction, used with curved water only.
        min_sine: a ray no more than this below the horizontal counts as level.
    """
    sine = direction[..., 1]
    curvature = torch.zeros_like(height_m)
    if curved:
        curvature = 1 / (height_m + effective_radius_m(refraction))
    bulge = 2 - height_m * curvature
    clearance = sine * sine - height_m * curvature * bulge  # the horizon dips by the sine whose square this takes off
    valid = (sine > min_sine) & (clearance > 0)

    down = torch.ones_like(sine)
    sine = torch.where(valid, sine, down)
    root = torch.sqrt(torch.where(valid, clearance, down))
    slant = height_m * bulge / (sine + root)
    forward2 = direction[..., 0] * direction[..., 0] + direction[..., 2] * direction[..., 2]
    chord = slant * torch.sqrt(torch.where(valid, forward2, down).clamp_min(1e-20))
    upright = 1 - slant * sine * curvature  # cosine-like side of the triangle at the sphere's centre
    horizontal = chord
    if curved:
        horizontal = effective_radius_m(refraction) * torch.atan(chord * curvature / upright)
    return WaterHit(slant, horizontal, -slant / root, upright / root, valid)
