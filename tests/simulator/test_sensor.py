import numpy as np
import pytest

from usvnet.simulator.frame_spec import SensorSpec
from usvnet.simulator.sensor import _noise, expose


def spec(**changes):
    return SensorSpec(
        **{"exposure_key": 0.18, "noise_gain": 0.0005, "blur_px": 0.5, "jpeg_quality": 90, "seed": 3, **changes}
    )


def linear(picture):
    """Undo the sRGB curve."""
    s = picture / 255.0
    return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4)


def grey(level=0.5, shape=(96, 128)):
    return np.full((*shape, 3), level, np.float32)


def test_exposure_does_not_depend_on_how_bright_the_day_is():
    dark, bright = expose(grey(0.01), spec()), expose(grey(100.0), spec())
    assert np.abs(dark.astype(int) - bright).mean() < 0.1


@pytest.mark.parametrize("key", [0.06, 0.18, 0.4])
def test_a_grey_scene_lands_near_its_key(key):
    middle = linear(expose(grey(), spec(exposure_key=key)))[40:56, 56:72].mean()
    shoulder = key * (1 + key / 6) / (1 + 0.55 * key)
    assert middle == pytest.approx(shoulder, rel=0.15)


def test_a_brighter_key_is_a_brighter_picture():
    levels = [expose(grey(), spec(exposure_key=key)).mean() for key in (0.05, 0.1, 0.2, 0.4)]
    assert levels == sorted(levels)
    assert levels[-1] > 2 * levels[0]


def test_noise_grows_with_its_gain():
    spread = [expose(grey(), spec(noise_gain=gain))[40:56, 56:72].std() for gain in (0.0001, 0.001, 0.006)]
    assert spread[0] < spread[1] < spread[2]
    assert spread[2] > 3 * spread[0]


@pytest.mark.parametrize("gain", [0.0005, 0.005])
def test_noise_has_the_variance_that_its_gain_says(gain):
    light = grey(0.1, (400, 400))
    noise = _noise(light, gain, np.random.default_rng(0))
    assert noise.var() == pytest.approx(gain * 0.1 + (0.9 * gain) ** 2 + 2e-6, rel=0.02)


def test_a_lens_without_blur_is_possible():
    assert expose(grey(), spec(blur_px=0.0)).std() > 0


def test_the_sun_blooms_and_does_not_darken_the_rest():
    sun = grey()
    sun[40:44, 60:64] = 5000.0
    without, with_sun = expose(grey(), spec()), expose(sun, spec())
    assert with_sun[41, 61].min() >= 250
    assert with_sun[36:48, 56:68].mean() > without[36:48, 56:68].mean() + 30
    assert abs(with_sun[5:20, 5:20].mean() - without[5:20, 5:20].mean()) < 8


def test_blur_softens_an_edge():
    edge = grey(0.1)
    edge[:, 64:] = 0.6
    sharp, soft = (
        np.abs(np.diff(expose(edge, spec(blur_px=b, noise_gain=1e-6))[48, :, 1].astype(int))).max() for b in (0.3, 1.5)
    )
    assert sharp > 1.5 * soft


def test_the_same_seed_is_the_same_picture():
    assert np.array_equal(expose(grey(), spec()), expose(grey(), spec()))
    assert not np.array_equal(expose(grey(), spec()), expose(grey(), spec(seed=4)))


def test_night_and_nothing_are_pictures_too():
    for level in (0.0, 1e-9):
        picture = expose(grey(level), spec())
        assert picture.dtype == np.uint8
        assert picture.shape == (96, 128, 3)
