"""One boat as plain arrays: what was predicted, what was labelled, and which belongs to which.

The metrics, the predictions file and the drawings all speak in these records, so that the same score comes out of a
batch in memory (validation while training) and of a file read back a month later. Pixels are those of the batch, or
of the native picture where a letterbox matrix is given.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from usvnet.intervals import ESTIMATORS, UNCALIBRATED, Z_68, Z_90, IntervalFactors
from usvnet.types import NEAREST_WATERLINE, WATERLINE_KEYPOINTS, Boats, Prediction, RangeEstimate, Reason

FloatArray = NDArray[np.float64]

RANGE_CONFIDENCE = 0.25
"""Score that a boat needs before it ranges a picture."""
LEAST_IOU = 0.1
"""Overlap that a predicted and a labelled box need to be of one boat, where there are several."""


@dataclass(frozen=True, eq=False)
class RangeRecord:
    """One :class:`usvnet.types.RangeEstimate` of one boat."""

    slant_m: float
    slant_std_m: float
    horizontal_m: float
    bearing_rad: float
    position_m: FloatArray
    """(3,) in the level frame."""
    valid: bool
    reason: Reason = Reason.OK
    """Why there is no range, where there is none."""
    factors: IntervalFactors = UNCALIBRATED
    """What calibration has made of the standard deviation (see :mod:`usvnet.intervals`)."""

    @property
    def raw_std_m(self) -> float:
        """The standard deviation before calibration."""
        return self.slant_std_m / self.factors.factor_90

    @property
    def half_width_68_m(self) -> float:
        """The 68 % interval is ``slant_m`` plus or minus this."""
        return Z_68 * self.factors.factor_68 * self.raw_std_m

    @property
    def half_width_90_m(self) -> float:
        """The 90 % interval is ``slant_m`` plus or minus this."""
        return Z_90 * self.slant_std_m

    @property
    def usable(self) -> bool:
        """Whether there is a finite range to compare; anything else counts as a miss."""
        return self.valid and math.isfinite(self.slant_m)


@dataclass(frozen=True, eq=False)
class BoatRecord:
    """A predicted boat."""

    box_px: FloatArray
    """(4,) x1, y1, x2, y2."""
    score: float
    keypoints_px: FloatArray
    """(7, 2)"""
    keypoint_covariance_px2: FloatArray
    """(7, 2, 2)"""
    visibility: FloatArray
    """(7,) probability that the keypoint is seen."""
    ranges: dict[str, RangeRecord]
    """By estimator name."""
    heading_rad: float = math.nan
    """The fitted hull's bow, clockwise from the optical axis; nan where no hull was fitted."""
    heading_std_rad: float = math.nan
    misfit: float = math.nan
    """Chi-squared of that fit over its 99 % quantile."""


@dataclass(frozen=True, eq=False)
class TruthRecord:
    """A labelled boat."""

    box_px: FloatArray
    """(4,) x1, y1, x2, y2."""
    keypoints_px: FloatArray
    """(7, 2)"""
    visibility: NDArray[np.int64]
    """(7,) 0 outside or unlabelled, 1 hidden, 2 seen."""
    range_m: float = 0.0
    """Slant range read by the laser, 0 where there is none to compare with (:func:`comparable_range_m`)."""
    range_std_m: float = 0.0
    """Standard deviation of that reading."""
    reference: int = NEAREST_WATERLINE
    """The keypoint that the reading belongs to."""
    scene: str | None = None
    """Scene tag such as ``"IV"``."""


def to_records(
    prediction: Prediction, letterbox: Tensor | None = None, factors: Mapping[str, IntervalFactors] | None = None
) -> list[list[BoatRecord]]:
    """Take a batch apart into its boats, best first.

    Args:
        prediction: of B pictures, on any device.
        letterbox: (B, 3, 3) matrices that took native pixels to the batch's (positive scale and translation, as
            ``usvnet.geometry.camera.letterbox_matrix`` makes them); the records are then in native pixels. Ranges do
            not depend on it.
        factors: by estimator, those that the model applied; none where it is not calibrated.

    Returns:
        B lists of boats; padding is left out.
    """
    boxes, scores, keypoints = _numpy(prediction.boxes_px), _numpy(prediction.scores), _numpy(prediction.keypoints_px)
    covariance, visibility = _numpy(prediction.keypoint_covariance_px2), _numpy(prediction.visibility)
    heading, heading_std = _numpy(prediction.heading_rad), _numpy(prediction.heading_std_rad)
    misfit = _numpy(prediction.misfit)
    ranges = {name: _range_arrays(getattr(prediction, name)) for name in ESTIMATORS}
    applied = {name: (factors or {}).get(name, UNCALIBRATED) for name in ESTIMATORS}
    pictures = []
    for b, present in enumerate(prediction.present.cpu().numpy()):
        inverse = _inverse(letterbox, b)
        pictures.append(
            [
                BoatRecord(
                    box_px=_map_points(boxes[b, n].reshape(2, 2), inverse).reshape(4),
                    score=float(scores[b, n]),
                    keypoints_px=_map_points(keypoints[b, n], inverse),
                    keypoint_covariance_px2=_map_covariance(covariance[b, n], inverse),
                    visibility=visibility[b, n],
                    ranges={name: _range_record(arrays, b, int(n), applied[name]) for name, arrays in ranges.items()},
                    heading_rad=float(heading[b, n]),
                    heading_std_rad=float(heading_std[b, n]),
                    misfit=float(misfit[b, n]),
                )
                for n in sorted(np.flatnonzero(present), key=lambda n: -scores[b, n])
            ]
        )
    return pictures


def to_truths(
    boats: Boats, scenes: Sequence[str | None] | None = None, letterbox: Tensor | None = None
) -> list[list[TruthRecord]]:
    """Take the labels of a batch apart into its boats; ``scenes`` has one tag a picture, ``letterbox`` as above."""
    boxes, keypoints = _numpy(boats.boxes_px), _numpy(boats.keypoints_px)
    visibility, reference = boats.visibility.cpu().numpy(), boats.reference.cpu().numpy()
    ranges_m, range_stds = _numpy(boats.range_m), _numpy(boats.range_std_m)
    pictures = []
    for b, present in enumerate(boats.present.cpu().numpy()):
        inverse = _inverse(letterbox, b)
        pictures.append(
            [
                TruthRecord(
                    box_px=_map_points(boxes[b, n].reshape(2, 2), inverse).reshape(4),
                    keypoints_px=_map_points(keypoints[b, n], inverse),
                    visibility=visibility[b, n].astype(np.int64),
                    range_m=comparable_range_m(ranges_m[b, n], reference[b, n], keypoints[b, n], visibility[b, n]),
                    range_std_m=float(range_stds[b, n]),
                    reference=int(reference[b, n]),
                    scene=None if scenes is None else scenes[b],
                )
                for n in np.flatnonzero(present)
            ]
        )
    return pictures


def comparable_range_m(
    range_m: float, reference: int, keypoints_px: FloatArray, visibility: NDArray[np.int64]
) -> float:
    """A laser reading, or 0 where it cannot be compared with an estimate.

    Every estimator ranges the nearer waterline keypoint. A reading of one that is named can be compared only where
    that is the nearer one, which is the lower one in the picture of those that are labelled.

    Args:
        range_m: what the laser read, 0 where it read nothing.
        reference: the keypoint that it belongs to, or ``NEAREST_WATERLINE``.
        keypoints_px: (7, 2) labelled keypoints.
        visibility: (7,) of them, 0 where not labelled.
    """
    labelled = [keypoint for keypoint in WATERLINE_KEYPOINTS if visibility[keypoint] > 0]
    if reference == NEAREST_WATERLINE or not labelled:
        return float(range_m)
    nearer_v_px = max(keypoints_px[keypoint, 1] for keypoint in labelled)
    return float(range_m) if reference in labelled and keypoints_px[reference, 1] == nearer_v_px else 0.0


def match_boats(
    boats: Sequence[BoatRecord], truths: Sequence[TruthRecord], confidence: float = RANGE_CONFIDENCE
) -> list[BoatRecord | None]:
    """Find the predicted boat of each labelled one in one picture; None where it was missed.

    A picture with a single labelled boat takes the best-scoring prediction, wherever it lies (a box on a buoy is an
    error, not a miss). With several, the pairs that overlap most go first, of equal ones the better scoring, so that a
    boat found twice does not take its neighbour's label; each goes once, and below ``LEAST_IOU`` there is no pair.
    Predictions scoring below ``confidence`` never count.
    """
    candidates = sorted((boat for boat in boats if boat.score >= confidence), key=lambda boat: -boat.score)
    matches: list[BoatRecord | None] = [None] * len(truths)
    if len(truths) == 1:
        return [candidates[0] if candidates else None]
    overlaps = [
        (box_iou(boat.box_px, truth.box_px), place, n)
        for n, boat in enumerate(candidates)
        for place, truth in enumerate(truths)
    ]
    taken: set[int] = set()
    for overlap, place, n in sorted(overlaps, key=lambda pair: -pair[0]):  # stable: the best score first
        if overlap >= LEAST_IOU and matches[place] is None and n not in taken:
            matches[place] = candidates[n]
            taken.add(n)
    return matches


def box_iou(first_px: FloatArray, second_px: FloatArray) -> float:
    """Intersection over union of two (4,) boxes; 0 where either is empty."""
    low, high = np.maximum(first_px[:2], second_px[:2]), np.minimum(first_px[2:], second_px[2:])
    intersection = np.prod(np.maximum(high - low, 0))
    union = box_area(first_px) + box_area(second_px) - intersection
    return float(intersection / union) if union > 0 else 0.0


def box_area(box_px: FloatArray) -> float:
    """Area in px^2 of a (4,) box."""
    return float(np.prod(np.maximum(box_px[2:] - box_px[:2], 0)))


def _numpy(tensor: Tensor) -> FloatArray:
    return tensor.detach().cpu().double().numpy()


def _inverse(letterbox: Tensor | None, b: int) -> FloatArray | None:
    return None if letterbox is None else np.asarray(np.linalg.inv(_numpy(letterbox[b])), np.float64)


def _map_points(points_px: FloatArray, matrix: FloatArray | None) -> FloatArray:
    return points_px if matrix is None else points_px @ matrix[:2, :2].T + matrix[:2, 2]


def _map_covariance(covariance_px2: FloatArray, matrix: FloatArray | None) -> FloatArray:
    return covariance_px2 if matrix is None else matrix[:2, :2] @ covariance_px2 @ matrix[:2, :2].T


def _range_arrays(estimate: RangeEstimate) -> dict[str, FloatArray]:
    return {name: _numpy(tensor) for name, tensor in estimate._asdict().items()}


def _range_record(arrays: dict[str, FloatArray], b: int, n: int, factors: IntervalFactors) -> RangeRecord:
    return RangeRecord(
        slant_m=float(arrays["slant_m"][b, n]),
        slant_std_m=float(arrays["slant_std_m"][b, n]),
        horizontal_m=float(arrays["horizontal_m"][b, n]),
        bearing_rad=float(arrays["bearing_rad"][b, n]),
        position_m=arrays["position_m"][b, n],
        valid=bool(arrays["valid"][b, n]),
        reason=Reason(int(arrays["reason"][b, n])),
        factors=factors,
    )
