"""One boat as JSON, in native pixels (integer centres).

::

    {"box_px": [x1, y1, x2, y2], "score": s, "keypoints_px": 7 x [u, v], "visibility": 7 x probability,
     "keypoint_covariance_px2": 7 x [uu, uv, vv],
     "box_bottom": {"slant_m", "slant_std_m", "raw_std_m", "interval_68_m", "interval_90_m",
                    "horizontal_m", "bearing_deg", "position_m", "valid", "reason"},
     "waterline": {...}, "hull": {...}, "fused": {...},
     "heading_deg": h, "heading_std_deg": s, "misfit": m}

Keypoints stand in the order of :data:`usvnet.types.KEYPOINT_NAMES`. What is not finite is null: a ray above the
horizon has no range. ``raw_std_m`` is the standard deviation before calibration (see :mod:`usvnet.intervals`).
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from usvnet.evaluation.records import ESTIMATORS, BoatRecord, FloatArray, RangeRecord
from usvnet.intervals import UNCALIBRATED, IntervalFactors
from usvnet.types import NUM_KEYPOINTS, Reason


def boat_to_json(boat: BoatRecord) -> dict[str, Any]:
    """Say a boat in values that JSON can hold."""
    covariance = boat.keypoint_covariance_px2
    return {
        "box_px": compact(boat.box_px),
        "score": compact(boat.score),
        "keypoints_px": compact(boat.keypoints_px),
        "visibility": compact(boat.visibility),
        "keypoint_covariance_px2": compact(covariance[:, [0, 0, 1], [0, 1, 1]]),
        **{name: _range_to_json(estimate) for name, estimate in boat.ranges.items()},
        "heading_deg": compact(math.degrees(boat.heading_rad)),
        "heading_std_deg": compact(math.degrees(boat.heading_std_rad)),
        "misfit": compact(boat.misfit),
    }


def interval_68_m(estimate: RangeRecord) -> tuple[float, float]:
    """Lower and upper end of the slant range's 68 % interval; infinite where there is no range."""
    return _interval_m(estimate, estimate.half_width_68_m)


def interval_90_m(estimate: RangeRecord) -> tuple[float, float]:
    """Lower and upper end of the slant range's 90 % interval; infinite where there is no range."""
    return _interval_m(estimate, estimate.half_width_90_m)


def _interval_m(estimate: RangeRecord, half_width_m: float) -> tuple[float, float]:
    if not estimate.usable:
        return math.inf, math.inf
    return max(0.0, estimate.slant_m - half_width_m), estimate.slant_m + half_width_m


def _range_to_json(estimate: RangeRecord) -> dict[str, Any]:
    return {
        "slant_m": compact(estimate.slant_m),
        "slant_std_m": compact(estimate.slant_std_m),
        "raw_std_m": compact(estimate.raw_std_m),
        "interval_68_m": compact(list(interval_68_m(estimate))),
        "interval_90_m": compact(list(interval_90_m(estimate))),
        "horizontal_m": compact(estimate.horizontal_m),
        "bearing_deg": compact(math.degrees(estimate.bearing_rad)),
        "position_m": compact(estimate.position_m),
        "valid": estimate.valid,
        "reason": estimate.reason.name.lower(),
    }


def boat_from_json(boat: dict[str, Any], factors: Mapping[str, IntervalFactors] | None = None) -> BoatRecord:
    """Undo :func:`boat_to_json`; keys that it does not write are left alone.

    Args:
        boat: as it was written.
        factors: by estimator, those that the model applied; none where it was not calibrated.

    Raises:
        KeyError, TypeError, ValueError: it is not a boat's.
    """
    known = factors or {}
    covariance = _array(boat["keypoint_covariance_px2"], NUM_KEYPOINTS, 3)
    return BoatRecord(
        box_px=_array(boat["box_px"], 4),
        score=float(boat["score"]),
        keypoints_px=_array(boat["keypoints_px"], NUM_KEYPOINTS, 2),
        keypoint_covariance_px2=covariance[:, [0, 1, 1, 2]].reshape(-1, 2, 2),
        visibility=_array(boat["visibility"], NUM_KEYPOINTS),
        ranges={name: _range_from_json(boat[name], known.get(name, UNCALIBRATED)) for name in ESTIMATORS},
        heading_rad=math.radians(_number(boat["heading_deg"])),
        heading_std_rad=math.radians(_number(boat["heading_std_deg"])),
        misfit=_number(boat["misfit"]),
    )


def _range_from_json(estimate: dict[str, Any], factors: IntervalFactors) -> RangeRecord:
    if not isinstance(estimate["valid"], bool):
        raise TypeError(f"valid is {estimate['valid']!r}, expected true or false")
    return RangeRecord(
        slant_m=float(_array(estimate["slant_m"])),
        slant_std_m=float(_array(estimate["slant_std_m"])),
        horizontal_m=float(_array(estimate["horizontal_m"])),
        bearing_rad=math.radians(estimate["bearing_deg"]),
        position_m=_array(estimate["position_m"], 3),
        valid=estimate["valid"],
        reason=Reason[estimate["reason"].upper()],
        factors=factors,
    )


def compact(values: FloatArray | list[float] | float) -> Any:
    """Numbers with the seven digits that float32 has; what is not finite becomes None."""
    if isinstance(values, float):
        return float(f"{values:.7g}") if math.isfinite(values) else None
    return [compact(value) for value in (values.tolist() if isinstance(values, np.ndarray) else values)]


def _number(value: float | None) -> float:
    """Undo :func:`compact` for one number; None comes back as nan."""
    return math.nan if value is None else float(value)


def _array(values: Any, *shape: int) -> FloatArray:
    """Undo :func:`compact` for numbers of this shape; None comes back as infinity."""
    array = np.array(values, dtype=float)  # None becomes nan
    if array.shape != shape:
        raise ValueError(f"numbers of the shape {array.shape}, expected {shape}")
    return np.where(np.isnan(array), np.inf, array)
