"""Labelled boats with what was predicted for them, from the best to the worst."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from usvnet.data.pictures import read_picture
from usvnet.data.records import Frame
from usvnet.evaluation.records import BoatRecord, TruthRecord, match_boats
from usvnet.visualize import Picture, close_up, draw_boat, range_label

TILE_PX = (480, 360)


class Example(NamedTuple):
    """A labelled boat, what was predicted for it, and how far off that is."""

    frame: Frame
    truth: TruthRecord
    boat: BoatRecord | None
    error: float
    """Metres where there is a laser reading, else mean keypoint error in pixels; inf for a miss."""


def find_examples(
    frames: Sequence[Frame],
    records: Sequence[Sequence[BoatRecord]],
    truths: Sequence[Sequence[TruthRecord]],
    confidence: float,
    estimator: str,
) -> list[Example]:
    """Find every boat with a laser reading, or every labelled one where there is no reading at all.

    Args:
        frames: the P pictures.
        records: their predicted boats, in native pixels.
        truths: their labelled boats, in native pixels.
        confidence: score below which a prediction does not count.
        estimator: whose range is compared.
    """
    everything = [
        Example(frame, truth, boat, _error(truth, boat, estimator))
        for frame, boats, labelled in zip(frames, records, truths)
        for truth, boat in zip(labelled, match_boats(boats, labelled, confidence))
    ]
    return [example for example in everything if example.truth.range_m > 0] or everything


def draw_example(example: Example, estimator: str) -> Picture:
    """Draw a close-up of the boat, of ``TILE_PX``, with its range and the laser's."""
    laser_m = example.truth.range_m or None
    if example.boat is None:
        label = ("missed", *range_label(math.inf, math.inf, laser_m)[1:])
    else:
        estimate = example.boat.ranges[estimator]
        label = range_label(estimate.slant_m, estimate.slant_std_m, laser_m)
    picture = read_picture(example.frame.image_path)
    return close_up(picture, [draw_boat(example.boat, example.truth, label)], TILE_PX)


def _error(truth: TruthRecord, boat: BoatRecord | None, estimator: str) -> float:
    if boat is None:
        return math.inf
    if truth.range_m > 0:
        estimate = boat.ranges[estimator]
        return estimate.slant_m - truth.range_m if estimate.usable else math.inf
    labelled = truth.visibility > 0
    distances_px = np.linalg.norm(boat.keypoints_px - truth.keypoints_px, axis=1)[labelled]
    return float(distances_px.mean()) if labelled.any() else 0.0
