"""One boat's Kalman filter: bearing and 1 / range in, state with covariance out.

What makes a sighting wrong is of two kinds. What lasts of either is a state, in standard deviations, that forgets
itself exponentially (first-order Gauss-Markov):

- What is the boat's own (keypoints, waves) is in part new in every frame, and so white noise, and in part lasts for a
  fraction of a second: one state for the bearing and one for 1 / range. Frames that follow faster repeat it, and say
  little new.
- The camera's error (pitch, roll, height, focal length) is the same in all frames or drifts slowly. Averaging does not
  make it smaller: taken for white noise it would let a range seem ten times surer after a hundred frames. Each boat
  has its own copy: what another boat would tell about the same error is left unused, which keeps the boats apart, and
  is calibrated for each of them.

A boat's own manoeuvres are white acceleration (see :func:`usvnet.tracking.motion.wandering`). The measurement is linear
in the state; only the motion is linearised, which makes this an extended Kalman filter.
"""

import math
from typing import NamedTuple

import numpy as np

from usvnet.tracking.motion import BEARING, INVERSE, FloatArray, advance, wandering

SIZE = 7
NOISE, CAMERA = slice(4, 6), 6
"""Places of the errors in the state: the boat's own of bearing and of 1 / range, and the camera's of 1 / range."""
LEAST_INVERSE_PER_M = 1e-5
"""A boat is never farther away than the reciprocal of this."""
LONGEST_S = 1e4
"""A longer step than this says no more."""


class Sighting(NamedTuple):
    """What one frame says about a boat."""

    bearing_rad: float
    """nan where not even that is known: such a sighting is of no boat."""
    bearing_std_rad: float
    """Of the boat's own error."""
    inverse_per_m: float
    """1 / horizontal range; nan where the boat has no range, and only its bearing counts."""
    inverse_std_per_m: float
    """Of the boat's own error."""
    common_std_per_m: float
    """Of what the camera's errors, the same in all frames, make of 1 / range."""

    @property
    def ranged(self) -> bool:
        """Whether there is a range."""
        return math.isfinite(self.inverse_per_m)


class Innovation(NamedTuple):
    """A sighting less what was expected of it."""

    difference: FloatArray
    """(2,) or, without a range, (1,)."""
    H: FloatArray
    """(2 or 1, 7) derivative of the expected sighting to the state."""
    white: FloatArray
    """(2 or 1,) variance of the white noise."""
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
        lasting_share: part of the variance of the boat's own error that lasts, from 0 to below 1.
        noise_correlation_s: for so long.
        camera_correlation_s: time in which the camera's error does.

    Attributes:
        state: (7,) bearing, 1 / range, bearing rate, relative range rate, and the errors.
        P: (7, 7) its covariance.
        unseen_s: time since it was last seen.
    """

    def __init__(
        self,
        first: Sighting,
        speed_std_m_s: float,
        wander_m_s: float,
        lasting_share: float,
        noise_correlation_s: float,
        camera_correlation_s: float,
    ) -> None:
        self.wander_m_s = wander_m_s
        self.lasting_share = lasting_share
        self.correlations_s = (noise_correlation_s, noise_correlation_s, camera_correlation_s)
        self.state = np.array([first.bearing_rad, first.inverse_per_m, *[0.0] * (SIZE - 2)])
        rate = (speed_std_m_s * first.inverse_per_m) ** 2
        self.P = np.diag([0.0, 0.0, rate, rate, 1.0, 1.0, 1.0])
        H, white = _model(first, lasting_share)
        by_error = -H[:, 4:]  # what is sighted is known, so the boat is where the errors leave it
        self.P[:2, 4:], self.P[4:, :2] = by_error, by_error.T
        self.P[:2, :2] = by_error @ by_error.T + np.diag(white)
        self.unseen_s = 0.0

    def predict(self, dt_s: float) -> None:
        """Let time pass."""
        dt_s = min(max(dt_s, 0.0), LONGEST_S)
        self.unseen_s += dt_s
        kept = np.exp(-dt_s / np.array(self.correlations_s))
        F = np.diag([*[1.0] * 4, *kept])
        self.state[:4], F[:4, :4] = advance(self.state[:4], dt_s)
        self.state[4:] *= kept
        self.P = F @ self.P @ F.T
        self.P[:4, :4] += wandering(self.state[:4], dt_s, self.wander_m_s)
        self.P[4:, 4:] += np.diag(1 - kept**2)
        self._bound()

    def innovation(self, sighting: Sighting, lasting_share: float | None = None) -> Innovation:
        """Compare a sighting of now with what is expected.

        Args:
            sighting: it may be another boat's.
            lasting_share: in place of the filter's own. With 0, nothing is expected of the boat's own error: then S is
                true whether that lasts or not, and safe to tell boats apart by.
        """
        H, white = _model(sighting, self.lasting_share if lasting_share is None else lasting_share)
        difference = np.array([sighting.bearing_rad, sighting.inverse_per_m]) - H @ self.state
        difference[0] = math.remainder(difference[0], 2 * math.pi)
        size = 2 if sighting.ranged else 1
        difference, H, white = difference[:size], H[:size], white[:size]
        return Innovation(difference, H, white, H @ self.P @ H.T + np.diag(white))

    def update(self, sighting: Sighting) -> None:
        """Learn from a sighting of now."""
        difference, H, white, S = self.innovation(sighting)
        gain = np.linalg.solve(S, H @ self.P).T
        self.state = self.state + gain @ difference
        rest = np.eye(SIZE) - gain @ H
        self.P = rest @ self.P @ rest.T + (gain * white) @ gain.T  # Joseph's form stays positive
        self.unseen_s = 0.0
        self._bound()

    def _bound(self) -> None:
        self.state[BEARING] = math.remainder(self.state[BEARING], 2 * math.pi)
        self.state[INVERSE] = max(self.state[INVERSE], LEAST_INVERSE_PER_M)


def _model(sighting: Sighting, lasting_share: float) -> tuple[FloatArray, FloatArray]:
    """Derivative (2, 7) of bearing and 1 / range to the state, and the variances (2,) of their white noise."""
    stds = np.array([sighting.bearing_std_rad, sighting.inverse_std_per_m])
    H = np.zeros((2, SIZE))
    H[0, BEARING] = H[1, INVERSE] = 1.0
    H[:, NOISE] = np.diag(stds) * math.sqrt(lasting_share)
    H[1, CAMERA] = sighting.common_std_per_m
    return H, (1 - lasting_share) * stds**2
