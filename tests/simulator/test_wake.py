import dataclasses
import math

import numpy as np
import pytest

from usvnet.simulator.wake import Wake, wake_foam, wake_height

BOAT = Wake(3.0, 20.0, 0.7, 3.0, 1.2, 2.0)


def plane(count=700, size_m=50.0):
    x, y = np.meshgrid(*[np.linspace(-size_m, size_m, count)] * 2)
    return x + BOAT.x_m, y + BOAT.y_m


def boat_frame(x, y):
    """Metres behind the amidships, and aside."""
    c, s = math.cos(BOAT.yaw_rad), math.sin(BOAT.yaw_rad)
    return -(c * (x - BOAT.x_m) + s * (y - BOAT.y_m)), c * (y - BOAT.y_m) - s * (x - BOAT.x_m)


def test_the_wake_lies_in_the_kelvin_wedge_behind_the_bow():
    x, y = plane()
    astern, aside = boat_frame(x, y)
    outside = np.abs(aside) > math.tan(math.radians(19.48)) * (astern + BOAT.length_m / 2 + BOAT.beam_m / 2)
    for part in (wake_height(BOAT, x, y), wake_foam(BOAT, x, y)):
        assert not part[outside].any()
        assert np.abs(part[~outside]).max() > 0.01


@pytest.mark.parametrize("speed", [0.0, 0.29, 0.3])
def test_a_boat_at_rest_leaves_no_wake(speed):
    x, y = plane(100)
    still = dataclasses.replace(BOAT, speed_mps=speed)
    assert not wake_height(still, x, y).any()
    assert not wake_foam(still, x, y).any()
    assert not still.nearby(x, y).any()


def test_a_faster_boat_makes_higher_waves_up_to_a_share_of_its_length():
    x, y = plane(400, 80.0)
    heights = [np.abs(wake_height(dataclasses.replace(BOAT, speed_mps=v), x, y)).max() for v in (0.6, 1, 2, 4, 12)]
    assert (np.diff(heights) > 0).all()
    assert heights[-1] < 0.08 * BOAT.length_m


def test_waves_astern_are_as_long_as_the_speed_says():
    boat = dataclasses.replace(BOAT, yaw_rad=math.pi, x_m=0.0, y_m=0.0, speed_mps=3.0)  # its wake runs along x
    x = np.arange(6.0, 30.0, 0.02)
    height = wake_height(boat, x, np.zeros_like(x))
    crests = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] > height[2:]))
    assert np.diff(x[crests]).mean() == pytest.approx(2 * math.pi * 3.0**2 / 9.81, rel=0.1)


def test_the_wake_fades_without_a_step():
    x, y = plane(900, 90.0)
    boat = dataclasses.replace(BOAT, speed_mps=3.0)
    fine = 1e-3
    height = wake_height(boat, x, y)
    assert np.abs(wake_height(boat, x + fine, y) - height).max() < 0.6 * fine
    astern, _ = boat_frame(x, y)
    assert not height[astern + boat.tip_m > boat.reach_m].any()


def test_waves_that_a_coarse_grid_would_alias_are_left_out():
    x, y = plane(200)
    assert not wake_height(BOAT, x, y, 10.0).any()
    assert np.array_equal(wake_height(BOAT, x, y, 1e-3), wake_height(BOAT, x, y))


def test_foam_is_behind_the_transom_and_grows_with_speed():
    x, y = plane()
    astern, aside = boat_frame(x, y)
    band = (astern > 0.5 * BOAT.length_m) & (astern < 1.5 * BOAT.length_m) & (np.abs(aside) < BOAT.beam_m / 3)
    share = [wake_foam(dataclasses.replace(BOAT, speed_mps=v), x, y)[band].mean() for v in (0.6, 1.5, 3.0)]
    assert 0 < share[0] < share[1] < share[2] <= 1
    foam = wake_foam(BOAT, x, y)
    assert foam.min() >= 0
    assert foam.max() <= 1
    assert not foam[astern > BOAT.reach_m].any()


def test_the_wake_turns_with_the_boat():
    ahead = np.random.default_rng(0).uniform(-20, 5, (500, 2))
    c, s = math.cos(1.1), math.sin(1.1)
    turned = ahead @ np.array([[c, s], [-s, c]])
    first, second = Wake(0, 0, 0.0, 3, 1.2, 2), Wake(4, -7, 1.1, 3, 1.2, 2)
    assert np.allclose(wake_height(first, *ahead.T), wake_height(second, turned[:, 0] + 4, turned[:, 1] - 7), atol=1e-5)
