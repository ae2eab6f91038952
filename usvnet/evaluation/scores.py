"""Everything that is scored of a set of pictures, in one object that writes itself as JSON."""

import dataclasses
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from usvnet.evaluation.pose_metrics import (
    PAPER_SIGMA,
    STRICT_SIGMA,
    KeypointScores,
    PoseScores,
    score_keypoints,
    score_pose,
)
from usvnet.evaluation.range_metrics import RangeScores, score_range
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

    def to_json(self) -> str:
        """Write as JSON; a figure that does not exist is null, never NaN."""
        return json.dumps(finite(dataclasses.asdict(self)), indent=2, allow_nan=False) + "\n"


def score(
    records: Sequence[Sequence[BoatRecord]],
    truths: Sequence[Sequence[TruthRecord]],
    range_confidence: float = RANGE_CONFIDENCE,
) -> Scores:
    """Score predicted boats on labelled ones, picture by picture.

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
    )


def finite(value: Any) -> Any:
    """Replace every number that is not finite by None, in nested dictionaries and lists."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
