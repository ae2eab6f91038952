"""Drawing boats on pictures: box, seven keypoints with their uncertainty, the hull between them, and the range.

Port is red, starboard green and the centreline yellow, as a boat's lights would have it. A keypoint that is seen is
filled, one that is hidden is hollow. Pictures are RGB.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.visualize.canvas import (
    GREEN,
    GREY,
    INK,
    PLUS_MINUS,
    RED,
    WHITE,
    YELLOW,
    Colour,
    FloatArray,
    Picture,
    Rectangle,
    around,
    disc,
    ellipse,
    frame,
    line,
    rounded,
    text,
    text_size,
    translucent,
)

KEYPOINT_COLOURS = (YELLOW, RED, GREEN, YELLOW, RED, GREEN, YELLOW)
HULL_LINES = (
    *((0, 3, YELLOW), (3, 6, YELLOW), (4, 5, YELLOW)),  # stem, waterline, transom
    *((0, 1, RED), (1, 4, RED), (4, 6, RED)),
    *((0, 2, GREEN), (2, 5, GREEN), (5, 6, GREEN)),
)
"""The hull as pairs of keypoints."""

SMALL_PICTURE_PX = 640
"""Pictures below this are drawn on at twice their size, or letters would not be legible."""


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
    canvas, scale = enlarged(picture, scale)
    paint_boats(canvas, [moved(boat, scale) for boat in boats])
    return canvas


def enlarged(picture: Picture, scale: float | None = None) -> tuple[Picture, float]:
    """Make a canvas of a picture: a copy at ``scale`` (None: 1, or 2 for a small picture), and that scale."""
    height, width = picture.shape[:2]
    if scale is None:
        scale = 1.0 if max(height, width) >= SMALL_PICTURE_PX else 2.0
    size = (round(scale * width), round(scale * height))
    return (cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC) if scale != 1 else picture.copy()), scale


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
    enlarged_boats = [moved(boat, scale, corner + 0.5) for boat in boats]
    paint_boats(canvas, enlarged_boats, [_inset(canvas, picture, corner, part, enlarged_boats)])
    return canvas


def moved(boat: BoatDrawing, scale: float, origin_px: FloatArray | float = 0.0) -> BoatDrawing:
    """The drawing on a canvas that shows the picture from ``origin_px`` on, ``scale`` times as large."""

    def move(points_px: FloatArray) -> FloatArray:
        return scale * (points_px - origin_px + 0.5) - 0.5  # pixel centres are integers

    return boat._replace(
        box_px=move(boat.box_px.reshape(2, 2)).reshape(4),
        keypoints_px=move(boat.keypoints_px),
        covariance_px2=None if boat.covariance_px2 is None else scale**2 * boat.covariance_px2,
        truth_px=None if boat.truth_px is None else move(boat.truth_px),
    )


def paint_boats(canvas: Picture, boats: Sequence[BoatDrawing], taken: Sequence[Rectangle] = ()) -> None:
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
    frame(small, scale * (corner + 0.5) - 0.5, scale * (corner + part + 0.5) - 0.5, WHITE)
    rows, columns = small.shape[:2]
    gap = round(0.02 * width)
    middle = np.mean([boat.box_px.reshape(2, 2).mean(axis=0) for boat in boats], axis=0)
    left = gap if middle[0] > width / 2 else width - gap - columns
    top = gap if middle[1] > height / 2 else height - gap - rows
    canvas[top : top + rows, left : left + columns] = small
    frame(canvas, np.array([left - 1, top - 1]), np.array([left + columns, top + rows]), WHITE)
    return left, top, left + columns, top + rows


def _draw_boat(canvas: Picture, boat: BoatDrawing, unit: float) -> None:
    length_px = float(np.hypot(*(boat.box_px[2:] - boat.box_px[:2])))
    radius = float(np.clip(0.025 * length_px, 2.5 * unit, 4.5 * unit))
    thin, thick = max(1, round(1.4 * unit)), max(1, round(2.2 * unit))
    _corners(canvas, boat.box_px, length_px, INK, thick + 2)
    _corners(canvas, boat.box_px, length_px, WHITE, thick)
    drawn = boat.keypoints_px if boat.truth_px is None else np.concatenate([boat.keypoints_px, boat.truth_px])
    with translucent(canvas, 0.75, around(drawn, 2 * thin)):
        if boat.truth_px is not None:
            for a, b, _ in HULL_LINES:
                line(canvas, boat.truth_px[a], boat.truth_px[b], WHITE, thin)
        for a, b, colour in HULL_LINES:
            line(canvas, boat.keypoints_px[a], boat.keypoints_px[b], colour, thin)
    points = [k for k in np.argsort(boat.seen) if np.isfinite(boat.keypoints_px[k]).all()]  # seen ones on top
    if boat.covariance_px2 is not None:
        for k in points:
            ellipse(canvas, boat.keypoints_px[k], boat.covariance_px2[k], KEYPOINT_COLOURS[k], thin)
    for k in points:
        point, colour = boat.keypoints_px[k], KEYPOINT_COLOURS[k]
        size = radius if boat.seen[k] else radius + unit  # a ring needs room for its hole
        disc(canvas, point, size + 1.2 * unit, INK)
        disc(canvas, point, size, colour, -1 if boat.seen[k] else thin)


def _corners(canvas: Picture, box_px: FloatArray, length_px: float, colour: Colour, thickness: int) -> None:
    """Brackets at the corners of a box: they hide less of a small boat than a full frame."""
    arm = min(0.18 * length_px, *(0.4 * (box_px[2:] - box_px[:2])))
    for x, inward in ((box_px[0], arm), (box_px[2], -arm)):
        for y, down in ((box_px[1], arm), (box_px[3], -arm)):
            corner = np.array([x, y])
            line(canvas, corner, corner + np.array([inward, 0]), colour, thickness)
            line(canvas, corner, corner + np.array([0, down]), colour, thickness)


def _draw_label(canvas: Picture, boat: BoatDrawing, unit: float, taken: Sequence[Rectangle]) -> Rectangle:
    """Put the label beside the boat where it covers neither a boat nor another label; return its place."""
    scales = [0.62 * unit] + [0.5 * unit] * (len(boat.label) - 1)
    sizes = [text_size(words, scale, n == 0) for n, (words, scale) in enumerate(zip(boat.label, scales))]
    pad, leading = 8 * unit, 7 * unit
    width = max(w for w, _ in sizes) + 2 * pad
    height = sum(h for _, h in sizes) + leading * (len(sizes) - 1) + 2 * pad
    left, top = _label_place(canvas, _rectangle(boat), (width, height), 10 * unit, taken)
    place = (left, top, left + width, top + height)
    with translucent(canvas, 0.82, place):
        rounded(canvas, place, 5 * unit, INK)
    baseline = top + pad
    for n, (words, scale, (_, letter_height)) in enumerate(zip(boat.label, scales, sizes)):
        baseline += letter_height
        text(canvas, words, (round(left + pad), round(baseline)), scale, WHITE if n == 0 else GREY, strong=n == 0)
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
