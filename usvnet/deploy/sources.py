"""Where frames come from: photographs and video files here, webcams and streams in :mod:`usvnet.deploy.streams`.

Every source is gone through once, one frame at a time, and keeps nothing that it has handed out. What it could not
read is counted and told, never dropped silently.
"""

import re
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.data.picture_files import find_picture_files
from usvnet.data.pictures import read_picture

Tell = Callable[[str], None]
"""Takes a sentence for the person who waits."""
Capture = Any
"""A ``cv2.VideoCapture``, or what stands in for one."""


class Frame(NamedTuple):
    """One picture and when it was taken."""

    name: str
    """Of a photograph its path below the folder that holds all of them; of a video ``frame 000123``."""
    number: int
    """Its place in the source, from 0; frames that are passed over count."""
    time_s: float | None
    """Seconds since the video began, or since the first of photographs of a known pace; Unix time of arrival from a
    stream; None for other photographs."""
    picture: NDArray[np.uint8]
    """(H, W, 3) RGB, as large as it came."""


@dataclass
class Losses:
    """Frames that were there and did not get through."""

    unreadable: int = 0
    """Damaged pictures, and frames that a video names in its header or packs so that they cannot be decoded."""
    overtaken: int = 0
    """Frames of a stream that a newer one replaced before there was time for them."""
    interruptions: int = 0
    """How often a stream broke off."""


class Source(ABC):
    """Frames one after another, once.

    Attributes:
        name: what a person calls it.
        total: number of frames to come, as far as is known beforehand.
        frames_per_s: pace of a video, None where there is none.
        is_live: frames come whether they are taken or not.
        losses: what did not get through so far.
    """

    is_live = False

    def __init__(self, name: str, tell: Tell, total: int | None = None, frames_per_s: float | None = None) -> None:
        self.name = name
        self.tell = tell
        self.total = total
        self.frames_per_s = frames_per_s
        self.losses = Losses()
        self._stopped = threading.Event()

    def stop(self) -> None:
        """Let the iteration end at the next frame; may be called from a signal handler or another thread."""
        self._stopped.set()

    def holds(self, path: Path) -> bool:
        """Whether the source reads this very file."""
        return False

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames."""


class Photographs(Source):
    """Picture files in order of their names.

    Args:
        name: what a person calls them.
        paths: the files.
        tell: is told of each that cannot be read.
        every: take one in so many.
        fps: how many were taken a second, one after another; None where they have no time.
    """

    def __init__(
        self, name: str, paths: tuple[Path, ...], tell: Tell, every: int = 1, fps: float | None = None
    ) -> None:
        super().__init__(name, tell, total=-(-len(paths) // every), frames_per_s=None if fps is None else fps / every)
        self.paths = paths
        self.every = every
        self.fps = fps
        self._places = {path.resolve() for path in paths}

    def holds(self, path: Path) -> bool:
        """Whether ``path`` is one of the files."""
        return path.resolve() in self._places

    def __iter__(self) -> Iterator[Frame]:
        """Yield the pictures that can be read."""
        folder = _common_folder(self.paths)
        for index in range(0, len(self.paths), self.every):
            if self._stopped.is_set():
                return
            try:
                picture = read_picture(self.paths[index])
            except (ValueError, OSError) as error:
                self.losses.unreadable += 1
                self.tell(f"skipped {error}")
                continue
            time_s = None if self.fps is None else index / self.fps
            yield Frame(self.paths[index].relative_to(folder).as_posix(), index, time_s, picture)


class VideoFile(Source):
    """The frames of a video, from a file or from a web address that ends.

    Args:
        name: path or address.
        capture: the opened video.
        tell: is told of frames that are missing.
        every: take one frame in so many.
    """

    def __init__(self, name: str, capture: Capture, tell: Tell, every: int = 1) -> None:
        promised = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        rate = float(capture.get(cv2.CAP_PROP_FPS))
        super().__init__(
            name,
            tell,
            total=-(-promised // every) if promised > 0 else None,
            frames_per_s=rate / every if 0 < rate < 1000 else None,
        )
        self.capture = capture
        self.every = every
        self.promised = promised

    def holds(self, path: Path) -> bool:
        """Whether ``path`` is the video."""
        return path.resolve() == Path(self.name).resolve()

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames that can be decoded."""
        index = 0
        try:
            while not self._stopped.is_set() and self.capture.grab():
                if index % self.every == 0:
                    time_s = self._time_s(index)
                    picture = decoded(self.capture)
                    if picture is None:
                        self.losses.unreadable += 1
                        self.tell(f"skipped frame {index} of {self.name}: it cannot be decoded")
                    else:
                        yield Frame(f"frame {index:06d}", index, time_s, picture)
                index += 1
            missing = self.promised - index
            if missing > 0 and not self._stopped.is_set():
                self.losses.unreadable += -(-missing // self.every)
                self.tell(f"{self.name}: only {index} of the {self.promised} frames that its header names can be read")
        finally:
            self.capture.release()

    def _time_s(self, index: int) -> float:
        clock_s = float(self.capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000
        if clock_s > 0 or index == 0 or self.frames_per_s is None:
            return max(clock_s, 0.0)
        return index / (self.frames_per_s * self.every)


def decoded(capture: Capture) -> NDArray[np.uint8] | None:
    """The frame that ``capture`` has grabbed as RGB, None where it cannot be decoded."""
    readable, picture = capture.retrieve()
    if not readable or picture is None or picture.size == 0:
        return None
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)


def check_every(every: int) -> None:
    """Insist on a step of at least 1.

    Raises:
        ValueError: what was got.
    """
    if every < 1:
        raise ValueError(f"every: got {every}, expected at least 1")


def is_address(source: str) -> bool:
    """Whether ``source`` is an address such as rtsp://camera/stream and not a file."""
    return re.match(r"[A-Za-z][A-Za-z0-9+.-]*://", source) is not None


def check_fps(fps: float) -> None:
    """Insist on a pace that a video can have.

    Raises:
        ValueError: what was got.
    """
    if not 0 < fps < 1000:
        raise ValueError(f"fps: got {fps:g}, expected pictures per second, above 0 and below 1000")


def open_files(source: str, tell: Tell, every: int = 1, fps: float | None = None) -> Photographs | VideoFile:
    """Open a picture, a folder or glob of pictures, or a video file.

    Raises:
        FileNotFoundError: nothing there.
        ValueError: a video that cannot be opened, one among other files, or a pace for one, which has its own.
    """
    check_every(every)
    files = find_picture_files(source)
    if not files.is_video:
        if fps is not None:
            check_fps(fps)
        return Photographs(source, files.paths, tell, every, fps)
    if fps is not None:
        raise ValueError(f"fps: {files.paths[0]} is a video and has its own pace, expected pictures")
    capture = cv2.VideoCapture(str(files.paths[0]))
    if not capture.isOpened():
        raise ValueError(f"{files.paths[0]}: not a video that OpenCV can read")
    return VideoFile(str(files.paths[0]), capture, tell, every)


def _common_folder(paths: tuple[Path, ...]) -> Path:
    """The deepest folder that holds all ``paths``."""
    folder = paths[0].parent
    while not all(path.is_relative_to(folder) for path in paths):
        folder = folder.parent
    return folder
