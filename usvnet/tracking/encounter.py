"""How near two boats come on straight courses: closest point of approach (CPA) and the time until then (TCPA)."""

from typing import NamedTuple

import numpy as np

from usvnet.tracking.motion import FloatArray

SIGNIFICANT_SPEED = 9.21
"""99 % quantile of chi-squared, 2 degrees of freedom: a velocity squared over its covariance below it may be none."""


class Encounter(NamedTuple):
    """The closest point of approach, with first-order standard deviations."""

    cpa_m: float
    """Distance then, at least 0."""
    cpa_std_m: float
    """Of the distance with a sign for the side: larger than ``cpa_m`` itself where it is not known on which side."""
    tcpa_s: float
    """Seconds until then; below 0 where it is past."""
    tcpa_std_s: float


def encounter(motion: FloatArray, covariance: FloatArray) -> Encounter | None:
    """Say how near a boat comes if both keep course and speed.

    With p and v position and velocity relative to us, TCPA = -p.v / v.v and CPA = |p x v| / |v|.

    Args:
        motion: (4,) X, Z, VX, VZ relative to the camera, metres and metres a second.
        covariance: (4, 4) of it.

    Returns:
        None where no relative motion is certain: then there is no such point, and nothing first order would be true.
    """
    p, v = motion[:2], motion[2:]
    square = float(v @ v)
    if square == 0 or v @ np.linalg.solve(covariance[2:, 2:], v) < SIGNIFICANT_SPEED:
        return None
    speed = np.sqrt(square)
    tcpa = -(p @ v) / square
    side = (p[0] * v[1] - p[1] * v[0]) / speed
    tcpa_by = np.concatenate([-v, -(p + 2 * tcpa * v)]) / square
    side_by = np.array([v[1], -v[0], -p[1], p[0]]) / speed
    side_by[2:] -= side * v / square
    stds = np.sqrt([gradient @ covariance @ gradient for gradient in (side_by, tcpa_by)])
    return Encounter(abs(float(side)), float(stds[0]), float(tcpa), float(stds[1]))
