"""Video files: of a constant pace, as OpenCV writes them, and of a stream, whose frames come when they come."""

import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.deploy.sources import Tell
from usvnet.wording import counted

Drawn = NDArray[np.uint8]
"""(H, W, 3) BGR."""
CODECS = ("avc1", "mp4v")
"""H.264, which browsers play, where OpenCV has an encoder for it; else MPEG-4 Part 2, which players do. Browsers play
VP9 too, but as OpenCV sets its encoder a frame takes it a hundred times as long as MPEG-4."""
HELD_FRAMES = 6
"""So many frames of a stream tell the pace of its video."""
PACE_MARGIN = 2.0
"""The video is that much faster than the first frames were, so that later ones may come faster and all find a place."""
FASTEST_PER_S = 60.0
"""Of a video whose stream does not say its pace."""
LONGEST_HOLD_S = 2.0
"""A pause of a stream that is longer than this, and than four frames usually take, is cut short in the video."""
LATE_S = 1.0
"""A video that falls behind by more is told of."""


class VideoWriter:
    """A video file of constant pace; pictures of another size are scaled to that of the first."""

    def __init__(self, path: Path, frames_per_s: float) -> None:
        self.path = path
        self.frames_per_s = frames_per_s
        self.file: Any = None
        self.size_px = (0, 0)

    def add(self, drawn: Drawn, times: int = 1) -> None:
        """Write a picture so many times.

        Raises:
            OSError: the file cannot be written.
        """
        if self.file is None:
            self.size_px = drawn.shape[1::-1]
            code = cv2.VideoWriter_fourcc(*best_codec(self.size_px))
            self.file = cv2.VideoWriter(str(self.path), code, self.frames_per_s, self.size_px)
            if not self.file.isOpened():
                raise OSError(f"{self.path.parent}: OpenCV cannot write a video here")
        if drawn.shape[1::-1] != self.size_px:  # of the same shape, or the camera would not have fitted
            drawn = np.asarray(cv2.resize(drawn, self.size_px, interpolation=cv2.INTER_AREA), np.uint8)
        for _ in range(times):
            self.file.write(drawn)

    def close(self) -> None:
        """Make the file whole."""
        if self.file is not None:
            self.file.release()


class RealTimeVideo:
    """A video in which every frame of a stream stands, from its own time until that of the next.

    Its pace is constant. A frame is repeated until the next one is due; one that comes before there is a place for it
    stands once, and how much the video is late by then is made up for at the next frames that take longer.

    Args:
        path: the file.
        name: what a person calls it.
        tell: is told, when the video is closed, of pauses that were cut short, and of a video that runs late.
        most_per_s: pace of the stream itself, None where it does not say.
    """

    def __init__(self, path: Path, name: str, tell: Tell, most_per_s: float | None) -> None:
        self.path = path
        self.name = name
        self.tell = tell
        self.most_per_s = most_per_s or FASTEST_PER_S
        self.video: VideoWriter | None = None
        self.longest_hold_s = LONGEST_HOLD_S
        self.pauses_s: list[float] = []
        """What was left out of each pause."""
        self.late_s = 0.0
        """The most that a frame stands after its time."""
        self._held: list[tuple[Drawn, float]] = []
        self._last: Drawn | None = None
        self._began_s = 0.0
        self._written = 0

    def add(self, drawn: Drawn, time_s: float) -> None:
        """Write a frame of a time.

        Raises:
            OSError: the file cannot be written.
        """
        if self.video is not None:
            self._stand(self.video, drawn, time_s)
            return
        self._held.append((drawn, time_s))
        if len(self._held) == HELD_FRAMES:
            self._begin()

    def close(self) -> None:
        """Make the file whole, and tell how it differs from true time."""
        if self._held:
            self._begin()
        if self.video is not None:
            self.video.close()
        if self.pauses_s:
            pauses = counted(len(self.pauses_s), "pause")
            self.tell(f"{self.name}: {pauses} of the stream cut short by {sum(self.pauses_s):.1f} s in all")
        if self.late_s > LATE_S:
            self.tell(f"{self.name}: runs up to {self.late_s:.1f} s late, frames came faster than at its beginning")

    def _begin(self) -> None:
        """Choose the pace by the frames that are held, and write them."""
        times_s = [time_s for _, time_s in self._held]
        usual_s = max(median([b - a for a, b in pairwise(times_s)] or [1.0]), 1e-3)
        fastest = max(self.most_per_s, 1 / usual_s)
        pace = max(1, math.ceil(min(PACE_MARGIN / usual_s, fastest) - 1e-3))
        video = self.video = VideoWriter(self.path, pace)
        self.longest_hold_s = max(LONGEST_HOLD_S, 4 * usual_s)
        self._began_s = times_s[0]
        held, self._held = self._held, []
        for drawn, time_s in held:
            self._stand(video, drawn, time_s)

    def _stand(self, video: VideoWriter, drawn: Drawn, time_s: float) -> None:
        """Let the last frame stand until ``time_s``, and this one from then on."""
        wait = self._place(video, time_s) - self._written
        longest = round(self.longest_hold_s * video.frames_per_s)
        if wait > longest:
            self.pauses_s.append((wait - longest) / video.frames_per_s)
            self._began_s += self.pauses_s[-1]
            wait = longest
        if self._last is not None and wait > 0:
            video.add(self._last, wait)
            self._written += wait
        self.late_s = max(self.late_s, self._written / video.frames_per_s - (time_s - self._began_s))
        video.add(drawn)
        self._written += 1
        self._last = drawn

    def _place(self, video: VideoWriter, time_s: float) -> int:
        """The frame of the video that is shown at a time, counted from 0."""
        return math.floor((time_s - self._began_s) * video.frames_per_s + 1e-3)


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
