"""Pictures of the best and the worst estimates of each scene (the paper's Figures 8 to 10)."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from usvnet.data.pictures import read_picture
from usvnet.data.records import Frame
from usvnet.evaluation.paper_tables import SCENE_TITLES
from usvnet.evaluation.range_metrics import SCENES
from usvnet.evaluation.records import RANGE_CONFIDENCE, BoatRecord, TruthRecord, match_boats
from usvnet.files import atomic_write
from usvnet.visualize import Picture, close_up, contact_sheet, draw_boat, range_label

ESTIMATOR = "waterline"
TILE_PX = (480, 360)
TILES = 3
"""Best and worst estimates shown of each scene."""


class Example(NamedTuple):
    """A labelled boat, what was predicted for it, and how far off that is."""

    frame: Frame
    truth: TruthRecord
    boat: BoatRecord | None
    error: float
    """Metres where there is a laser reading, else mean keypoint error in pixels; inf for a miss."""


def write_overlays(
    frames: Sequence[Frame],
    records: Sequence[Sequence[BoatRecord]],
    truths: Sequence[Sequence[TruthRecord]],
    folder: Path | str,
    confidence: float = RANGE_CONFIDENCE,
) -> list[Path]:
    """Write a sheet of the best and the worst pictures of each scene, ``scene_I.png`` and so on.

    Args:
        frames: the P pictures.
        records: their predicted boats, in native pixels.
        truths: their labelled boats, in native pixels.
        folder: where the sheets go.
        confidence: score below which a prediction does not count.

    Returns:
        The files written, in the paper's order of scenes. Pictures without a scene tag share ``all.png``.
    """
    examples = _examples(frames, records, truths, confidence)
    found = {example.truth.scene for example in examples}
    scenes = [*(scene for scene in SCENES if scene in found), *sorted(s for s in found if s and s not in SCENES)]
    written = []
    for scene in [*scenes, *([None] if None in found else [])]:
        members = sorted((e for e in examples if e.truth.scene == scene), key=lambda example: abs(example.error))
        best, worst = members[:TILES], members[TILES:][-TILES:]
        sheet = contact_sheet(
            [_tile(example) for example in best + worst],
            TILES,
            [_caption("best", e) for e in best] + [_caption("worst", e) for e in worst],
            f"Scene {scene}   {SCENE_TITLES.get(scene, '')}" if scene else "All pictures",
        )
        path = Path(folder) / (f"scene_{scene}.png" if scene else "all.png")
        with atomic_write(path) as temporary:
            cv2.imwrite(str(temporary), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
        written.append(path)
    return written


def _examples(
    frames: Sequence[Frame],
    records: Sequence[Sequence[BoatRecord]],
    truths: Sequence[Sequence[TruthRecord]],
    confidence: float,
) -> list[Example]:
    """Every boat with a laser reading, or every labelled one where there is no reading at all."""
    everything = [
        Example(frame, truth, boat, _error(truth, boat))
        for frame, boats, labelled in zip(frames, records, truths)
        for truth, boat in zip(labelled, match_boats(boats, labelled, confidence))
    ]
    return [example for example in everything if example.truth.range_m > 0] or everything


def _error(truth: TruthRecord, boat: BoatRecord | None) -> float:
    if boat is None:
        return math.inf
    if truth.range_m > 0:
        estimate = boat.ranges[ESTIMATOR]
        return estimate.slant_m - truth.range_m if estimate.usable else math.inf
    labelled = truth.visibility > 0
    distances_px = np.linalg.norm(boat.keypoints_px - truth.keypoints_px, axis=1)[labelled]
    return float(distances_px.mean()) if labelled.any() else 0.0


def _tile(example: Example) -> Picture:
    laser_m = example.truth.range_m or None
    if example.boat is None:
        label = ("missed", *range_label(math.inf, math.inf, laser_m)[1:])
    else:
        estimate = example.boat.ranges[ESTIMATOR]
        label = range_label(estimate.slant_m, estimate.slant_std_m, laser_m)
    picture = read_picture(example.frame.image_path)
    return close_up(picture, [draw_boat(example.boat, example.truth, label)], TILE_PX)


def _caption(rank: str, example: Example) -> str:
    name = f"{rank}   {example.frame.name}"
    if not math.isfinite(example.error):
        return f"{name}   missed"
    return f"{name}   {example.error:+.2f} m" if example.truth.range_m > 0 else f"{name}   {example.error:.1f} px"
