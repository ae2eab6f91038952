"""What is known of one photograph before it becomes tensors, and how faults in files are gathered."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usvnet.geometry.hull_model import generic_hull
from usvnet.types import NEAREST_WATERLINE, NUM_KEYPOINTS, Camera, Hull

SPLITS = ("train", "val", "test")


class Labels(NamedTuple):
    """The n labelled boats of one picture, in pixels (integer centres)."""

    boxes_px: NDArray[np.float64]
    """(n, 4) x1, y1, x2, y2."""
    keypoints_px: NDArray[np.float64]
    """(n, 7, 2); means nothing where the visibility is 0."""
    visibility: NDArray[np.int64]
    """(n, 7): 0, 1 or 2."""

    def boat(self, i: int) -> "Labels":
        """Take boat ``i`` alone."""
        return Labels(self.boxes_px[i : i + 1], self.keypoints_px[i : i + 1], self.visibility[i : i + 1])

    @staticmethod
    def of(boats: list["Labels"]) -> "Labels":
        """Join boats; the empty list gives the labels of an empty picture."""
        empty = Labels(np.zeros((0, 4)), np.zeros((0, NUM_KEYPOINTS, 2)), np.zeros((0, NUM_KEYPOINTS), np.int64))
        return Labels(*(np.concatenate(column) for column in zip(empty, *boats)))


@dataclass(frozen=True)
class Frame:
    """One picture on disk, its camera as it stood in that moment, its n labelled boats and their laser ranges."""

    image_path: Path
    name: str
    """The picture's path below ``images/``, for instance ``test/0003.jpg``."""
    scene: str | None
    camera: Camera
    """One camera (B = 1, float32) with this picture's pitch and roll."""
    boxes_px: NDArray[np.float64]
    """(n, 4)"""
    keypoints_px: NDArray[np.float64]
    """(n, 7, 2); means nothing where the visibility is 0."""
    visibility: NDArray[np.int64]
    """(n, 7)"""
    range_m: NDArray[np.float64]
    """(n,) slant range read by the laser, 0 where there is none."""
    range_std_m: NDArray[np.float64]
    """(n,) standard deviation of the reading, 0 where there is none or it is not known."""
    reference: NDArray[np.int64]
    """(n,) index of the keypoint the range belongs to, or NEAREST_WATERLINE."""
    hull: Hull = field(default_factory=generic_hull)
    """One hull (B = 1, float32), that of every boat in the picture; a generic one where none is known."""

    @cached_property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the picture."""
        width, height = self.camera.size_px[0].round().int().tolist()
        return width, height

    @property
    def labels(self) -> Labels:
        """The boats without their ranges."""
        return Labels(self.boxes_px, self.keypoints_px, self.visibility)


@dataclass(frozen=True)
class RangeReading:
    """One row of ranges.csv: the laser's reading of one boat."""

    range_m: float
    range_std_m: float = 0.0
    instance: int = 0
    reference: int = NEAREST_WATERLINE


@dataclass
class Faults:
    """What is wrong with the files of a dataset.

    A reader wraps each line or file in :meth:`catch`. With ``collect`` False (training) the first fault is raised;
    with ``collect`` True (``usvnet check-data``) it is noted and the reader goes on with the next line.
    """

    collect: bool = False
    sentences: list[str] = field(default_factory=list)

    @contextlib.contextmanager
    def catch(self) -> Iterator[None]:
        """Note a ValueError or OSError of the block when collecting, else let it through."""
        try:
            yield
        except (ValueError, OSError) as error:
            if not self.collect:
                raise
            if str(error) not in self.sentences:
                self.sentences.append(str(error))
