"""From records to drawings."""

import numpy as np

from usvnet.evaluation.records import BoatRecord, TruthRecord
from usvnet.visualize.boats import BoatDrawing


def draw_boat(boat: BoatRecord | None, truth: TruthRecord | None = None, label: tuple[str, ...] = ()) -> BoatDrawing:
    """Turn records into a drawing; a missed boat (None) becomes its label's box and pale hull."""
    pale = None if truth is None else np.where(truth.visibility[:, None] > 0, truth.keypoints_px, np.nan)
    if boat is not None:
        seen = boat.visibility > 0.5
        return BoatDrawing(boat.box_px, boat.keypoints_px, seen, label, boat.keypoint_covariance_px2, pale)
    if truth is None:
        raise ValueError("draw_boat: got neither a prediction nor a label")
    nothing = np.full_like(truth.keypoints_px, np.nan)
    return BoatDrawing(truth.box_px, nothing, truth.visibility == 2, label, truth_px=pale)
