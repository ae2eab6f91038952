"""What the files say of a track, in one order and under one set of names."""

import math
from typing import Any

import numpy as np

from usvnet.evaluation.record_json import compact
from usvnet.tracking.tracker import Track

FIELDS = (
    *("id", "age_s", "unseen_s", "slant_m", "slant_std_m", "low_90_m", "high_90_m", "horizontal_m"),
    *("bearing_deg", "bearing_std_deg", "x_m", "x_std_m", "z_m", "z_std_m"),
    *("velocity_x_m_s", "velocity_x_std_m_s", "velocity_z_m_s", "velocity_z_std_m_s", "closing_m_s", "closing_std_m_s"),
    *("cpa_m", "cpa_std_m", "tcpa_s", "tcpa_std_s"),
)
"""Smoothed; x is to the right, z ahead. The closest point of approach is empty while no motion is certain."""


def track_fields(track: Track, height_m: float) -> dict[str, Any]:
    """The values of ``FIELDS``; what is not finite or not known is None.

    Args:
        track: at the frame's time.
        height_m: of the camera, which turns horizontal ranges to slant ones.
    """
    slant_m = math.hypot(track.range_m, height_m)
    meeting = (math.nan,) * 4 if track.encounter is None else track.encounter
    values = [
        *(track.age_s, track.unseen_s, slant_m, track.range_std_m * track.range_m / slant_m),
        *(math.hypot(track.low_90_m, height_m), math.hypot(track.high_90_m, height_m), track.range_m),
        *(math.degrees(track.bearing_rad), math.degrees(track.bearing_std_rad)),
        *np.stack([track.motion, np.sqrt(np.diag(track.motion_covariance))], axis=1).ravel().tolist(),
        *(track.closing_m_s, track.closing_std_m_s, *meeting),
    ]
    return dict(zip(FIELDS, [track.number, *compact(values)], strict=True))
