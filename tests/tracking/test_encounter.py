"""Closest points of approach against closed forms, their standard deviations against many draws."""

import math

import numpy as np
import pytest

from usvnet.tracking.encounter import encounter

CERTAIN = 1e-12 * np.eye(4)


@pytest.mark.parametrize(
    ("motion", "cpa_m", "tcpa_s"),
    [
        ((0.0, 100.0, 0.0, -5.0), 0.0, 20.0),  # head on
        ((30.0, 100.0, 0.0, -5.0), 30.0, 20.0),  # passes to starboard
        ((-30.0, 100.0, 0.0, -5.0), 30.0, 20.0),
        ((40.0, 30.0, -4.0, -3.0), 0.0, 10.0),  # steady bearing, shrinking range: a collision
        ((50.0, 50.0, -2.0, 0.0), 50.0, 25.0),  # crosses ahead
        ((10.0, 0.0, 0.0, 2.0), 10.0, 0.0),  # abeam, nearest now
        ((30.0, 40.0, 3.0, 4.0), 0.0, -10.0),  # left us ten seconds ago
    ],
)
def test_two_straight_tracks(motion, cpa_m, tcpa_s):
    met = encounter(np.array(motion), CERTAIN)
    assert met.cpa_m == pytest.approx(cpa_m, abs=1e-12)
    assert met.tcpa_s == pytest.approx(tcpa_s, abs=1e-12)
    place = np.array(motion[:2]) + tcpa_s * np.array(motion[2:])
    assert math.hypot(*place) == pytest.approx(cpa_m, abs=1e-9)


def test_standard_deviations_are_those_of_many_draws():
    rng = np.random.default_rng(0)
    mean = np.array([35.0, 80.0, -1.0, -4.0])
    mix = rng.normal(size=(4, 4)) * np.array([0.5, 0.8, 0.03, 0.04])[:, None]
    met = encounter(mean, mix @ mix.T)
    draws = [encounter(mean + mix @ rng.normal(size=4), CERTAIN) for _ in range(4000)]
    assert met.cpa_std_m == pytest.approx(np.std([draw.cpa_m for draw in draws]), rel=0.05)
    assert met.tcpa_std_s == pytest.approx(np.std([draw.tcpa_s for draw in draws]), rel=0.05)


def test_a_boat_that_may_be_at_rest_meets_nobody():
    covariance = np.diag([1.0, 1.0, 0.25, 0.25])
    assert encounter(np.array([0.0, 50.0, 0.0, -1.5]), covariance) is None  # 3 standard deviations
    assert encounter(np.array([0.0, 50.0, 0.0, -1.6]), covariance) is not None
    assert encounter(np.array([0.0, 50.0, 0.0, 0.0]), covariance) is None
