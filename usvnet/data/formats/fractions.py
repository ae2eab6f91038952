"""The rule that the label formats share: fractions of a picture, and where a pixel lies in them.

Label tools count pixel i as [i, i + 1), so that 0 and 1 are the picture's edges. We call the centre of that pixel i:
u = width * x - 0.5, for keypoints and for the corners of boxes alike.
"""

import numpy as np
from numpy.typing import NDArray

from usvnet.data.records import Labels
from usvnet.types import KEYPOINT_NAMES

TOLERANCE = 1e-3
"""How far a fraction may lie outside [0, 1]: rounding, not a mistake."""

FAR = 1e6
"""Where a number stops to be a place, even that of a keypoint which is not labelled: it would not fit float32."""


def to_boat(box: NDArray[np.float64], points: NDArray[np.float64], size_px: tuple[int, int]) -> Labels:
    """Turn fractions into the labels of one boat.

    Args:
        box: (4,) centre x, centre y, width, height.
        points: (7, 3) x, y and visibility of each keypoint.
        size_px: width and height of the picture.

    Raises:
        ValueError: saying what is out of bounds; the caller knows the file.
    """
    pairs = {"box centre": box[:2], "box size": box[2:], **dict(zip(KEYPOINT_NAMES, points[:, :2]))}
    for (name, (x, y)), visibility in zip(pairs.items(), (2, 2, *points[:, 2])):
        if visibility not in (0, 1, 2):
            raise ValueError(f"visibility of {name} is {visibility:g}, expected 0, 1 or 2")
        if not (np.abs((x, y)) < FAR).all():
            raise ValueError(f"{name} is ({x:g}, {y:g}), expected finite numbers")
        if visibility > 0 and max(abs(x - 0.5), abs(y - 0.5)) > 0.5 + TOLERANCE:
            raise ValueError(f"{name} is ({x:g}, {y:g}), expected 0 to 1 of the picture")
    if min(box[2:]) <= 0:
        raise ValueError(f"box size is ({box[2]:g}, {box[3]:g}), expected a width and a height above 0")
    size = np.array(size_px, float)
    corners = np.concatenate((box[:2] - box[2:] / 2, box[:2] + box[2:] / 2)) * np.tile(size, 2) - 0.5
    return Labels(corners[None], (points[:, :2] * size - 0.5)[None], points[:, 2].astype(np.int64)[None])


def keep_inside(
    box: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cut a box (4,) at the picture's edges and count keypoints (7, 3) outside as not labelled.

    Some tools let a boat reach out of its picture. What is not finite stays so, for :func:`to_boat` to refuse.
    """
    low, high = np.clip(box[:2] - box[2:] / 2, 0, 1), np.clip(box[:2] + box[2:] / 2, 0, 1)
    outside = np.isfinite(points).all(1) & (np.abs(points[:, :2] - 0.5).max(1) > 0.5 + TOLERANCE)
    return np.concatenate(((low + high) / 2, high - low)), np.where(outside[:, None], 0.0, points)


def from_boat(boat: Labels, size_px: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Give the box (4,) and the points (7, 3) of one boat as fractions: the inverse of :func:`to_boat`.

    Raises:
        ValueError: a label is not finite, which no file can say.
    """
    size = np.array(size_px, float)
    low, high = (boat.boxes_px[0].reshape(2, 2) + 0.5) / size
    points = np.column_stack(((boat.keypoints_px[0] + 0.5) / size, boat.visibility[0]))
    box = np.concatenate(((low + high) / 2, high - low))
    if not (np.isfinite(box).all() and np.isfinite(points).all()):
        raise ValueError(f"a label to be written is not finite: box {box.tolist()}, keypoints {points.tolist()}")
    return box, points
