"""Boats for the tests of the evaluation: made by hand, no network."""

from collections.abc import Sequence

import numpy as np

from usvnet.evaluation.records import ESTIMATORS, BoatRecord, FloatArray, RangeRecord, TruthRecord

BOX_PX = np.array([100.0, 200.0, 180.0, 250.0])
KEYPOINTS_PX = np.array(
    [[110.0, 205.0], [112.0, 210.0], [120.0, 212.0], [115.0, 245.0], [170.0, 208.0], [178.0, 210.0], [175.0, 240.0]]
)


def truth(
    shift_px: float = 0.0, range_m: float = 0.0, scene: str | None = None, visibility: Sequence[int] = (2,) * 7
) -> TruthRecord:
    """Label a boat moved right by ``shift_px``."""
    offset = np.array([shift_px, 0.0])
    return TruthRecord(
        box_px=BOX_PX + np.tile(offset, 2),
        keypoints_px=KEYPOINTS_PX + offset,
        visibility=np.array(visibility),
        range_m=range_m,
        range_std_m=0.01 if range_m else 0.0,
        scene=scene,
    )


def boat(
    of: TruthRecord,
    score: float = 0.9,
    error_px: float | FloatArray = 0.0,
    slant_m: float | None = None,
    std_m: float = 0.1,
    valid: bool = True,
) -> BoatRecord:
    """Predict ``of`` with every keypoint wrong by ``error_px``; the range is the laser's unless given."""
    distance_m = of.range_m if slant_m is None else slant_m
    estimate = RangeRecord(distance_m, std_m, distance_m, 0.1, np.array([1.0, 1.5, distance_m]), valid)
    return BoatRecord(
        box_px=of.box_px,
        score=score,
        keypoints_px=of.keypoints_px + error_px * np.array([1.0, 0.0]),
        keypoint_covariance_px2=np.tile([[2.0, 0.5], [0.5, 1.0]], (7, 1, 1)),
        visibility=np.where(of.visibility == 2, 0.9, 0.1),
        ranges=dict.fromkeys(ESTIMATORS, estimate),
    )
