"""What a boat under way does to the water: the Kelvin pattern of waves, a bow wave, and foam.

Boat frame: ``astern`` is metres behind the amidships, ``aside`` metres to port; the pattern lies in the wedge of
19.47 degrees to either side (Kelvin 1887) whose tip is half a beam ahead of the bow.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.froth import tear
from usvnet.simulator.waves import Floats, resolved_share

GRAVITY = 9.81
SLOWEST_MPS, FULL_MPS = 0.3, 0.8
"""Below the first a boat leaves no wake, from the second on a full one."""
CUSP = 1 / math.sqrt(8)
"""Tangent of the wedge's half angle."""
STEEPEST = 0.16
"""Slope that the waves of the pattern do not pass; steeper ones break."""
FOAM_LIFE_S = 5.0
PATCHES_A_BEAM = 5.0
PATCH_ALONG = 2.0
"""How much longer than wide the patches of foam are."""


@dataclass(frozen=True)
class Wake:
    """A boat that moves ahead."""

    x_m: float
    y_m: float
    """Where its amidships is."""
    yaw_rad: float
    """Where its bow points, counter-clockwise from world x."""
    length_m: float
    beam_m: float
    speed_mps: float

    @property
    def strength(self) -> float:
        """0 at rest, 1 from walking pace on."""
        return float(_smooth((self.speed_mps - SLOWEST_MPS) / (FULL_MPS - SLOWEST_MPS)))

    @property
    def wavelength_m(self) -> float:
        """Of the waves that follow the boat straight astern: they run as fast as it does."""
        return 2 * math.pi * self.speed_mps**2 / GRAVITY

    @property
    def reach_m(self) -> float:
        """How far behind the tip of the wedge the pattern has faded."""
        return 14 * self.length_m + 3 * self.wavelength_m

    @property
    def tip_m(self) -> float:
        """How far ahead of the amidships the wedge begins."""
        return (self.length_m + self.beam_m) / 2

    @property
    def amplitude_m(self) -> float:
        """Height of the waves beside the boat: grows with the Froude number and then is limited by the length."""
        froude2 = self.speed_mps**2 / (GRAVITY * self.length_m)
        return 0.03 * self.length_m * froude2 / (froude2 + 0.12) * self.strength

    def nearby(self, x_m: NDArray, y_m: NDArray) -> NDArray[np.bool_]:
        """Which points the wake may touch; all others are untouched."""
        if self.strength == 0:
            return np.zeros(np.shape(x_m), bool)
        astern, aside = _boat_frame(self, x_m, y_m)
        behind = astern + self.tip_m
        return (behind > 0) & (behind < self.reach_m) & (np.abs(aside) < CUSP * behind)


def wake_height(wake: Wake, x_m: NDArray, y_m: NDArray, spacing_m: NDArray | float = 0.0) -> Floats:
    """How much higher the water is because of the boat.

    Args:
        wake: the boat.
        x_m: of any shape.
        y_m: like ``x_m``.
        spacing_m: distance between neighbouring points, like ``x_m`` or one; waves that it cannot show are left out.

    Returns:
        Metres, like ``x_m``; zero outside the wedge and for a boat slower than 0.3 m/s.
    """
    height = np.zeros(np.shape(x_m), np.float32)
    near = wake.nearby(x_m, y_m)
    if not near.any():
        return height
    spacing = _near_spacing(spacing_m, near)
    astern, aside = (part[near] for part in _boat_frame(wake, x_m, y_m))
    aside = np.abs(aside)
    bow, stern = astern + wake.tip_m, astern - wake.length_m / 2
    # the hull pushes water up at its bow and lets it fall at its stern: two patterns of opposite sign
    total = _kelvin(wake, bow, aside, spacing) - 0.7 * _kelvin(wake, stern, aside, spacing)
    total += _bow_wave(wake, bow, aside) * resolved_share(wake.beam_m, spacing)
    height[near] = total * _smooth(2 * (1 - bow / wake.reach_m))
    return height


def wake_foam(wake: Wake, x_m: NDArray, y_m: NDArray, spacing_m: NDArray | float = 0.0) -> Floats:
    """Share 0 to 1 of the water that is white because of the boat, like ``x_m``; zero below 0.3 m/s."""
    foam = np.zeros(np.shape(x_m), np.float32)
    near = wake.nearby(x_m, y_m)
    if not near.any():
        return foam
    astern, aside = (part[near] for part in _boat_frame(wake, x_m, y_m))
    side, aside = aside, np.abs(aside)
    effort = float(_smooth(wake.speed_mps / 4)) * wake.strength
    stern = np.maximum(astern - 0.45 * wake.length_m, 0)
    width = wake.beam_m * (0.42 + 0.25 * np.sqrt(stern / wake.reach_m))
    life = np.exp(-stern / (FOAM_LIFE_S * wake.speed_mps))
    band = _smooth(1.6 * (1.15 - aside / width)) * life * (astern > 0.45 * wake.length_m) * (0.12 + 0.88 * effort)
    # along the bow wave's crest, thrown aside as the boat passes
    bow, hull = astern + wake.length_m / 2, _outline(wake, astern)
    past = np.maximum(bow, 0)
    crest = (aside - hull - 0.12 * past) / (0.10 * wake.beam_m + 0.05 * past)
    thrown = np.exp(-(crest**2)) * _smooth(4 * bow / wake.length_m) * np.exp(-past / (1.2 * wake.length_m))
    ring = np.exp(-(((aside - hull) / (0.05 * wake.beam_m)) ** 2)) * (np.abs(astern) < 0.5 * wake.length_m)
    share = np.maximum(np.maximum(band, effort * thrown), 0.6 * effort * ring)
    behind = astern + wake.tip_m
    inside = _smooth(8 * (1 - aside / (CUSP * behind))) * _smooth(2 * (1 - behind / wake.reach_m))
    # foam tears into patches as it thins
    patch_m = wake.beam_m / PATCHES_A_BEAM
    foam[near] = tear(share * inside, astern / PATCH_ALONG, side, patch_m, _near_spacing(spacing_m, near))
    return foam


def _kelvin(wake: Wake, behind: NDArray, aside: NDArray, spacing: NDArray) -> NDArray:
    """Waves of a pressure point at distances behind and aside of it, by stationary phase (Lighthill 1978, 3.10)."""
    k0 = GRAVITY / wake.speed_mps**2
    behind = np.maximum(behind, 1e-3 * wake.length_m)
    slant = np.clip(aside / behind, 1e-4, CUSP)
    root = np.sqrt(np.maximum(1 - 8 * slant**2, 0))
    fall = np.sqrt(wake.length_m / (behind + 0.5 * wake.length_m))
    edge = np.maximum(root, 0.15) ** -0.5  # both systems pile up where they meet, at the cusp
    total = np.zeros_like(behind)
    for tangent, shift, weight in (
        ((1 - root) / (4 * slant), math.pi / 4, 0.55),
        ((1 + root) / (4 * slant), -math.pi / 4, 0.8),
    ):
        k = k0 * (1 + tangent**2)
        phase = k0 * np.sqrt(1 + tangent**2) * (behind - aside * tangent)
        # a hull of some width makes no waves much shorter than that
        made = np.exp(-((k * wake.beam_m / 9) ** 2)) * resolved_share(2 * math.pi / k, spacing)
        height = np.minimum(wake.amplitude_m * fall * edge, STEEPEST / k) * made
        total += weight * height * np.cos(phase + shift)
    return total * _in_wedge(wake, behind, aside)


def _bow_wave(wake: Wake, bow: NDArray, aside: NDArray) -> NDArray:
    """The ridge that the bow pushes up, along the first third of the hull."""
    from_hull = (aside - 0.25 * np.minimum(bow, wake.length_m)) / (0.25 * wake.beam_m)
    along = (bow - 0.3 * wake.length_m) / (0.25 * wake.length_m)
    ridge = 0.9 * wake.amplitude_m * np.exp(-(from_hull**2) - along**2)
    return ridge * _in_wedge(wake, bow, aside)


def _in_wedge(wake: Wake, behind: NDArray, aside: NDArray) -> NDArray:
    """1 well inside the wedge behind a point, 0 outside, without steps; the narrow tip counts as its edge."""
    behind = np.maximum(behind, 1e-3 * wake.length_m)
    return _smooth(2.5 * (1 - aside / (CUSP * behind))) * _smooth(behind / (0.8 * wake.length_m))


def _outline(wake: Wake, astern: NDArray) -> NDArray:
    """Half the width of a plain hull's waterline."""
    along = np.clip(-2 * astern / wake.length_m, -1, 1)  # -1 stern, 1 bow
    return wake.beam_m / 2 * np.sqrt(np.clip(1 - np.clip((along + 0.2) / 1.2, 0, 1) ** 2.2, 0, 1)) * 0.92


def _boat_frame(wake: Wake, x_m: NDArray, y_m: NDArray) -> tuple[NDArray, NDArray]:
    c, s = math.cos(wake.yaw_rad), math.sin(wake.yaw_rad)
    x, y = np.asarray(x_m) - wake.x_m, np.asarray(y_m) - wake.y_m
    return -(c * x + s * y), c * y - s * x


def _near_spacing(spacing_m: NDArray | float, near: NDArray[np.bool_]) -> NDArray:
    return np.maximum(np.broadcast_to(np.asarray(spacing_m, float), near.shape)[near], 1e-6)


def _smooth(t: NDArray | float) -> NDArray:
    clipped = np.clip(t, 0, 1)
    return np.asarray(clipped * clipped * (3 - 2 * clipped))
