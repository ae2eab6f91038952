"""Straight lines stay straight, and every Jacobian is the derivative that it claims to be."""

import numpy as np
import pytest

from usvnet.tracking.motion import advance, from_metres, to_metres, wandering

MOTIONS = [(3.0, 20.0, 1.0, -2.0), (-8.0, 5.0, 0.0, 0.0), (0.0, 40.0, -3.0, 0.0), (1.0, 10.0, -0.2, -12.0)]


def jacobian(function, at, step=1e-6):
    columns = [(function(at + step * unit) - function(at - step * unit)) / (2 * step) for unit in np.eye(len(at))]
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("dt_s", [0.0, 0.04, 1.0, 7.0])
def test_a_boat_moves_along_a_straight_line(motion, dt_s):
    x, z, vx, vz = motion
    moved, J = advance(from_metres(np.array(motion)), dt_s)
    expected = from_metres(np.array([x + vx * dt_s, z + vz * dt_s, vx, vz]))
    difference = moved - expected
    difference[0] = np.angle(np.exp(1j * difference[0]))
    np.testing.assert_allclose(difference, 0, atol=1e-12)
    state = from_metres(np.array(motion))
    np.testing.assert_allclose(J, jacobian(lambda s: advance(s, dt_s)[0], state), rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("motion", MOTIONS)
def test_metres_and_back(motion):
    metres, J = to_metres(from_metres(np.array(motion)))
    np.testing.assert_allclose(metres, motion, atol=1e-12)
    np.testing.assert_allclose(J @ jacobian(from_metres, metres), np.eye(4), atol=1e-5)


def test_two_short_wanders_are_one_long_one():
    state = from_metres(np.array([2.0, 30.0, 0.0, 0.0]))
    F = advance(state, 0.5)[1]
    half = wandering(state, 0.5, 0.3)
    np.testing.assert_allclose(F @ half @ F.T + half, wandering(state, 1.0, 0.3), rtol=1e-9, atol=1e-15)
