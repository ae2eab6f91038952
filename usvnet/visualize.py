"""Drawing boats on pictures: box, seven keypoints with their uncertainty, the hull between them, and the range.

Port is red, starboard green and the centreline yellow, as a boat's lights would have it. A keypoint that is seen is
filled, one that is hidden is hollow. Pictures are RGB.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

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
KEYPOINT_COLOURS = (YELLOW, RED, GREEN, YELLOW, RED, GREEN, YELLOW)
HULL_LINES = (
    *((0, 3, YELLOW), (3, 6, YELLOW), (4, 5, YELLOW)),  # stem, waterline, transom
    *((0, 1, RED), (1, 4, RED), (4, 6, RED)),
    *((0, 2, GREEN), (2, 5, GREEN), (5, 6, GREEN)),
)
"""The hull as pairs of keypoints."""

PLUS_MINUS = "\u00b1" if int(cv2.__version__.split(".")[0]) >= 5 else "+-"  # OpenCV 4 draws ASCII only
FONT = cv2.FONT_HERSHEY_SIMPLEX
STRONG_FONT = cv2.FONT_HERSHEY_DUPLEX
SMALL_PICTURE_PX = 640
"""Pictures below this are drawn on at twice their size, or letters would not be legible."""
SHIFT = 4
"""OpenCV draws at 1/16 of a pixel."""


class BoatDrawing(NamedTuple):
    """What to draw for one boat, in the picture's pixels."""

    box_px: FloatArray
    """(4,)"""
    keypoints_px: FloatArray
    """(7, 2); those that are not finite are left out."""
    seen: NDArray[np.bool_]
    """(7,) filled where True, hollow where False."""
    label: tuple[str, ...] = ()
    """Lines of text; the first is strong."""
    covariance_px2: FloatArray | None = None
    """(7, 2, 2), drawn as 1-sigma ellipses."""
    truth_px: FloatArray | None = None
    """(7, 2) labelled keypoints, drawn as a pale hull that shows where the prediction is off."""


def range_label(slant_m: float, slant_std_m: float, laser_m: float | None = None) -> tuple[str, ...]:
    """Say a range as label lines: ``("9.87 m +- 0.12", "laser 9.93 m")``."""
    estimate = f"{slant_m:.2f} m" if np.isfinite(slant_m) else "no range"
    if np.isfinite(slant_m) and np.isfinite(slant_std_m):
        estimate += f" {PLUS_MINUS} {slant_std_m:.2f}"
    return (estimate,) if laser_m is None else (estimate, f"laser {laser_m:.2f} m")


def draw_boats(picture: Picture, boats: Sequence[BoatDrawing], scale: float | None = None) -> Picture:
    """Draw boats on a copy of a picture.

    Args:
        picture: (H, W, 3) RGB.
        boats: the last is drawn on top.
        scale: size of the result relative to the picture; None is 1, or 2 for a small picture.

    Returns:
        (round(scale * H), round(scale * W), 3) RGB.
    """
    height, width = picture.shape[:2]
    if scale is None:
        scale = 1.0 if max(height, width) >= SMALL_PICTURE_PX else 2.0
    size = (round(scale * width), round(scale * height))
    canvas = cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC) if scale != 1 else picture.copy()
    _paint(canvas, [_moved(boat, scale) for boat in boats])
    return canvas


def close_up(picture: Picture, boats: Sequence[BoatDrawing], size_px: tuple[int, int]) -> Picture:
    """Enlarge the part of a picture around its boats and draw them, with the whole picture small in a corner.

    Args:
        picture: (H, W, 3) RGB.
        boats: at least one.
        size_px: width and height of the result.
    """
    height, width = picture.shape[:2]
    corners = np.concatenate([boat.box_px.reshape(2, 2) for boat in boats])
    truths = [boat.truth_px for boat in boats if boat.truth_px is not None]
    corners = np.concatenate([corners, *truths])
    corners = corners[np.isfinite(corners).all(axis=1)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    aspect = size_px[0] / size_px[1]
    part_width = max(2.4 * (high[0] - low[0]), 2.4 * (high[1] - low[1]) * aspect, 0.25 * width)
    part = np.array([1, 1 / aspect]) * min(part_width, width, height * aspect)
    corner = np.clip((low + high) / 2 - part * (0.5, 0.55), 0, np.array([width, height]) - part) - 0.5
    scale = size_px[0] / part[0]
    A = np.column_stack([scale * np.eye(2), -scale * (corner + 0.5) + (scale - 1) / 2])
    canvas = cv2.warpAffine(picture, A, size_px, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    moved = [_moved(boat, scale, corner + 0.5) for boat in boats]
    _paint(canvas, moved, [_inset(canvas, picture, corner, part, moved)])
    return canvas


def contact_sheet(
    pictures: Sequence[Picture], columns: int, captions: Sequence[str] = (), title: str = "", gap_px: int = 12
) -> Picture:
    """Lay out pictures in rows on a dark ground.

    Args:
        pictures: RGB, all of one size.
        columns: pictures a row.
        captions: a line of text over each picture, or none.
        title: a line over all.
        gap_px: space between pictures.

    Raises:
        ValueError: no picture, or pictures of different sizes.
    """
    sizes = sorted({picture.shape[:2] for picture in pictures})
    if len(sizes) != 1:
        raise ValueError(f"contact sheet: got pictures of {len(sizes)} sizes {sizes}, expected one size")
    height, width = sizes[0]
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    caption_px, title_px = (30 if captions else 0), (52 if title else 0)
    step = (height + gap_px + caption_px, width + gap_px)
    sheet = np.full((rows * step[0] + gap_px + title_px, columns * step[1] + gap_px, 3), INK, np.uint8)
    if title:
        _text(sheet, title, (gap_px + 2, 40), 1.0, WHITE, strong=True)
    for n, picture in enumerate(pictures):
        top = title_px + gap_px + caption_px + n // columns * step[0]
        left = gap_px + n % columns * step[1]
        sheet[top : top + height, left : left + width] = picture
        if captions:
            _text(sheet, captions[n], (left + 2, top - 9), 0.55, GREY)
    return sheet


def _moved(boat: BoatDrawing, scale: float, origin_px: FloatArray | float = 0.0) -> BoatDrawing:
    def move(points_px: FloatArray) -> FloatArray:
        return scale * (points_px - origin_px + 0.5) - 0.5  # pixel centres are integers

    return boat._replace(
        box_px=move(boat.box_px.reshape(2, 2)).reshape(4),
        keypoints_px=move(boat.keypoints_px),
        covariance_px2=None if boat.covariance_px2 is None else scale**2 * boat.covariance_px2,
        truth_px=None if boat.truth_px is None else move(boat.truth_px),
    )


def _paint(canvas: Picture, boats: Sequence[BoatDrawing], taken: Sequence[Rectangle] = ()) -> None:
    """Draw boats that are in the canvas's pixels, and their labels off the places that are ``taken``."""
    unit = min(canvas.shape[:2]) / 640
    for boat in boats:
        _draw_boat(canvas, boat, unit)
    places = [*taken, *(_rectangle(boat) for boat in boats)]
    for boat in boats:
        if boat.label:
            places.append(_draw_label(canvas, boat, max(unit, 0.9), places))


def _inset(
    canvas: Picture, picture: Picture, corner: FloatArray, part: FloatArray, boats: Sequence[BoatDrawing]
) -> Rectangle:
    """Put the whole picture in the corner of the canvas that is farthest from the boats, the enlarged part framed."""
    height, width = canvas.shape[:2]
    scale = 0.27 * min(height, width) / max(picture.shape[:2])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    _frame(small, scale * (corner + 0.5) - 0.5, scale * (corner + part + 0.5) - 0.5, WHITE)
    rows, columns = small.shape[:2]
    gap = round(0.02 * width)
    middle = np.mean([boat.box_px.reshape(2, 2).mean(axis=0) for boat in boats], axis=0)
    left = gap if middle[0] > width / 2 else width - gap - columns
    top = gap if middle[1] > height / 2 else height - gap - rows
    canvas[top : top + rows, left : left + columns] = small
    _frame(canvas, np.array([left - 1, top - 1]), np.array([left + columns, top + rows]), WHITE)
    return left, top, left + columns, top + rows


def _draw_boat(canvas: Picture, boat: BoatDrawing, unit: float) -> None:
    length_px = float(np.hypot(*(boat.box_px[2:] - boat.box_px[:2])))
    radius = float(np.clip(0.025 * length_px, 2.5 * unit, 4.5 * unit))
    thin, thick = max(1, round(1.4 * unit)), max(1, round(2.2 * unit))
    _corners(canvas, boat.box_px, length_px, INK, thick + 2)
    _corners(canvas, boat.box_px, length_px, WHITE, thick)
    with _translucent(canvas, 0.75) as layer:
        if boat.truth_px is not None:
            for a, b, _ in HULL_LINES:
                _line(layer, boat.truth_px[a], boat.truth_px[b], WHITE, thin)
        for a, b, colour in HULL_LINES:
            _line(layer, boat.keypoints_px[a], boat.keypoints_px[b], colour, thin)
    points = [k for k in np.argsort(boat.seen) if np.isfinite(boat.keypoints_px[k]).all()]  # seen ones on top
    if boat.covariance_px2 is not None:
        for k in points:
            _ellipse(canvas, boat.keypoints_px[k], boat.covariance_px2[k], KEYPOINT_COLOURS[k], thin)
    for k in points:
        point, colour = boat.keypoints_px[k], KEYPOINT_COLOURS[k]
        size = radius if boat.seen[k] else radius + unit  # a ring needs room for its hole
        _disc(canvas, point, size + 1.2 * unit, INK)
        _disc(canvas, point, size, colour, -1 if boat.seen[k] else thin)


def _corners(canvas: Picture, box_px: FloatArray, length_px: float, colour: Colour, thickness: int) -> None:
    """Brackets at the corners of a box: they hide less of a small boat than a full frame."""
    arm = min(0.18 * length_px, *(0.4 * (box_px[2:] - box_px[:2])))
    for x, inward in ((box_px[0], arm), (box_px[2], -arm)):
        for y, down in ((box_px[1], arm), (box_px[3], -arm)):
            corner = np.array([x, y])
            _line(canvas, corner, corner + np.array([inward, 0]), colour, thickness)
            _line(canvas, corner, corner + np.array([0, down]), colour, thickness)


def _draw_label(canvas: Picture, boat: BoatDrawing, unit: float, taken: Sequence[Rectangle]) -> Rectangle:
    """Put the label beside the boat where it covers neither a boat nor another label; return its place."""
    scales = [0.62 * unit] + [0.5 * unit] * (len(boat.label) - 1)
    sizes = [_text_size(text, scale, n == 0) for n, (text, scale) in enumerate(zip(boat.label, scales))]
    pad, leading = 8 * unit, 7 * unit
    width = max(w for w, _ in sizes) + 2 * pad
    height = sum(h for _, h in sizes) + leading * (len(sizes) - 1) + 2 * pad
    left, top = _label_place(canvas, _rectangle(boat), (width, height), 10 * unit, taken)
    place = (left, top, left + width, top + height)
    with _translucent(canvas, 0.82) as layer:
        _rounded(layer, place, 5 * unit, INK)
    baseline = top + pad
    for n, (text, scale, (_, letter_height)) in enumerate(zip(boat.label, scales, sizes)):
        baseline += letter_height
        _text(canvas, text, (round(left + pad), round(baseline)), scale, WHITE if n == 0 else GREY, strong=n == 0)
        baseline += leading
    return place


def _label_place(
    canvas: Picture, box: Rectangle, size: tuple[float, float], gap: float, taken: Sequence[Rectangle]
) -> tuple[float, float]:
    (x1, y1, x2, y2), (width, height) = box, size
    limit_x, limit_y = canvas.shape[1] - width - 2, canvas.shape[0] - height - 2
    middle_x, middle_y = (x1 + x2 - width) / 2, (y1 + y2 - height) / 2
    wishes = [
        (middle_x, y1 - gap - height),
        (middle_x, y2 + gap),
        (x2 + gap, middle_y),
        (x1 - gap - width, middle_y),
        (2.0, 2.0),
        (limit_x, limit_y),
    ]
    places = [(min(max(x, 2.0), max(limit_x, 2.0)), min(max(y, 2.0), max(limit_y, 2.0))) for x, y in wishes]

    def covered(place: tuple[float, float]) -> float:
        x, y = place
        return sum(
            max(0.0, min(x + width, t[2]) - max(x, t[0])) * max(0.0, min(y + height, t[3]) - max(y, t[1]))
            for t in taken
        )

    return min(places, key=covered)  # the first of those that cover least


def _rectangle(boat: BoatDrawing) -> Rectangle:
    """The space that box and finite keypoints take together."""
    points = np.concatenate([boat.box_px.reshape(2, 2), boat.keypoints_px])
    points = points[np.isfinite(points).all(axis=1)]
    (x1, y1), (x2, y2) = points.min(axis=0), points.max(axis=0)
    return float(x1), float(y1), float(x2), float(y2)


@contextmanager
def _translucent(canvas: Picture, opacity: float) -> Iterator[Picture]:
    layer = canvas.copy()
    yield layer
    cv2.addWeighted(layer, opacity, canvas, 1 - opacity, 0, dst=canvas)


def _fixed(values: FloatArray | Sequence[float]) -> tuple[int, int]:
    x, y = np.clip(np.round(np.asarray(values) * 2**SHIFT), -(2**24), 2**24).astype(int).tolist()
    return x, y


def _line(canvas: Picture, start: FloatArray, end: FloatArray, colour: Colour, thickness: int) -> None:
    if np.isfinite(start).all() and np.isfinite(end).all():
        cv2.line(canvas, _fixed(start), _fixed(end), colour, thickness, cv2.LINE_AA, SHIFT)


def _disc(canvas: Picture, centre: FloatArray, radius: float, colour: Colour, thickness: int = -1) -> None:
    cv2.circle(canvas, _fixed(centre), round(radius * 2**SHIFT), colour, thickness, cv2.LINE_AA, SHIFT)


def _ellipse(canvas: Picture, centre: FloatArray, covariance_px2: FloatArray, colour: Colour, thickness: int) -> None:
    if not np.isfinite(covariance_px2).all():
        return
    variances, axes = np.linalg.eigh(covariance_px2)
    turn = np.arange(0, 2 * np.pi, np.pi / 24)
    circle = np.stack([np.cos(turn), np.sin(turn)]) * np.sqrt(np.maximum(variances, 0))[:, None]
    outline = np.array([_fixed(point) for point in centre + (axes @ circle).T], np.int32)
    with _translucent(canvas, 0.3) as layer:
        cv2.fillPoly(layer, [outline], colour, cv2.LINE_AA, SHIFT)
    cv2.polylines(canvas, [outline], True, colour, thickness, cv2.LINE_AA, SHIFT)


def _frame(canvas: Picture, low: FloatArray, high: FloatArray, colour: Colour) -> None:
    cv2.rectangle(canvas, _fixed(low), _fixed(high), colour, 1, cv2.LINE_AA, SHIFT)


def _rounded(canvas: Picture, place: Rectangle, radius: float, colour: Colour) -> None:
    x1, y1, x2, y2 = place
    for centre, start in (((x2, y2), 0), ((x1, y2), 90), ((x1, y1), 180), ((x2, y1), 270)):
        inward = np.where(np.array(centre) == (x1, y1), radius, -radius)
        axes = (round(radius * 2**SHIFT),) * 2
        cv2.ellipse(canvas, _fixed(centre + inward), axes, start, 0, 90, colour, -1, cv2.LINE_AA, SHIFT)
    for a, b in (((x1 + radius, y1), (x2 - radius, y2)), ((x1, y1 + radius), (x2, y2 - radius))):
        cv2.rectangle(canvas, _fixed(a), _fixed(b), colour, -1, cv2.LINE_AA, SHIFT)


def _text_size(text: str, scale: float, strong: bool) -> tuple[int, int]:
    (width, height), _ = cv2.getTextSize(text, STRONG_FONT if strong else FONT, scale, 1)
    return width, height


def _text(
    canvas: Picture, text: str, origin: tuple[int, int], scale: float, colour: Colour, strong: bool = False
) -> None:
    cv2.putText(canvas, text, origin, STRONG_FONT if strong else FONT, scale, colour, 1, cv2.LINE_AA)
