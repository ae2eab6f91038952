"""Pictures and videos with the boats, their ranges, the horizon and the chart drawn on."""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.deploy.outputs import FrameBoats, Write
from usvnet.deploy.sources import Source
from usvnet.files import atomic_write
from usvnet.visualize.scene import SceneDrawer

SUFFIXES = (".jpg", ".jpeg", ".png", ".webp")
"""Kept as they are; any other picture is written as a JPEG."""
JPEG_QUALITY = 92
STREAM_FRAMES_PER_S, PHOTOGRAPHS_PER_S = 15.0, 2.0
"""Pace of the video of a stream, at most, and of one of photographs."""
LONGEST_HOLD_S = 2.0
"""A gap in a stream longer than this is cut short in the video."""


@contextmanager
def annotated_pictures(folder: Path, drawer: SceneDrawer, source: Source) -> Iterator[Write]:
    """Write each frame under its own name; frames of a video as ``frame 000123.jpg``.

    Raises:
        ValueError: on writing, where that would replace a picture of the source.
    """

    def write(found: FrameBoats) -> None:
        name = found.frame.name
        path = folder / (name if Path(name).suffix.lower() in SUFFIXES else f"{name}.jpg")
        if source.holds(path):
            raise ValueError(f"{path}: an annotated picture would replace its original, choose another output folder")
        drawn = _drawn(drawer, source, found)
        with atomic_write(path) as temporary:
            if not cv2.imwrite(str(temporary), drawn, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]):
                raise OSError(f"{path}: cannot be written")

    yield write


@contextmanager
def annotated_video(path: Path, drawer: SceneDrawer, source: Source) -> Iterator[Write]:
    """Write an MPEG-4 video: a frame for a frame of a video, in real time of a stream.

    Raises:
        ValueError: it would replace the source.
        OSError: it cannot be written.
    """
    if source.holds(path):
        raise ValueError(f"{path}: the annotated video would replace its original, choose another output folder")
    rate = source.frames_per_s or (STREAM_FRAMES_PER_S if source.is_live else PHOTOGRAPHS_PER_S)
    rate = min(rate, STREAM_FRAMES_PER_S) if source.is_live else rate
    with atomic_write(path) as temporary, ExitStack() as closing:
        size_px: tuple[int, int] | None = None
        file: Any = None
        clock = _VideoClock(rate) if source.is_live else None

        def write(found: FrameBoats) -> None:
            nonlocal size_px, file
            repeats = 1 if clock is None else clock.repeats(found.frame.time_s or 0.0)
            if not repeats:
                return
            drawn = _drawn(drawer, source, found)
            if size_px is None:
                size_px = drawn.shape[1::-1]
                file = cv2.VideoWriter(str(temporary), cv2.VideoWriter_fourcc(*"mp4v"), rate, size_px)
                closing.callback(file.release)
                if not file.isOpened():
                    raise OSError(f"{path}: OpenCV cannot write a video here")
            if drawn.shape[1::-1] != size_px:  # of the same shape, or the camera would not have fitted
                drawn = cv2.resize(drawn, size_px, interpolation=cv2.INTER_AREA)
            for _ in range(repeats):
                file.write(drawn)

        yield write


class _VideoClock:
    """How often a frame of a stream stands in a video of constant pace, so that the video runs in real time."""

    def __init__(self, frames_per_s: float) -> None:
        self.frames_per_s = frames_per_s
        self.written = 0
        self.began_s: float | None = None

    def repeats(self, time_s: float) -> int:
        """0 where the video is already past ``time_s``, more than 1 where frames came slower than its pace."""
        if self.began_s is None:
            self.began_s = time_s
        due = int((time_s - self.began_s) * self.frames_per_s) + 1 - self.written
        longest = int(LONGEST_HOLD_S * self.frames_per_s)
        if due > longest:
            self.began_s += (due - longest) / self.frames_per_s
            due = longest
        due = max(0, due)
        self.written += due
        return due


def _drawn(drawer: SceneDrawer, source: Source, found: FrameBoats) -> NDArray[np.uint8]:
    """The frame, drawn on, BGR as OpenCV writes it."""
    frame = found.frame
    caption = frame.name
    if frame.time_s is not None:
        minutes, seconds = divmod(frame.time_s, 60)
        clock = time.strftime("%H:%M:%S", time.localtime(frame.time_s)) if source.is_live else ""
        caption = f"{caption}   {clock or f'{int(minutes)}:{seconds:05.2f}'}"
    drawn = drawer.draw(frame.picture, found.boats, found.camera, caption)
    return np.asarray(cv2.cvtColor(drawn, cv2.COLOR_RGB2BGR), np.uint8)
