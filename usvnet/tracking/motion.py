"""A boat's motion as one camera sees it: modified polar coordinates, their dynamics, and the way to metres.

The state is (bearing, 1 / range, bearing rate, range rate / range), after Aidala and Hammel, "Utilization of modified
polar coordinates for bearings-only tracking", IEEE Trans. Automatic Control 28 (1983). It suits a camera above water:
a pixel's column is a bearing and its row is 1 / range (tan(depression) = height / range), so pixel noise and an error
of the camera's pitch are Gaussian, additive and of the same size at every range. In metres they would be skewed, and a
boat that happens to be seen too near would count as the surer one.

Ranges here are horizontal and bearings clockwise from the optical axis, as in :mod:`usvnet.types`; positions are (X, Z)
right and ahead of the camera. The camera stands or moves slowly, and does not turn; what it does move makes the motion
of the boats relative to it, which is what an encounter needs. float64 throughout.
"""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BEARING, INVERSE, TURN, GROWTH = range(4)
"""Places in the state: rad, 1/m, rad/s, and 1/s: the relative growth of the range."""


def advance(state: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Move a boat (4,) along a straight line at constant speed, exactly; returns its state and the Jacobian (4, 4)."""
    _, inverse, turn, growth = state
    along, across = 1 + growth * dt_s, turn * dt_s  # the new position in units of the old range, seen along the old ray
    square = along**2 + across**2
    root = np.sqrt(square)
    gain = growth * along + turn * across  # new position times velocity, in the same units
    by_turn, by_growth = 2 * across * dt_s, 2 * along * dt_s  # derivatives of the square
    moved = np.array([np.arctan2(across, along), inverse / root, turn / square, gain / square])
    moved[BEARING] += state[BEARING]
    J = np.eye(4)
    J[BEARING, TURN:] = along * dt_s / square, -across * dt_s / square
    J[INVERSE, INVERSE:] = 1 / root, -inverse * by_turn / (2 * root**3), -inverse * by_growth / (2 * root**3)
    J[TURN, TURN:] = 1 / square - turn * by_turn / square**2, -turn * by_growth / square**2
    J[GROWTH, TURN:] = (
        2 * turn * dt_s / square - gain * by_turn / square**2,
        (1 + 2 * growth * dt_s) / square - gain * by_growth / square**2,
    )
    return moved, J


def to_metres(state: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Position and velocity (X, Z, VX, VZ) of a state (4,), and the Jacobian (4, 4)."""
    bearing, inverse, turn, growth = state
    ahead = np.array([np.sin(bearing), np.cos(bearing)])
    right = np.array([np.cos(bearing), -np.sin(bearing)])
    reach = 1 / inverse
    position, velocity = reach * ahead, reach * (growth * ahead + turn * right)
    J = np.zeros((4, 4))
    J[:2, BEARING], J[2:, BEARING] = reach * right, reach * (growth * right - turn * ahead)
    J[:2, INVERSE], J[2:, INVERSE] = -reach * position, -reach * velocity
    J[2:, TURN], J[2:, GROWTH] = reach * right, reach * ahead
    return np.concatenate([position, velocity]), J


def from_metres(motion: FloatArray) -> FloatArray:
    """The state (4,) of a position and velocity (X, Z, VX, VZ)."""
    x, z, vx, vz = motion
    square = x * x + z * z
    return np.array([np.arctan2(x, z), square**-0.5, (vx * z - x * vz) / square, (x * vx + z * vz) / square])


def wandering(state: FloatArray, dt_s: float, wander_m_s: float) -> FloatArray:
    """Covariance (4, 4) of what a boat's unknown white acceleration adds to its state in ``dt_s``.

    Args:
        state: (4,) at the end of that time.
        dt_s: seconds.
        wander_m_s: standard deviation of the change of either component of the velocity in one second.
    """
    metres = np.kron([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]], np.eye(2)) * wander_m_s**2
    by_metres = np.linalg.inv(to_metres(state)[1])
    covariance: FloatArray = by_metres @ metres @ by_metres.T
    return covariance
