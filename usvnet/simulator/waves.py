"""The waves of a sea as sums of octaves of wavelength, each a periodic tile from a random spectrum.

Every octave from the peak wavelength down has the same slope variance, which is what the equilibrium range of a wind
sea looks like (Phillips 1958); where a grid is too coarse for an octave, that variance turns into roughness.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import SeaSpec
from usvnet.simulator.spline_tile import SplineTile

Floats = NDArray[np.float32]
SHORTEST_M = 0.03
"""Ripples shorter than this are not drawn: their slope is given to the waves that are."""
TILE_CELLS = 128
CELLS_A_WAVE = 4.0
"""Cells of a tile along its shortest wave; the spline through them is good to about a percent."""
SWELL_BAND = (0.8, 1.25)
"""Wavelengths of a swell, relative to its own."""
LONG_WAVE_M = 1.0
SPREAD_SWELL, SPREAD_LONG, SPREAD_SHORT = 12.0, 3.0, 1.2
"""Exponents s of the directional spread cos(angle / 2)^(2 s) (Longuet-Higgins et al. 1963)."""
FADE_FROM, FADE_OVER = 2.2, 2.5
"""Points to a wave at which a band begins to show, and how many more until it shows in full."""


@dataclass(frozen=True)
class Band:
    """Waves of about one length."""

    shortest_m: float
    longest_m: float
    slope_std: float
    height_std_m: float
    tile: SplineTile
    offset_m: tuple[float, float]

    @property
    def middle_m(self) -> float:
        """The band's wavelength."""
        return math.sqrt(self.shortest_m * self.longest_m)


class Sea:
    """A sea surface that was drawn once and can be read at any place."""

    def __init__(self, spec: SeaSpec):
        """Draw the waves from the spec's seed.

        Raises:
            ValueError: a slope is negative or a wavelength is not positive.
        """
        if min(spec.slope_std, spec.swell_slope_std) < 0:
            raise ValueError(f"slopes are {spec.slope_std} and {spec.swell_slope_std}, expected at least 0")
        if min(spec.peak_wavelength_m, spec.swell_wavelength_m) <= 0:
            raise ValueError(
                f"wavelengths are {spec.peak_wavelength_m} and {spec.swell_wavelength_m} m, expected more than 0"
            )
        self.spec = spec
        self.bands = tuple(_wind_bands(spec) + _swell_bands(spec))
        self.height_std_m = math.sqrt(sum(band.height_std_m**2 for band in self.bands))
        """Standard deviation of the height."""
        self.slope_std = math.sqrt(sum(band.slope_std**2 for band in self.bands))
        """Root mean square slope."""

    def heights(self, x_m: NDArray, y_m: NDArray, spacing_m: NDArray) -> tuple[Floats, Floats]:
        """Heights at the points of a grid whose rows have one spacing each.

        Args:
            x_m: (R, C)
            y_m: (R, C)
            spacing_m: (R,) distance between a row's points and their neighbours, in the wider direction.

        Returns:
            Heights (R, C) in metres, without the waves that such a spacing cannot show, and the slope variance (R,)
            of those waves.
        """
        heights = np.zeros(np.shape(x_m), np.float32)
        unresolved = np.zeros(len(spacing_m), np.float32)
        for band in self.bands:
            share = resolved_share(band.middle_m, spacing_m)
            unresolved += band.slope_std**2 * (1 - share * share)
            shown = np.flatnonzero(share > 0)
            if len(shown):
                rows = slice(shown[0], shown[-1] + 1)  # spacings mostly grow or shrink: one block
                x, y = x_m[rows] + band.offset_m[0], y_m[rows] + band.offset_m[1]
                heights[rows] += share[rows, None] * band.tile.sample(x, y)
        return heights, unresolved


def resolved_share(wavelength_m: float | NDArray, spacing_m: NDArray) -> Floats:
    """Share 0 to 1 of a wave's height that points of some spacing can show without false patterns."""
    points = np.clip((wavelength_m / np.asarray(spacing_m) - FADE_FROM) / FADE_OVER, 0, 1)
    return (points * points * (3 - 2 * points)).astype(np.float32)


def _wind_bands(spec: SeaSpec) -> list[Band]:
    if spec.slope_std == 0:
        return []
    octaves = max(1, math.floor(math.log2(spec.peak_wavelength_m / SHORTEST_M)))
    longest = [spec.peak_wavelength_m / 2**i for i in range(octaves)]
    slope = spec.slope_std / math.sqrt(octaves)
    return [
        _band(high / 2, high, slope, SPREAD_LONG if high > LONG_WAVE_M else SPREAD_SHORT, spec.wind_rad, [spec.seed, i])
        for i, high in enumerate(longest, start=1)
    ]


def _swell_bands(spec: SeaSpec) -> list[Band]:
    if spec.swell_slope_std == 0:
        return []
    low, high = (spec.swell_wavelength_m * edge for edge in SWELL_BAND)
    return [_band(low, high, spec.swell_slope_std, SPREAD_SWELL, spec.wind_rad, [spec.seed, 0])]


def _band(low_m: float, high_m: float, slope_std: float, spread: float, wind_rad: float, seeds: list[int]) -> Band:
    rng = np.random.default_rng(seeds)
    # tiles of unlike sizes, so that the bands do not repeat together
    side_m = low_m * TILE_CELLS / CELLS_A_WAVE * rng.uniform(0.9, 1.0)
    k = np.fft.fftfreq(TILE_CELLS, side_m / TILE_CELLS) * 2 * np.pi
    kx, ky = np.meshgrid(k, k)
    wavenumber = np.hypot(kx, ky)
    inside = (wavenumber >= 2 * np.pi / high_m) & (wavenumber < 2 * np.pi / low_m)
    angle = np.arctan2(ky[inside], kx[inside]) - wind_rad
    # height amplitude: slope variance is the same for each octave, and directions spread around the wind
    amplitude = np.abs(np.cos(angle / 2)) ** spread / wavenumber[inside] ** 2
    spectrum = np.zeros((TILE_CELLS, TILE_CELLS), np.complex128)
    spectrum[inside] = amplitude * (rng.standard_normal((2, inside.sum())).T @ np.array([1, 1j]))
    mirrored = np.roll(spectrum[::-1, ::-1], 1, (0, 1))
    spectrum = (spectrum + mirrored.conj()) / 2  # of a real field, to know its variances
    power = np.abs(spectrum / TILE_CELLS**2) ** 2
    scale = slope_std / math.sqrt((power * wavenumber**2).sum())
    offset_x, offset_y = rng.uniform(0, side_m, 2)
    return Band(
        low_m,
        high_m,
        slope_std,
        scale * math.sqrt(power.sum()),
        SplineTile(spectrum * scale, (side_m, side_m)),
        (float(offset_x), float(offset_y)),
    )
