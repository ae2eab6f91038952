"""What the filter claims to know is what it knows: consistency (NEES and NIS) over many simulated boats."""

import math

import numpy as np
import pytest

from tracking.simulated_boats import Sea
from usvnet.intervals import Z_90
from usvnet.tracking.filter import BoatFilter, Sighting
from usvnet.tracking.motion import to_metres

SPEED_STD_M_S, WANDER_M_S, CAMERA_S = 3.0, 0.1, 60.0


class Consistency:
    """Follows boats, each alone, with irregular steps and a fifth of the frames missing, and compares."""

    def __init__(self, boats=120, steps=24, step_s=0.15, lasting=0.0, believed=lambda sighting: sighting, seed=0):
        rng = np.random.default_rng(seed)
        self.nees, self.nis, self.inside = [], [], []
        for _ in range(boats):
            distance_m, bearing = rng.uniform(15, 50), rng.uniform(-0.4, 0.4)
            place = (distance_m * math.sin(bearing), distance_m * math.cos(bearing))
            velocity = rng.normal(0, SPEED_STD_M_S, 2)
            sea = Sea([(*place, *velocity)], rng, WANDER_M_S, lasting_share=lasting)
            follower = BoatFilter(believed(sea.sight()[0]), SPEED_STD_M_S, WANDER_M_S, lasting, 0.5, CAMERA_S)
            for _ in range(steps):
                dt_s = step_s * rng.uniform(0.2, 1.8)
                sea.advance(dt_s)
                follower.predict(dt_s)
                if rng.random() < 0.8:
                    sighting = believed(sea.sight()[0])
                    self.nis.append(follower.innovation(sighting).squared)
                    follower.update(sighting)
            self._compare(sea, follower)

    def _compare(self, sea, follower):
        state, P = follower.state[:4], follower.P[:4, :4]
        error = sea.states[0] - state
        self.nees.append(error @ np.linalg.solve(P, error))
        motion, J = to_metres(state)
        ahead = motion[:2] / np.linalg.norm(motion[:2])
        closing_std = math.sqrt(ahead @ (J @ P @ J.T)[2:, 2:] @ ahead)
        closing_error = ahead @ (sea.motions[0, 2:] - motion[2:])
        stds = np.sqrt(np.diag(P))
        self.inside.append([*(np.abs(error) < Z_90 * stds), abs(closing_error) < Z_90 * closing_std])


def test_errors_are_as_large_as_claimed():
    seen = Consistency()
    assert 0.8 < np.mean(seen.nees) / 4 < 1.25  # mean of 120: 1 +- 0.065
    assert 0.9 < np.mean(seen.nis) / 2 < 1.1  # mean of some 2300
    coverage = np.mean(seen.inside, axis=0)  # bearing, range, turn, growth, closing speed: 0.90 +- 0.027
    assert (coverage > 0.82).all()
    assert (coverage < 0.98).all()


def test_errors_that_last_for_several_frames_are_not_averaged_away():
    seen = Consistency(lasting=0.7, boats=80)
    assert 0.75 < np.mean(seen.nees) / 4 < 1.3
    assert 0.9 < np.mean(seen.nis) / 2 < 1.1


def test_a_later_sighting_is_never_worth_less_than_the_first():
    seen = Sighting(0.1, 0.002, 0.1, 0.005, 0.003)
    follower = BoatFilter(seen, 5.0, 0.3, 0.5, 0.5, 60.0)
    first = follower.P[:2, :2].copy()
    for _ in range(30):
        follower.predict(0.1)
        follower.update(seen)
        assert (np.diag(follower.P)[:2] < 1.001 * np.diag(first)).all()


def test_a_camera_error_taken_for_noise_makes_overconfident():
    def white(sighting):
        return sighting._replace(
            inverse_std_per_m=math.hypot(sighting.inverse_std_per_m, sighting.common_std_per_m), common_std_per_m=0.0
        )

    seen = Consistency(boats=60, believed=white)
    assert np.mean(seen.nees) / 4 > 1.5


def test_range_is_never_surer_than_the_camera():
    follower = BoatFilter(Sighting(0.1, 0.001, 0.02, 0.001, 0.0005), 1.0, 0.01, 0.0, 0.5, 1e6)
    for _ in range(400):
        follower.predict(0.1)
        follower.update(Sighting(0.1, 0.001, 0.02, 0.001, 0.0005))
    assert math.sqrt(follower.P[1, 1]) == pytest.approx(0.0005, rel=0.25)
    assert follower.state[1] == pytest.approx(0.02, rel=1e-6)


def test_bearing_alone_teaches_the_bearing():
    follower = BoatFilter(Sighting(0.1, 0.01, 0.02, 0.001, 0.0005), 1.0, 0.1, 0.0, 0.5, 60.0)
    follower.predict(0.1)
    before = follower.P.copy()
    follower.update(Sighting(0.11, 0.001, math.nan, math.nan, math.nan))
    assert follower.P[0, 0] < 0.05 * before[0, 0]
    assert follower.P[1, 1] == pytest.approx(before[1, 1])
    assert follower.state[0] == pytest.approx(0.11, abs=0.001)


def test_bearings_behind_the_camera_do_not_turn_around():
    follower = BoatFilter(Sighting(math.pi - 0.001, 0.01, 0.02, 0.001, 0.0), 1.0, 0.1, 0.0, 0.5, 60.0)
    follower.update(Sighting(-math.pi + 0.001, 0.01, 0.02, 0.001, 0.0))
    assert abs(follower.state[0]) == pytest.approx(math.pi, abs=0.001)
