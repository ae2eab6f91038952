"""From pictures to the corners of a chessboard in each of them.

Both of OpenCV's detectors are used, because neither is better everywhere. Measured on OpenCV's own 13 sample pictures
and on rendered boards with known corners: the classic one with :func:`cv2.cornerSubPix` is the more accurate
(0.02 to 0.07 px) provided its window stays inside the four squares around a corner; the sector-based one (SB, Duda and
Frese, BMVC 2018) finds boards in poorer light and blur, but its corners are 0.03 to 0.2 px off.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.geometry.calibration import Array, View

Grey = NDArray[np.uint8]
Board = tuple[int, int]
"""Inner corners in a row and in a column."""

DETECTORS = ("classic", "sb")
SEARCH_SIZE_PX = 1280
"""Boards are searched for in pictures reduced to this longer side: at 12 megapixels SB takes 20 s a picture."""
MIN_MOTION = 0.02
"""A video frame whose corners moved by less than this share of the picture's width repeats a view."""


def parse_board(text: str) -> Board:
    """``"9x6"`` to (9, 6): inner corners, where four squares meet.

    Raises:
        ValueError: not two whole numbers of at least 3.
    """
    columns, _, rows = text.lower().partition("x")
    if not (columns.isdecimal() and rows.isdecimal() and min(int(columns), int(rows)) >= 3):
        raise ValueError(f"board must be inner corners as COLUMNSxROWS, each at least 3, such as 9x6; got {text!r}")
    return int(columns), int(rows)


def find_corners(grey: Grey, board: Board, detector: str) -> Array | None:
    """Find the inner corners of a whole chessboard, row by row, by one of DETECTORS.

    Args:
        grey: (H, W) uint8.
        board: inner corners in a row and in a column.
        detector: ``"classic"`` or ``"sb"``.

    Returns:
        (P, 2) pixels, or None when the whole board is not seen.
    """
    scale = min(1.0, SEARCH_SIZE_PX / max(grey.shape))
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else grey
    if detector == "sb":
        found, corners = cv2.findChessboardCornersSB(small, board, None, cv2.CALIB_CB_ACCURACY)
    else:
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCorners(small, board, None, flags)
    if not found:
        return None
    ratio = np.array([grey.shape[1] / small.shape[1], grey.shape[0] / small.shape[0]])
    corners_px = (corners.reshape(-1, 2).astype(np.float64) + 0.5) * ratio - 0.5  # integer pixel centres
    return _refine(grey, corners_px, board) if detector == "classic" else corners_px


def _refine(grey: Grey, corners_px: Array, board: Board) -> Array:
    """Subpixel corners with a window a third of the closest corners' spacing to either side, at most 11 px.

    The usual fixed 11 px reaches the next corner on small boards: it takes view left02 of OpenCV's set from 0.17 to
    1.2 px, and its focal length from 533 to 536 px (which is the published value).
    """
    grid = corners_px.reshape(board[1], board[0], 2)
    spacing = min(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1))
    half = int(np.clip(round(spacing / 3), 2, 11))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-4)
    refined = cv2.cornerSubPix(grey, corners_px.astype(np.float32).reshape(-1, 1, 2), (half, half), (-1, -1), criteria)
    return refined.reshape(-1, 2).astype(np.float64)


@dataclass
class Findings:
    """What a walk through the pictures found."""

    size_px: tuple[int, int] = (0, 0)
    views: dict[str, list[View]] = field(default_factory=dict)
    """Of each detector, the views it found."""
    num_pictures: int = 0
    missed: list[str] = field(default_factory=list)
    """Pictures in which no detector found the board."""
    num_repeated: int = 0
    """Pictures left out because the board had hardly moved."""


def find_views(
    pictures: Iterable[tuple[str, Grey]], board: Board, detectors: tuple[str, ...], skip_repeats: bool = False
) -> Findings:
    """Look for the board in every picture with every detector.

    Args:
        pictures: (name, (H, W) uint8).
        board: inner corners in a row and in a column.
        detectors: of DETECTORS; the first decides whether a view repeats one already kept.
        skip_repeats: leave out pictures in which the board moved by less than MIN_MOTION, for videos.

    Raises:
        ValueError: a picture differs in size from the first.
    """
    findings = Findings(views={detector: [] for detector in detectors})
    first = ""
    for name, grey in pictures:
        size = (grey.shape[1], grey.shape[0])
        first = first or name
        if findings.num_pictures and size != findings.size_px:
            turned = " (turned by 90 deg?)" if size == findings.size_px[::-1] else ""
            width, height = findings.size_px
            raise ValueError(
                f"{name} is {size[0]}x{size[1]} px{turned} but {first} is {width}x{height} px: "
                "one calibration needs pictures of one camera at one size"
            )
        findings.size_px = size
        findings.num_pictures += 1
        found = False
        for detector in detectors:
            corners_px = find_corners(grey, board, detector)
            if corners_px is None:
                continue
            if skip_repeats and not found and _repeats(corners_px, findings.views[detector], MIN_MOTION * size[0]):
                findings.num_repeated += 1
                found = True
                break
            found = True
            findings.views[detector].append(View(name, corners_px))
        if not found:
            findings.missed.append(name)
    return findings


def _repeats(corners_px: Array, kept: list[View], motion_px: float) -> bool:
    """Whether the corners are, on average, within ``motion_px`` of a kept view's, in either order of counting."""
    return any(
        np.linalg.norm(order - view.corners_px, axis=-1).mean() < motion_px
        for view in kept
        for order in (corners_px, corners_px[::-1])
    )
