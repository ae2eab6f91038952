"""How well boats and keypoints are found: precision, recall and AP by OKS, and errors in pixels.

OKS of a pair is the mean over labelled keypoints of exp(-d^2 / (2 area (2 sigma)^2)), with the area of the labelled
box (COCO keypoint evaluation). sigma = 1/7 is what the paper's tool uses; it is flattering: an error of 3.7 px on a
40 px boat passes every threshold up to 0.90. sigma = 0.025 is the strict one.
"""

import contextlib
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from usvnet.evaluation.records import (
    RANGE_CONFIDENCE,
    BoatRecord,
    FloatArray,
    TruthRecord,
    box_area,
    match_boats,
)
from usvnet.types import KEYPOINT_NAMES, NUM_KEYPOINTS

PAPER_SIGMA = 1 / NUM_KEYPOINTS
STRICT_SIGMA = 0.025
MAX_BOATS = 20


@dataclass(frozen=True)
class PoseScores:
    """Detection and pose of a set of pictures at one OKS sigma, each in [0, 1]; nan where no boat is labelled."""

    sigma: float
    precision: float
    """At the score of best F1, matched at OKS 0.5."""
    recall: float
    confidence: float
    """The score of best F1."""
    map50: float
    map50_95: float
    boats: int
    """Labelled boats with at least one labelled keypoint."""


@dataclass(frozen=True)
class PixelErrors:
    """Distances from predicted to labelled keypoints; nan where there are none."""

    n: int
    median_px: float
    p95_px: float


@dataclass(frozen=True)
class KeypointScores:
    """Keypoint errors of the matched boats: keypoints seen or hidden inside the picture (visibility above 0)."""

    matched: int
    missed: int
    overall: PixelErrors
    by_keypoint: dict[str, PixelErrors]


def score_pose(
    records: Sequence[Sequence[BoatRecord]], truths: Sequence[Sequence[TruthRecord]], sigma: float = PAPER_SIGMA
) -> PoseScores:
    """Score P pictures by OKS with pycocotools.

    Args:
        records: predicted boats of each picture.
        truths: labelled boats of the same pictures. Boats without a labelled keypoint are neither asked for nor
            counted against a prediction, as in COCO.
        sigma: tolerance of every keypoint, as a share of the square root of the box's area.

    Raises:
        ValueError: the two have different lengths.
    """
    _check_lengths(records, truths)
    labelled = sum(bool((truth.visibility > 0).any()) for boats in truths for truth in boats)
    if not labelled:
        nan = float("nan")
        return PoseScores(sigma, nan, nan, nan, nan, nan, boats=0)
    evaluation = _evaluation(records, truths, sigma)
    precision = evaluation.eval["precision"][:, :, 0, 0, 0]  # (10 thresholds, 101 recalls)
    matches = [image for image in evaluation.evalImgs if image is not None]
    at_best = _best_f1(matches, labelled)
    return PoseScores(
        sigma, *at_best, map50=float(precision[0].mean()), map50_95=float(precision.mean()), boats=labelled
    )


def precision_recall(
    records: Sequence[Sequence[BoatRecord]], truths: Sequence[Sequence[TruthRecord]], sigma: float = PAPER_SIGMA
) -> tuple[FloatArray, FloatArray]:
    """The curves that the APs are the means of; arguments and errors as in :func:`score_pose`.

    Returns:
        The (101,) recalls from 0 to 1, and the (10, 101) highest precision that reaches each of them, by the ten
        thresholds of OKS 0.5, 0.55 to 0.95; nan where no boat is labelled.
    """
    _check_lengths(records, truths)
    evaluation = _evaluation(records, truths, sigma)
    precision = np.asarray(evaluation.eval["precision"][:, :, 0, 0, 0], np.float64)
    return np.asarray(evaluation.params.recThrs, np.float64), np.where(precision < 0, np.nan, precision)


def score_keypoints(
    records: Sequence[Sequence[BoatRecord]],
    truths: Sequence[Sequence[TruthRecord]],
    confidence: float = RANGE_CONFIDENCE,
) -> KeypointScores:
    """Measure the keypoints of the boats that :func:`usvnet.evaluation.records.match_boats` pairs, in pixels.

    Raises:
        ValueError: the two have different lengths.
    """
    _check_lengths(records, truths)
    distances: list[list[float]] = [[] for _ in KEYPOINT_NAMES]
    matched = missed = 0
    for boats, labelled in zip(records, truths):
        for truth, boat in zip(labelled, match_boats(boats, labelled, confidence)):
            if boat is None:
                missed += 1
                continue
            matched += 1
            errors_px = np.linalg.norm(boat.keypoints_px - truth.keypoints_px, axis=1)
            for k in np.flatnonzero(truth.visibility > 0):
                distances[k].append(float(errors_px[k]))
    return KeypointScores(
        matched,
        missed,
        overall=_pixel_errors([error for of_keypoint in distances for error in of_keypoint]),
        by_keypoint={name: _pixel_errors(errors) for name, errors in zip(KEYPOINT_NAMES, distances)},
    )


def _evaluation(
    records: Sequence[Sequence[BoatRecord]], truths: Sequence[Sequence[TruthRecord]], sigma: float
) -> COCOeval:
    """Match and accumulate with pycocotools."""
    with contextlib.redirect_stdout(io.StringIO()):  # pycocotools prints its progress
        labels, predictions = _coco(_truth_entries(truths), len(truths)), _coco(_boat_entries(records), len(truths))
        evaluation = COCOeval(labels, predictions, iouType="keypoints")
        evaluation.params.kpt_oks_sigmas = np.full(NUM_KEYPOINTS, sigma)  # the default has a person's 17
        evaluation.params.maxDets = [MAX_BOATS]
        evaluation.params.areaRng, evaluation.params.areaRngLbl = [[0, 1e10]], ["all"]
        evaluation.evaluate()
        evaluation.accumulate()
    return evaluation


def _check_lengths(records: Sequence[object], truths: Sequence[object]) -> None:
    if len(records) != len(truths):
        raise ValueError(f"predictions of {len(records)} pictures cannot be scored on labels of {len(truths)}")


def _pixel_errors(errors_px: list[float]) -> PixelErrors:
    if not errors_px:
        return PixelErrors(0, float("nan"), float("nan"))
    return PixelErrors(len(errors_px), float(np.median(errors_px)), float(np.percentile(errors_px, 95)))


def _best_f1(matches: Sequence[dict[str, FloatArray]], labelled: int) -> tuple[float, float, float]:
    """Precision, recall and score where F1 at OKS 0.5 is best; zeros when nothing was found."""
    scores = np.concatenate([np.asarray(image["dtScores"], float) for image in matches])
    found = np.concatenate([np.asarray(image["dtMatches"])[0] > 0 for image in matches])
    counted = np.concatenate([~np.asarray(image["dtIgnore"])[0].astype(bool) for image in matches])
    order = np.argsort(-scores[counted], kind="stable")
    scores, hits = scores[counted][order], np.cumsum(found[counted][order])
    last_of_score = np.append(np.diff(scores) != 0, True) if len(scores) else np.zeros(0, bool)  # ties stand together
    scores, hits, tried = scores[last_of_score], hits[last_of_score], np.flatnonzero(last_of_score) + 1
    if not len(scores) or not hits[-1]:
        return 0.0, 0.0, 0.0
    best = int(np.argmax(2 * hits / (tried + labelled)))
    return float(hits[best] / tried[best]), float(hits[best] / labelled), float(scores[best])


def _coco(annotations: list[dict[str, object]], pictures: int) -> COCO:
    """Build an index in memory (``loadRes`` cannot take an empty list, which an untrained network gives)."""
    coco = COCO()
    coco.dataset = {
        "images": [{"id": image} for image in range(pictures)],
        "annotations": [{**entry, "id": 1 + n, "category_id": 1} for n, entry in enumerate(annotations)],
        "categories": [{"id": 1, "name": "boat"}],
    }
    coco.createIndex()
    return coco


def _entry(image: int, box_px: FloatArray, keypoints_px: FloatArray, visibility: ArrayLike) -> dict[str, object]:
    return {
        "image_id": image,
        "iscrowd": 0,
        "area": box_area(box_px),
        "bbox": [*box_px[:2], *(box_px[2:] - box_px[:2])],
        "num_keypoints": int(np.count_nonzero(visibility)),
        "keypoints": np.column_stack([keypoints_px, visibility]).ravel().tolist(),
    }


def _truth_entries(truths: Sequence[Sequence[TruthRecord]]) -> list[dict[str, object]]:
    return [
        _entry(image, truth.box_px, truth.keypoints_px, truth.visibility)
        for image, boats in enumerate(truths)
        for truth in boats
    ]


def _boat_entries(records: Sequence[Sequence[BoatRecord]]) -> list[dict[str, object]]:
    return [
        {**_entry(image, boat.box_px, boat.keypoints_px, np.ones(NUM_KEYPOINTS)), "score": boat.score}
        for image, boats in enumerate(records)
        for boat in boats
    ]
