import math

import numpy as np
import pytest

from usvnet.simulator.air import add_rain, extinction_per_m, through_air, transmittance
from usvnet.simulator.frame_spec import AirSpec

FOG = AirSpec(50.0, 0.0)


def test_two_percent_of_the_contrast_is_left_at_the_visibility():
    depth = np.full((4, 4), 50.0, np.float32)
    black, white = np.zeros((4, 4, 3), np.float32), np.ones((4, 4, 3), np.float32)
    share = transmittance(depth, FOG, 1, fog=True)
    light = np.full((4, 4, 3), 0.7, np.float32)
    assert (through_air(white, share, light) - through_air(black, share, light)).mean() == pytest.approx(0.02, rel=1e-3)


def test_an_outline_is_the_mean_of_its_parts_and_not_the_air_of_their_mean_depth():
    depth = np.array([[5.0, np.inf], [5.0, np.inf]], np.float32)
    share = transmittance(depth, FOG, 2, fog=True)
    assert share.shape == (1, 1)
    assert share[0, 0] == pytest.approx(0.5 * math.exp(-3.912 * 5 / 50), rel=1e-5)


def test_the_sky_is_all_air_in_fog_and_untouched_otherwise():
    sky = np.full((2, 2), np.inf, np.float32)
    assert transmittance(sky, FOG, 1, fog=True).max() == 0
    assert transmittance(sky, FOG, 1, fog=False).min() == 1


def test_rain_shortens_the_view_and_brightens_what_is_dark():
    dry, wet = AirSpec(10_000, 0.0), AirSpec(10_000, 20.0)
    assert extinction_per_m(wet) > 2 * extinction_per_m(dry)
    radiance = np.full((120, 160, 3), 0.05, np.float32)
    radiance[:30] = 1.0
    assert add_rain(radiance, dry, np.random.default_rng(0)) is radiance
    drops = add_rain(radiance, wet, np.random.default_rng(0))
    assert drops[30:].mean() > radiance[30:].mean() * 1.01
    assert np.array_equal(drops, add_rain(radiance, wet, np.random.default_rng(0)))
    heavier = add_rain(radiance, AirSpec(10_000, 60.0), np.random.default_rng(0))
    assert (heavier != radiance).mean() > (drops != radiance).mean()
