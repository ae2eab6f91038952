"""Pictures of the best and the worst estimates of each scene (the paper's Figures 8 to 10)."""

import math
from collections.abc import Sequence
from pathlib import Path

import cv2

from usvnet.data.records import Frame
from usvnet.evaluation.examples import Example, draw_example, find_examples
from usvnet.evaluation.paper_tables import SCENE_TITLES
from usvnet.evaluation.range_metrics import SCENES
from usvnet.evaluation.records import RANGE_CONFIDENCE, BoatRecord, TruthRecord
from usvnet.files import atomic_write
from usvnet.visualize import contact_sheet

ESTIMATOR = "fused"
"""The range that is shown and judged, the one that `usvnet predict` shows."""
TILES = 3
"""Best and worst estimates shown of each scene."""


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
    examples = find_examples(frames, records, truths, confidence, ESTIMATOR)
    found = {example.truth.scene for example in examples}
    scenes = [*(scene for scene in SCENES if scene in found), *sorted(s for s in found if s and s not in SCENES)]
    written = []
    for scene in [*scenes, *([None] if None in found else [])]:
        members = sorted((e for e in examples if e.truth.scene == scene), key=lambda example: abs(example.error))
        best, worst = members[:TILES], members[TILES:][-TILES:]
        title = f"Scene {scene}   {SCENE_TITLES.get(scene, '')}" if scene else "All pictures"
        sheet = contact_sheet(
            [draw_example(example, ESTIMATOR) for example in best + worst],
            TILES,
            [_caption("best", e) for e in best] + [_caption("worst", e) for e in worst],
            f"{title}   range: {ESTIMATOR}",
        )
        path = Path(folder) / (f"scene_{scene}.png" if scene else "all.png")
        with atomic_write(path) as temporary:
            cv2.imwrite(str(temporary), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
        written.append(path)
    return written


def _caption(rank: str, example: Example) -> str:
    name = f"{rank}   {example.frame.name}"
    if not math.isfinite(example.error):
        return f"{name}   missed"
    return f"{name}   {example.error:+.2f} m" if example.truth.range_m > 0 else f"{name}   {example.error:.1f} px"
