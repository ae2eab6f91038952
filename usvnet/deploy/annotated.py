"""Pictures and videos with the boats, their ranges, the horizon and the chart drawn on."""

import os
import tempfile
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
CODECS = ("avc1", "mp4v")
"""H.264, which browsers play, where OpenCV has an encoder for it; else MPEG-4 Part 2, which players do. Browsers play
VP9 too, but as OpenCV sets its encoder a frame takes it a hundred times as long as MPEG-4."""
STREAM_FRAMES_PER_S = (1.0, 15.0)
"""Slowest and fastest pace of the video of a stream."""
PHOTOGRAPHS_PER_S = 2.0
"""Pace of a video of photographs."""
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
    """Write an MP4 video: a frame for a frame of a video, in real time of a stream.

    Raises:
        ValueError: it would replace the source.
        OSError: it cannot be written.
    """
    if source.holds(path):
        raise ValueError(f"{path}: the annotated video would replace its original, choose another output folder")
    with atomic_write(path) as temporary, ExitStack() as closing:
        video = _Video(temporary, source.frames_per_s or PHOTOGRAPHS_PER_S, source.is_live)
        closing.callback(video.close)
        yield lambda found: video.add(_drawn(drawer, source, found), found.frame.time_s or 0.0)


class _Video:
    """A video file of constant pace.

    A stream's pace is found from its first two frames, that is from what the computer keeps up with; later frames
    stand as often in the video as its pace asks, so that it runs in real time.
    """

    def __init__(self, path: Path, frames_per_s: float, is_live: bool) -> None:
        self.path = path
        self.frames_per_s = frames_per_s
        self.is_live = is_live
        self.clock: _VideoClock | None = None
        self.first: tuple[NDArray[np.uint8], float] | None = None
        self.file: Any = None
        self.size_px = (0, 0)

    def add(self, drawn: NDArray[np.uint8], time_s: float) -> None:
        """Write a frame (BGR) of a time."""
        if not self.is_live:
            self._write(drawn)
        elif self.clock is not None:
            self._write(drawn, self.clock.repeats(time_s))
        elif self.first is None:
            self.first = (drawn, time_s)
        else:
            (first, began_s), self.first = self.first, None
            slowest, fastest = STREAM_FRAMES_PER_S
            self.frames_per_s = min(max(1 / max(time_s - began_s, 1e-3), slowest), fastest)
            self.clock = _VideoClock(self.frames_per_s)
            self._write(first, self.clock.repeats(began_s))
            self._write(drawn, self.clock.repeats(time_s))

    def close(self) -> None:
        """Make the file whole."""
        if self.first is not None:
            self._write(self.first[0])
        if self.file is not None:
            self.file.release()

    def _write(self, drawn: NDArray[np.uint8], repeats: int = 1) -> None:
        if self.file is None:
            self.size_px = drawn.shape[1::-1]
            code = cv2.VideoWriter_fourcc(*best_codec(self.size_px))
            self.file = cv2.VideoWriter(str(self.path), code, self.frames_per_s, self.size_px)
            if not self.file.isOpened():
                raise OSError(f"{self.path.parent}: OpenCV cannot write a video here")
        if drawn.shape[1::-1] != self.size_px:  # of the same shape, or the camera would not have fitted
            drawn = np.asarray(cv2.resize(drawn, self.size_px, interpolation=cv2.INTER_AREA), np.uint8)
        for _ in range(repeats):
            self.file.write(drawn)


def best_codec(size_px: tuple[int, int]) -> str:
    """The first of CODECS that gives pictures of this width and height back; encoders can fail after they opened.

    Raises:
        OSError: none does.
    """
    blank = np.zeros((size_px[1], size_px[0], 3), np.uint8)
    with tempfile.TemporaryDirectory(prefix="usvnet-") as folder, _hushed():
        for codec in CODECS:
            path = str(Path(folder) / f"{codec}.mp4")
            video = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*codec), 10.0, size_px)
            if video.isOpened():
                video.write(blank)
                video.release()
                if cv2.VideoCapture(path).read()[0]:
                    return codec
    raise OSError(f"OpenCV can write no video of {size_px[0]} x {size_px[1]} by any of {', '.join(CODECS)}")


@contextmanager
def _hushed() -> Iterator[None]:
    """Keep to themselves what FFmpeg's encoders say of missing devices, which is written past Python."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


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
        due = int((time_s - self.began_s) * self.frames_per_s + 1e-3) + 1 - self.written
        longest = round(LONGEST_HOLD_S * self.frames_per_s)
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
    drawn = drawer.draw(frame.picture, found.boats, found.camera, caption, found.tracks or ())
    return np.asarray(cv2.cvtColor(drawn, cv2.COLOR_RGB2BGR), np.uint8)
