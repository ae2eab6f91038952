"""Decoding photographs, refusing damaged ones, and keeping them in memory between epochs.

Every photograph, of a chessboard or of boats, is read here, and so stands upright everywhere as its EXIF orientation
says: that is how labelling tools and viewers show it. OpenCV turns videos in the same way.
"""

import re
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
"""(H, W, 3) RGB."""
Grey = NDArray[np.uint8]
"""(H, W)"""


def read_picture(path: Path) -> Picture:
    """Decode a picture to RGB, upright.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is damaged or cut short.
    """
    return _decode(path, cv2.IMREAD_COLOR_RGB)


def read_grey(path: Path) -> Grey:
    """Decode a picture to grey, upright; raises as :func:`read_picture` does."""
    return _decode(path, cv2.IMREAD_GRAYSCALE)


def _decode(path: Path, flags: int) -> NDArray[np.uint8]:
    """Decode a picture; none of OpenCV's flags but IMREAD_IGNORE_ORIENTATION keeps it from turning it upright."""
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such picture")
    data = path.read_bytes()
    # older versions of OpenCV fill the missing part of a JPEG that was cut short with grey and say nothing
    if data[:2] == b"\xff\xd8" and not _jpeg_ends(data):
        raise ValueError(f"{path}: corrupt JPEG, it ends before its end-of-image marker ({len(data)} bytes)")
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error:
        picture = None
    if picture is None:
        raise ValueError(f"{path}: corrupt picture, OpenCV cannot decode its {len(data)} bytes")
    return picture.astype(np.uint8, copy=False)


def _jpeg_ends(data: bytes) -> bool:
    """Whether a JPEG reaches its end-of-image marker; telephones append films to photographs, so it is not the last."""
    place = 2
    while marker := _MARKER.search(data, place):
        code = marker.group()[1]
        if code == 0xD9:
            return True
        place = marker.end() + int.from_bytes(data[marker.end() : marker.end() + 2])  # over its segment
    return False


_MARKER = re.compile(rb"\xff[^\x00\x01\xd0-\xd7\xff]")
"""One that begins a segment, or ends the picture: not those that stand alone, nor what the coded pixels escape."""


class PictureCache:
    """Decoded pictures, kept until a budget of memory is used up.

    A picture is kept with its longer side at most ``longest_px``: a 12-megapixel photograph for a network that sees
    640 pixels would waste memory and time. A worker process that is forked shares what was read before the fork; one
    that is spawned starts empty.
    """

    def __init__(self, budget_mb: int, longest_px: int) -> None:
        """Keep at most ``budget_mb`` of 2**20 bytes."""
        self.left_bytes = budget_mb * 2**20
        self.longest_px = longest_px
        self.kept: dict[Path, Picture] = {}

    def read(self, path: Path, size_px: tuple[int, int]) -> Picture:
        """Read a picture, shrunk if it is larger than ``longest_px``.

        Raises:
            ValueError: damaged, or not of the camera's ``size_px`` (width, height).
        """
        if path in self.kept:
            return self.kept[path]
        picture = read_picture(path)
        height, width = picture.shape[:2]
        if (width, height) != size_px:
            expected = f"{size_px[0]} x {size_px[1]} as its camera"
            turned = " (turned by 90 degrees?)" if (height, width) == size_px else ""
            raise ValueError(f"{path}: picture of {width} x {height}{turned}, expected {expected}")
        scale = self.longest_px / max(width, height)
        if scale < 1:
            shrunk_px = (max(1, round(width * scale)), max(1, round(height * scale)))
            picture = cv2.resize(picture, shrunk_px, interpolation=cv2.INTER_AREA)
        if picture.nbytes <= self.left_bytes:
            self.left_bytes -= picture.nbytes
            self.kept[path] = picture
        return picture

    def __getstate__(self) -> dict[str, object]:
        """Leave the pictures behind when copied to another process."""
        return {**self.__dict__, "kept": {}, "left_bytes": self.left_bytes + sum(p.nbytes for p in self.kept.values())}
