import math

import numpy as np
import pytest

from usvnet.simulator.frame_spec import SeaSpec
from usvnet.simulator.spline_tile import SplineTile
from usvnet.simulator.waves import Sea
from usvnet.simulator.whitecaps import whitecaps

WATER = (0.012, 0.024, 0.028)


def spec(slope=0.08, peak=2.0, wind=0.4, swell=0.0, swell_m=6.0, foam=0.0, seed=3):
    return SeaSpec(slope, peak, wind, swell, swell_m, foam, WATER, seed)


def places(count=300, size_m=80.0):
    return np.random.default_rng(0).uniform(-size_m, size_m, (2, count, count))


def heights(sea, x, y, spacing_m=1e-3):
    return sea.heights(x, y, np.full(len(x), spacing_m))[0].astype(float)


@pytest.mark.parametrize("wanted", [spec(), spec(0.1, 8.0, -2.0), spec(0.03, 1.0, swell=0.05), spec(0, swell=0.06)])
def test_slope_and_height_are_as_asked_and_as_reported(wanted):
    sea, (x, y), e = Sea(wanted), places(), 0.002
    along = (heights(sea, x + e, y) - heights(sea, x - e, y)) / (2 * e)
    across = (heights(sea, x, y + e) - heights(sea, x, y - e)) / (2 * e)
    asked = math.hypot(wanted.slope_std, wanted.swell_slope_std)
    assert sea.slope_std == pytest.approx(asked)
    assert np.mean(along**2 + across**2) == pytest.approx(asked**2, rel=0.1)
    assert heights(sea, x, y).std() == pytest.approx(sea.height_std_m, rel=0.1)


def test_waves_run_with_the_wind():
    for wind in (0.0, 1.2):
        sea, (x, y), e = Sea(spec(0.1, 8.0, wind)), places(), 0.02
        dx, dy = e * math.cos(wind), e * math.sin(wind)
        along = heights(sea, x + dx, y + dy) - heights(sea, x, y)
        across = heights(sea, x - dy, y + dx) - heights(sea, x, y)
        assert along.std() > 1.05 * across.std()


def test_no_wave_is_longer_than_the_peak():
    sea, side, count = Sea(spec(0.1, peak=2.0)), 51.2, 512
    x, y = np.meshgrid(*[np.arange(count) * side / count] * 2)
    taper = np.hanning(count)[:, None] * np.hanning(count)
    power = np.abs(np.fft.fft2(heights(sea, x, y) * taper)) ** 2
    waves = np.hypot(*np.meshgrid(*[np.fft.fftfreq(count, side / count)] * 2))
    assert power[waves < 1 / 2.0 - 2 / side].sum() < 1e-3 * power.sum()
    assert power[(waves > 1 / 2.0) & (waves < 1 / 1.0)].sum() > 0.3 * power.sum()


def test_what_a_grid_cannot_show_becomes_unresolved_slope():
    sea, (x, y) = Sea(spec(0.1, 8.0)), places(60)
    spacing = np.geomspace(1e-3, 100, len(x))
    shown, unresolved = sea.heights(x, y, spacing)
    assert unresolved[0] == pytest.approx(0, abs=1e-9)
    assert unresolved[-1] == pytest.approx(0.1**2, rel=1e-4)
    assert (np.diff(unresolved) >= -1e-9).all()
    assert np.abs(shown[0]).max() > 0
    assert not shown[-1].any()


def test_rows_do_not_depend_on_the_other_rows():
    sea, (x, y) = Sea(spec(swell=0.02)), places(40)
    spacing = np.random.default_rng(1).permutation(np.geomspace(1e-3, 3, len(x)))
    together, unresolved = sea.heights(x, y, spacing)
    for row in range(0, len(x), 7):
        one, rough = sea.heights(x[row : row + 1], y[row : row + 1], spacing[row : row + 1])
        assert np.array_equal(one[0], together[row])
        assert rough[0] == unresolved[row]


def test_the_same_spec_is_the_same_sea_and_another_seed_another():
    x, y = places(50)
    first = heights(Sea(spec(swell=0.02)), x, y)
    assert np.array_equal(first, heights(Sea(spec(swell=0.02)), x, y))
    assert np.abs(first - heights(Sea(spec(swell=0.02, seed=4)), x, y)).max() > 0.01


def test_still_water_is_flat():
    sea, (x, y) = Sea(spec(0.0)), places(20)
    assert not heights(sea, x, y).any()
    assert sea.height_std_m == sea.slope_std == 0


def test_nonsense_is_refused():
    with pytest.raises(ValueError, match="slopes"):
        Sea(spec(-0.1))
    with pytest.raises(ValueError, match="wavelengths"):
        Sea(spec(peak=0.0))


def test_a_spline_tile_is_the_wave_it_was_made_of_even_far_away():
    spectrum = np.zeros((64, 64), complex)
    spectrum[3, 7] = 64**2  # 7 waves along x and 3 along y
    tile = SplineTile(spectrum, (20.0, 10.0))
    x, y = places(80, 3000.0)
    assert np.abs(tile.sample(x, y) - np.cos(2 * np.pi * (7 * x / 20 + 3 * y / 10))).max() < 5e-3
    near = np.arange(2000) * 1e-4  # no terraces between the samples
    steps = np.diff(tile.sample(near, np.zeros(2000)).astype(float), 2)
    assert np.abs(steps).max() < 1e-6


@pytest.mark.parametrize("share", [0.01, 0.04])
def test_whitecaps_cover_the_share_asked_for(share):
    x, y = np.meshgrid(*[np.linspace(-60, 60, 700)] * 2)
    for seed in (1, 2):
        foam = whitecaps(spec(0.1, 4.0, foam=share, seed=seed), x, y, np.full(700, 0.01))
        assert share / 1.5 < foam.mean() < share * 1.5
        assert foam.min() >= 0
        assert 0.8 < foam.max() <= 1
        assert (foam > 0).mean() < 6 * share  # patches, not a veil


def test_far_whitecaps_become_their_mean_and_none_are_none():
    x, y = places(40)
    assert np.allclose(whitecaps(spec(foam=0.03), x, y, np.full(40, 50.0)), 0.03)
    assert not whitecaps(spec(foam=0.0), x, y, np.full(40, 0.01)).any()
