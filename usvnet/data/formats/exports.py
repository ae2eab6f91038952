"""What the readers of other tools' exports have in common: the labelled picture that each of them gives, and its text.

A line of text is ``class cx cy w h`` and seven times ``x y v``, or seven times ``x y`` where the tool keeps no
visibility: then a keypoint counts as seen, unless it stands at 0 0, which is how tools fill in a missing one.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from usvnet.data.formats.fractions import keep_inside, to_boat
from usvnet.data.pictures import read_picture
from usvnet.data.records import Faults, Labels, RangeReading
from usvnet.types import KEYPOINT_NAMES, NUM_KEYPOINTS

KEYPOINT_ORDER_NOTE = f"keypoints were taken in their order for {', '.join(KEYPOINT_NAMES)}"

Follow = Callable[[list[Any]], Iterable[Any]]
"""Wraps the list that a reader goes through, to show how far it is; ``iter`` shows nothing."""


@dataclass(frozen=True)
class LabelledPicture:
    """One picture of an export, with its n boats in pixels (integer centres)."""

    path: Path
    name: str
    """Its path below the folder of its split, for instance ``I/0003.jpg``."""
    split: str | None
    """``train``, ``val`` or ``test`` where the export says so."""
    scene: str | None
    size_px: tuple[int, int]
    """Width and height, upright."""
    labels: Labels
    readings: tuple[RangeReading, ...] = ()
    """What the laser read of its boats."""

    @property
    def boxes_px(self) -> NDArray[np.float64]:
        """x1, y1, x2, y2 (n, 4)."""
        return self.labels.boxes_px

    @property
    def visibility(self) -> NDArray[np.int64]:
        """Of each keypoint (n, 7)."""
        return self.labels.visibility

    @property
    def range_m(self) -> NDArray[np.float64]:
        """What the laser read (n,), 0 where it read nothing."""
        ranges = np.zeros(len(self.boxes_px))
        for reading in self.readings:
            ranges[reading.instance] = reading.range_m
        return ranges


class Export(NamedTuple):
    """All pictures of an export, and what a person should know of how they were read."""

    pictures: list[LabelledPicture]
    notes: list[str]


def picture_size(path: Path) -> tuple[int, int]:
    """Decode a picture and give its width and height.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is damaged.
    """
    height, width = read_picture(path).shape[:2]
    return width, height


def read_text_labels(path: Path, size_px: tuple[int, int], faults: Faults) -> tuple[Labels, set[int]]:
    """Read the boats of one picture and the classes they have; a missing or empty file is a picture without boats.

    Raises:
        ValueError: naming file and line (or noted in ``faults``).
    """
    boats: list[Labels] = []
    classes: set[int] = set()
    if path.is_file():
        for number, line in enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), start=1):
            if line.strip():
                with faults.catch():
                    try:
                        kind, boat = parse_text_label(line, size_px)
                    except ValueError as error:
                        raise ValueError(f"{path}:{number}: {error}") from None
                    boats.append(boat)
                    classes.add(kind)
    return Labels.of(boats), classes


def parse_text_label(line: str, size_px: tuple[int, int]) -> tuple[int, Labels]:
    """Turn one line, with or without visibility, into a class and the labels of one boat, cut at the picture's edges.

    A whole number after the last keypoint is the number of a track, and left alone.

    Raises:
        ValueError: without the file's name, which the caller knows.
    """
    words = line.split()
    without, with_visibility = 5 + 2 * NUM_KEYPOINTS, 5 + 3 * NUM_KEYPOINTS
    if len(words) not in (without, without + 1, with_visibility, with_visibility + 1):
        expected = f"{with_visibility} ({NUM_KEYPOINTS} keypoints), or {without} where none has a visibility"
        raise ValueError(f"{len(words)} values, expected {expected}")
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        raise ValueError(f"'{' '.join(words)}' holds something that is not a number") from None
    if not (values[0] >= 0 and values[0] == values[0] // 1):
        raise ValueError(f"class {words[0]}, expected a whole number")
    if not np.isfinite(values).all():
        raise ValueError(f"'{' '.join(words)}' holds a number that is not finite")
    box = values[1:5]
    if len(words) >= with_visibility:
        points = values[5:with_visibility].reshape(NUM_KEYPOINTS, 3)
    else:
        places = values[5:without].reshape(NUM_KEYPOINTS, 2)
        points = np.column_stack((places, 2.0 * (places != 0).any(1)))
    return int(values[0]), to_boat(*keep_inside(box, points), size_px)


def refuse_several_classes(where: str, classes: set[int], names: dict[int, str] | None = None) -> None:
    """Insist that all boats of an export are of one class.

    Raises:
        ValueError: naming the classes.
    """
    if len(classes) > 1:
        found = ", ".join(str((names or {}).get(kind, kind)) for kind in sorted(classes))
        raise ValueError(f"{where}: boats of the classes {found}, expected one class")
