"""The pens: lines, discs, ellipses, panels and text on an RGB picture, and the colours of the house."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Picture = NDArray[np.uint8]
"""(H, W, 3) RGB."""
Colour = tuple[int, int, int]
Rectangle = tuple[float, float, float, float]
"""x1, y1, x2, y2."""

RED, GREEN, YELLOW = (255, 82, 71), (57, 217, 138), (255, 209, 66)
WHITE, GREY, INK = (255, 255, 255), (178, 192, 208), (13, 22, 36)

PLUS_MINUS = "\u00b1" if int(cv2.__version__.split(".")[0]) >= 5 else "+-"  # OpenCV 4 draws ASCII only
FONT = cv2.FONT_HERSHEY_SIMPLEX
STRONG_FONT = cv2.FONT_HERSHEY_DUPLEX
SHIFT = 4
"""OpenCV draws at 1/16 of a pixel."""
FARTHEST = 2**24
"""What lies further out, in those sixteenths, is drawn there: OpenCV's integers would overflow."""


@contextmanager
def translucent(canvas: Picture, opacity: float, place: Rectangle) -> Iterator[None]:
    """Let what is drawn inside ``place`` shine through: drawn as usual, then mixed with what was there before."""
    x1, y1 = (max(0, int(np.floor(np.clip(value, 0, 2**24)))) for value in place[:2])
    x2, y2 = (max(0, int(np.ceil(np.clip(value, 0, 2**24))) + 1) for value in place[2:])
    part = canvas[y1:y2, x1:x2]
    before = part.copy()
    yield
    if part.size:
        part[:] = cv2.addWeighted(part, opacity, before, 1 - opacity, 0)


def around(points: FloatArray, margin: float) -> Rectangle:
    """The smallest place that holds the finite ones of ``points`` (N, 2) and a margin; empty where there is none."""
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return 0.0, 0.0, -1.0, -1.0
    (x1, y1), (x2, y2) = points.min(axis=0) - margin, points.max(axis=0) + margin
    return float(x1), float(y1), float(x2), float(y2)


def line(canvas: Picture, start: FloatArray, end: FloatArray, colour: Colour, thickness: int) -> None:
    """Draw a line; nothing where an end is not finite."""
    if np.isfinite(start).all() and np.isfinite(end).all():
        cv2.line(canvas, _fixed(start), _fixed(end), colour, thickness, cv2.LINE_AA, SHIFT)


def disc(canvas: Picture, centre: FloatArray, radius: float, colour: Colour, thickness: int = -1) -> None:
    """Draw a disc, or a ring where a thickness is given."""
    cv2.circle(canvas, _fixed(centre), round(radius * 2**SHIFT), colour, thickness, cv2.LINE_AA, SHIFT)


def fill(canvas: Picture, outline: FloatArray, colour: Colour) -> None:
    """Fill the inside of an outline (N, 2)."""
    cv2.fillPoly(canvas, [_fixed_outline(outline)], colour, cv2.LINE_AA, SHIFT)


def stroke(canvas: Picture, outline: FloatArray, colour: Colour, thickness: int, closed: bool = True) -> None:
    """Draw an outline (N, 2)."""
    cv2.polylines(canvas, [_fixed_outline(outline)], closed, colour, thickness, cv2.LINE_AA, SHIFT)


def ellipse(canvas: Picture, centre: FloatArray, covariance_px2: FloatArray, colour: Colour, thickness: int) -> None:
    """Draw the 1-sigma ellipse of a covariance (2, 2), its inside pale; nothing where it is not finite."""
    if not np.isfinite(covariance_px2).all():
        return
    variances, axes = np.linalg.eigh(covariance_px2)
    turn = np.arange(0, 2 * np.pi, np.pi / 24)
    circle = np.stack([np.cos(turn), np.sin(turn)]) * np.sqrt(np.maximum(variances, 0))[:, None]
    outline = centre + (axes @ circle).T
    with translucent(canvas, 0.3, around(outline, 1)):
        fill(canvas, outline, colour)
    stroke(canvas, outline, colour, thickness)


def frame(canvas: Picture, low: FloatArray, high: FloatArray, colour: Colour) -> None:
    """Draw a thin rectangle."""
    cv2.rectangle(canvas, _fixed(low), _fixed(high), colour, 1, cv2.LINE_AA, SHIFT)


def rounded(canvas: Picture, place: Rectangle, radius: float, colour: Colour) -> None:
    """Fill a rectangle with round corners."""
    x1, y1, x2, y2 = place
    for centre, start in (((x2, y2), 0), ((x1, y2), 90), ((x1, y1), 180), ((x2, y1), 270)):
        inward = np.where(np.array(centre) == (x1, y1), radius, -radius)
        axes = (round(radius * 2**SHIFT),) * 2
        cv2.ellipse(canvas, _fixed(centre + inward), axes, start, 0, 90, colour, -1, cv2.LINE_AA, SHIFT)
    for a, b in (((x1 + radius, y1), (x2 - radius, y2)), ((x1, y1 + radius), (x2, y2 - radius))):
        cv2.rectangle(canvas, _fixed(a), _fixed(b), colour, -1, cv2.LINE_AA, SHIFT)


def text_size(words: str, scale: float, strong: bool = False) -> tuple[int, int]:
    """Width and height that :func:`text` takes."""
    (width, height), _ = cv2.getTextSize(words, STRONG_FONT if strong else FONT, scale, 1)
    return width, height


def text(
    canvas: Picture, words: str, origin: tuple[int, int], scale: float, colour: Colour, strong: bool = False
) -> None:
    """Write ``words`` with their baseline's left end at ``origin``."""
    cv2.putText(canvas, words, origin, STRONG_FONT if strong else FONT, scale, colour, 1, cv2.LINE_AA)


def _fixed(values: FloatArray | Sequence[float]) -> tuple[int, int]:
    x, y = (max(-FARTHEST, min(FARTHEST, round(float(value) * 2**SHIFT))) for value in values)
    return x, y


def _fixed_outline(outline: FloatArray) -> NDArray[np.int32]:
    return np.clip(np.round(outline * 2**SHIFT), -FARTHEST, FARTHEST).astype(np.int32)
