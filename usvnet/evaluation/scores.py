"""Everything that is scored of a set of pictures, in one object that writes itself as JSON."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from usvnet.evaluation.floor import FloorScores
from usvnet.evaluation.interval_metrics import IntervalScores, score_intervals
from usvnet.evaluation.pose_metrics import (
    PAPER_SIGMA,
    STRICT_SIGMA,
    KeypointScores,
    PoseScores,
    score_keypoints,
    score_pose,
)
from usvnet.evaluation.range_metrics import RangeScores, ranged_boats, score_range
from usvnet.evaluation.records import RANGE_CONFIDENCE, BoatRecord, TruthRecord


@dataclass(frozen=True)
class Scores:
    """The scores of a set of pictures."""

    pictures: int
    range_confidence: float
    """Score that a boat needed to be ranged and to have its keypoints measured."""
    pose: PoseScores
    """At OKS sigma 1/7, as the paper's tool has it."""
    pose_strict: PoseScores
    """At OKS sigma 0.025."""
    keypoints: KeypointScores
    ranges: RangeScores
    intervals: IntervalScores
    floor: FloorScores | None = None
    """Best errors that the network's own pixel noise allows; None where it was not worked out."""

    def to_json(self) -> str:
        """Write as JSON; a figure that does not exist is null, never NaN."""
        return json.dumps(finite(dataclasses.asdict(self)), indent=2, allow_nan=False) + "\n"


def score(
    records: Sequence[Sequence[BoatRecord]],
    truths: Sequence[Sequence[TruthRecord]],
    range_confidence: float = RANGE_CONFIDENCE,
    calibration_boats: Mapping[str, int] | None = None,
) -> Scores:
    """Score predicted boats on labelled ones, picture by picture.

    Args:
        records: predicted boats of each picture.
        truths: labelled boats of the same pictures.
        range_confidence: score that a boat needs before it is ranged.
        calibration_boats: laser-ranged boats that each estimator's intervals were calibrated on; none if they were not.

    Raises:
        ValueError: the two have different lengths.
    """
    return Scores(
        pictures=len(truths),
        range_confidence=range_confidence,
        pose=score_pose(records, truths, PAPER_SIGMA),
        pose_strict=score_pose(records, truths, STRICT_SIGMA),
        keypoints=score_keypoints(records, truths, range_confidence),
        ranges=score_range(records, truths, range_confidence),
        intervals=score_intervals(ranged_boats(records, truths, range_confidence), calibration_boats or {}),
    )


def finite(value: Any) -> Any:
    """Replace every number that is not finite by None, in nested dictionaries and lists."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
