"""Boats on water, and what a camera with an error of its own sees of them, with the noise of ``RangingLayer``."""

import math

import numpy as np

from usvnet.tracking.filter import Sighting
from usvnet.tracking.motion import from_metres

HEIGHT_M, POINT_STD_RAD, WAVE_STD_M = 2.0, 0.0015, 0.05


class Sea:
    """Boats with white acceleration before a camera whose pitch is wrong by an error that drifts.

    Args:
        motions: (N, 4) X, Z, VX, VZ.
        rng: random numbers.
        wander_m_s: as of the filter.
        pitch_std_rad: of the camera.
        camera_correlation_s: time in which that error changes.
        lasting_share: part of the variance of keypoint errors and waves that lasts ...
        noise_correlation_s: ... for so long.
    """

    def __init__(
        self,
        motions,
        rng,
        wander_m_s=0.1,
        pitch_std_rad=0.0035,
        camera_correlation_s=60.0,
        lasting_share=0.0,
        noise_correlation_s=0.5,
    ):
        self.motions = np.array(motions, float)
        self.rng = rng
        self.wander_m_s = wander_m_s
        self.pitch_std_rad = pitch_std_rad
        self.pitch = rng.normal()
        self.camera_correlation_s = camera_correlation_s
        self.lasting_share = lasting_share
        self.noise_correlation_s = noise_correlation_s
        self.lasting = rng.normal(size=(len(motions), 3))

    def advance(self, dt_s):
        n = len(self.motions)
        q = np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]]) * self.wander_m_s**2
        shocks = np.linalg.cholesky(q + 1e-18 * np.eye(2)) @ self.rng.normal(size=(n, 2, 2))  # position and velocity
        self.motions[:, :2] += self.motions[:, 2:] * dt_s + shocks[:, 0]
        self.motions[:, 2:] += shocks[:, 1]
        self.pitch = drift(self.rng, self.pitch, dt_s, self.camera_correlation_s)
        self.lasting = drift(self.rng, self.lasting, dt_s, self.noise_correlation_s)

    @property
    def states(self):
        return np.array([from_metres(motion) for motion in self.motions])

    def sight(self):
        """What is seen of each boat; the stated sigmas are those at the range that is read, as in practice."""
        white = self.rng.normal(size=self.lasting.shape) * math.sqrt(1 - self.lasting_share)
        noises = white + self.lasting * math.sqrt(self.lasting_share)
        return [self._sight(state, noise) for state, noise in zip(self.states, noises)]

    def _sight(self, state, noise):
        bearing, inverse = state[:2]
        height_m = HEIGHT_M + WAVE_STD_M * noise[2]
        error_rad = POINT_STD_RAD * noise[1] + self.pitch_std_rad * self.pitch * math.cos(bearing)
        read = math.tan(math.atan(height_m * inverse) + error_rad) / HEIGHT_M
        by_angle = (1 + (HEIGHT_M * read) ** 2) / HEIGHT_M
        white = math.hypot(by_angle * POINT_STD_RAD, read * WAVE_STD_M / HEIGHT_M)
        common = by_angle * self.pitch_std_rad * math.cos(bearing)
        return Sighting(bearing + POINT_STD_RAD * noise[0], POINT_STD_RAD, read, white, common)


def drift(rng, value, dt_s, correlation_s):
    """A first-order Gauss-Markov process of variance 1, one step on."""
    kept = math.exp(-dt_s / correlation_s)
    return kept * value + math.sqrt(1 - kept**2) * rng.normal(size=np.shape(value))
