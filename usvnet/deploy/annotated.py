"""Pictures and videos with the boats, their ranges, the horizon and the chart drawn on."""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from usvnet.deploy.outputs import FrameBoats, Write
from usvnet.deploy.sources import Source
from usvnet.deploy.video_writer import RealTimeVideo, VideoWriter
from usvnet.files import atomic_write
from usvnet.visualize.scene import SceneDrawer

SUFFIXES = (".jpg", ".jpeg", ".png", ".webp")
"""Kept as they are; any other picture is written as a JPEG."""
JPEG_QUALITY = 92
PHOTOGRAPHS_PER_S = 2.0
"""Pace of a video of photographs."""


@contextmanager
def annotated_pictures(folder: Path, drawer: SceneDrawer, source: Source) -> Iterator[Write]:
    """Write each frame under its own name; frames of a video as ``frame 000123.jpg``.

    Raises:
        ValueError: the folder holds pictures of the source.
    """
    for path in folder.rglob("*") if folder.is_dir() else ():
        if path.suffix.lower() in SUFFIXES and source.holds(path):
            raise ValueError(f"{path}: an annotated picture would replace its original, choose another output folder")

    def write(found: FrameBoats) -> None:
        name = found.frame.name
        path = folder / (name if Path(name).suffix.lower() in SUFFIXES else f"{name}.jpg")
        drawn = _drawn(drawer, source, found)
        with atomic_write(path) as temporary:
            if not cv2.imwrite(str(temporary), drawn, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]):
                raise OSError(f"{path}: cannot be written")

    yield write


@contextmanager
def annotated_video(path: Path, drawer: SceneDrawer, source: Source) -> Iterator[Write]:
    """Write an MP4 video: a frame for a frame of a video; of a stream every frame too, as long as it lasted.

    Raises:
        ValueError: it would replace the source.
        OSError: it cannot be written.
    """
    if source.holds(path):
        raise ValueError(f"{path}: the annotated video would replace its original, choose another output folder")
    with atomic_write(path) as temporary, ExitStack() as closing:
        if source.is_live:
            live = RealTimeVideo(temporary, path.name, source.tell, source.frames_per_s)
            closing.callback(live.close)
            yield lambda found: live.add(_drawn(drawer, source, found), found.frame.time_s or 0.0)
        else:
            video = VideoWriter(temporary, source.frames_per_s or PHOTOGRAPHS_PER_S)
            closing.callback(video.close)
            yield lambda found: video.add(_drawn(drawer, source, found))


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
