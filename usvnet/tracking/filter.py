"""One boat's Kalman filter: bearing and 1 / range in, state with covariance out.

What is uncertain is of three kinds, and each is treated as what it is:

- White noise (keypoints, waves) is new in every frame. Frames that follow faster than it changes repeat it, and count
  for less accordingly.
- The camera's own error (pitch, roll, height, focal length) is the same in all frames, or drifts slowly. Averaging does
  not make it smaller, so it is a fifth state with a variance of 1, in standard deviations of 1 / range, which forgets
  itself exponentially (first-order Gauss-Markov). Taken for white noise it would let a range seem ten times surer
  after a hundred frames. Each boat has its own copy: what another boat would tell about the same error is left unused,
  which keeps the boats apart, and is calibrated for each of them.
- A boat's own manoeuvres are white acceleration (see :func:`usvnet.tracking.motion.wandering`).

The measurement is linear in the state; only the motion is linearised, which makes this an extended Kalman filter.
"""

import math
from typing import NamedTuple

import numpy as np

from usvnet.tracking.motion import BEARING, INVERSE, FloatArray, advance, wandering

COMMON = 4
"""Place of the camera's error in the state."""
LEAST_INVERSE_PER_M = 1e-5
"""A boat is never farther away than the reciprocal of this."""
LOST_S = 1e4
"""A longer step than this says no more."""


class Sighting(NamedTuple):
    """What one frame says about a boat."""

    bearing_rad: float
    bearing_std_rad: float
    """White noise."""
    inverse_per_m: float
    """1 / horizontal range; nan where the boat has no range, and only its bearing counts."""
    inverse_std_per_m: float
    """White noise."""
    common_std_per_m: float
    """What the camera's errors, the same in all frames, make of 1 / range."""

    @property
    def ranged(self) -> bool:
        """Whether there is a range."""
        return math.isfinite(self.inverse_per_m)


class Innovation(NamedTuple):
    """A sighting less what was expected of it."""

    difference: FloatArray
    """(2,) or, without a range, (1,)."""
    H: FloatArray
    """(2 or 1, 5) derivative of the expected sighting to the state."""
    noise: FloatArray
    """(2 or 1,) white variances."""
    S: FloatArray
    """Covariance of the difference."""

    @property
    def squared(self) -> float:
        """Squared Mahalanobis distance: chi-squared with as many degrees of freedom as the sighting has numbers."""
        return float(self.difference @ np.linalg.solve(self.S, self.difference))


class BoatFilter:
    """Follows one boat from its first sighting with a range.

    Args:
        first: that sighting.
        speed_std_m_s: standard deviation of either component of a new boat's velocity.
        wander_m_s: how much either changes in one second (see :func:`usvnet.tracking.motion.wandering`).
        noise_correlation_s: time in which white noise forgets itself; 0 where it is new in every frame.
        camera_correlation_s: time in which the camera's error does.

    Attributes:
        state: (5,) bearing, 1 / range, bearing rate, relative range rate, and the camera's error.
        P: (5, 5) its covariance.
    """

    def __init__(
        self,
        first: Sighting,
        speed_std_m_s: float,
        wander_m_s: float,
        noise_correlation_s: float,
        camera_correlation_s: float,
    ) -> None:
        self.wander_m_s = wander_m_s
        self.noise_correlation_s = noise_correlation_s
        self.camera_correlation_s = camera_correlation_s
        self.state = np.array([first.bearing_rad, first.inverse_per_m, 0.0, 0.0, 0.0])
        rate = (speed_std_m_s * first.inverse_per_m) ** 2
        inverse = first.inverse_std_per_m**2 + first.common_std_per_m**2
        self.P = np.diag([first.bearing_std_rad**2, inverse, rate, rate, 1.0])
        self.P[INVERSE, COMMON] = self.P[COMMON, INVERSE] = -first.common_std_per_m
        self.unseen_s = 0.0

    def predict(self, dt_s: float) -> None:
        """Let time pass."""
        dt_s = min(max(dt_s, 0.0), LOST_S)
        self.unseen_s += dt_s
        kept = math.exp(-dt_s / self.camera_correlation_s)
        F = np.eye(5)
        self.state[:4], F[:4, :4] = advance(self.state[:4], dt_s)
        self.state[COMMON] *= kept
        F[COMMON, COMMON] = kept
        self.P = F @ self.P @ F.T
        self.P[:4, :4] += wandering(self.state[:4], dt_s, self.wander_m_s)
        self.P[COMMON, COMMON] += 1 - kept**2
        self._bound()

    def innovation(self, sighting: Sighting) -> Innovation:
        """Compare a sighting of now with what is expected."""
        H = np.zeros((2, 5))
        H[0, BEARING] = H[1, INVERSE] = 1.0
        H[1, COMMON] = sighting.common_std_per_m
        difference = np.array([sighting.bearing_rad, sighting.inverse_per_m]) - H @ self.state
        difference[0] = math.remainder(difference[0], 2 * math.pi)
        noise = np.array([sighting.bearing_std_rad, sighting.inverse_std_per_m]) ** 2
        if not sighting.ranged:
            difference, H, noise = difference[:1], H[:1], noise[:1]
        return Innovation(difference, H, noise, H @ self.P @ H.T + np.diag(noise))

    def update(self, sighting: Sighting) -> None:
        """Learn from a sighting of now."""
        found = self.innovation(sighting)
        noise = np.diag(found.noise) * self._repetition()
        S = found.H @ self.P @ found.H.T + noise
        gain = np.linalg.solve(S, found.H @ self.P).T
        self.state = self.state + gain @ found.difference
        rest = np.eye(5) - gain @ found.H
        self.P = rest @ self.P @ rest.T + gain @ noise @ gain.T  # Joseph's form stays positive
        self.unseen_s = 0.0
        self._bound()

    def _repetition(self) -> float:
        """As many sightings with this noise as say no more than one with new noise."""
        if not self.noise_correlation_s:
            return 1.0
        return 1 / math.tanh(
            max(self.unseen_s, 1e-3) / (2 * self.noise_correlation_s)
        )  # (1 + r) / (1 - r), r its correlation

    def _bound(self) -> None:
        self.state[BEARING] = math.remainder(self.state[BEARING], 2 * math.pi)
        self.state[INVERSE] = max(self.state[INVERSE], LEAST_INVERSE_PER_M)
