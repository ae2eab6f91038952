"""The worst pictures of an evaluation, drawn on and put into the page itself."""

import base64
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import cv2

from usvnet.evaluation.examples import TILE_PX, Example, draw_example
from usvnet.evaluation.record_json import interval_90_m
from usvnet.evaluation.records import RangeRecord
from usvnet.types import Reason
from usvnet.visualize import Picture

WORST, MISSED = 12, 6
"""Pictures shown, of the largest errors and of boats without a range."""
JPEG_QUALITY = 82
WHY_NOT = {
    Reason.HORIZON: "at or above the horizon",
    Reason.MISFIT: "keypoints do not fit the hull",
    Reason.NO_RAY: "outside what the lens sees",
}


class Tile(NamedTuple):
    """A picture with what there is to say about it."""

    data_uri: str
    size_px: tuple[int, int]
    alt: str
    name: str
    scene: str | None
    headline: str
    facts: tuple[str, ...]


def worst_examples(examples: Iterable[Example]) -> list[Example]:
    """The largest errors first, one boat a picture; boats without a range are not among them."""
    ordered = sorted((e for e in examples if math.isfinite(e.error)), key=lambda e: -abs(e.error))
    return _one_a_picture(ordered)[:WORST]


def missed_examples(examples: Iterable[Example]) -> list[Example]:
    """Boats without a range, nearest first (that of the largest box where there are no readings), one a picture."""
    ordered = sorted((e for e in examples if not math.isfinite(e.error)), key=_obviousness)
    return _one_a_picture(ordered)


def tiles(examples: Sequence[Example], estimator: str) -> list[Tile]:
    """Draw examples and say what they show."""
    return [_tile(example, estimator) for example in examples]


def data_uri(picture: Picture) -> str:
    """An RGB picture as a JPEG inside its own address."""
    _, encoded = cv2.imencode(
        ".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    )
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode("ascii")


def _one_a_picture(ordered: Iterable[Example]) -> list[Example]:
    """The first example of every picture, in their order."""
    firsts: dict[str, Example] = {}
    for example in ordered:
        firsts.setdefault(example.frame.name, example)
    return list(firsts.values())


def _tile(example: Example, estimator: str) -> Tile:
    headline, facts = _headline(example, estimator), _facts(example, estimator)
    return Tile(
        data_uri=data_uri(draw_example(example, estimator)),
        size_px=TILE_PX,
        alt=f"Close-up of a boat in {example.frame.name}: {headline}; {'; '.join(facts)}",
        name=example.frame.name,
        scene=example.truth.scene,
        headline=headline,
        facts=facts,
    )


def _headline(example: Example, estimator: str) -> str:
    if example.boat is None:
        return "not found"
    if example.truth.range_m <= 0:
        return f"keypoints off by {example.error:.1f} px on average"
    estimate = example.boat.ranges[estimator]
    if not estimate.usable:
        return f"no range: {WHY_NOT.get(estimate.reason, 'not known why')}"
    return f"{example.error:+.2f} m ({100 * example.error / example.truth.range_m:+.0f} %)"


def _facts(example: Example, estimator: str) -> tuple[str, ...]:
    measured = [f"measured {example.truth.range_m:.2f} m"] if example.truth.range_m > 0 else []
    if example.boat is None:
        return tuple(measured)
    low_m, high_m = interval_90_m(example.boat.ranges[estimator])
    interval = f" (90 %: {low_m:.2f} to {high_m:.2f} m)" if math.isfinite(high_m) else ""
    predicted = [f"{name} {_slant_text(estimate)}" for name, estimate in example.boat.ranges.items()]
    chosen = predicted.pop(list(example.boat.ranges).index(estimator))
    return (*measured, chosen + interval, *predicted, f"score {example.boat.score:.2f}")


def _slant_text(estimate: RangeRecord) -> str:
    return f"{estimate.slant_m:.2f} m" if estimate.usable else "none"


def _obviousness(example: Example) -> float:
    """Smaller for boats that are harder to overlook."""
    width_px, height_px = example.truth.box_px[2:] - example.truth.box_px[:2]
    return example.truth.range_m if example.truth.range_m > 0 else -float(width_px * height_px)
