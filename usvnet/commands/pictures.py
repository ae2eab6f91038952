"""Grey pictures from a glob of photographs, a folder or a video."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2

from usvnet.data.picture_files import find_picture_files
from usvnet.data.pictures import Grey, read_grey
from usvnet.deploy.decoder_talk import decoder_talk


@dataclass(frozen=True)
class Pictures:
    """Named grey pictures, read one at a time; can be gone through more than once."""

    files: tuple[Path, ...]
    every_n_frames: int = 0
    """0 for photographs, else the step through the only file, a video."""

    @property
    def is_video(self) -> bool:
        """Whether the pictures are frames of a video."""
        return self.every_n_frames > 0

    def __len__(self) -> int:
        """Return the number of pictures (of a video: what its header says)."""
        if not self.is_video:
            return len(self.files)
        frames = int(self._open_video().get(cv2.CAP_PROP_FRAME_COUNT))
        return max(0, -(-frames // self.every_n_frames))

    def __iter__(self) -> Iterator[tuple[str, Grey]]:
        """Yield (name, (H, W) uint8), or raise ValueError naming the file that cannot be read."""
        if self.is_video:
            yield from self._frames()
            return
        for file in self.files:
            yield file.name, read_grey(file)

    def _open_video(self) -> cv2.VideoCapture:
        with decoder_talk():
            video = cv2.VideoCapture(str(self.files[0]))
        if not video.isOpened():
            raise ValueError(f"{self.files[0]}: not a video that can be read")
        return video

    def _frames(self) -> Iterator[tuple[str, Grey]]:
        video = self._open_video()
        number = 0
        while video.grab():
            if number % self.every_n_frames == 0:
                readable, frame = video.retrieve()
                if readable:
                    yield f"frame {number}", cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
            number += 1
        video.release()


def open_pictures(source: str, every_n_frames: int) -> Pictures:
    """Photographs by a glob, all photographs of a folder, or every n-th frame of a video file.

    Raises:
        FileNotFoundError: nothing there.
        ValueError: ``every_n_frames`` below 1, or a video among several files.
    """
    if every_n_frames < 1:
        raise ValueError(f"every_n_frames must be at least 1, got {every_n_frames}")
    files, is_video = find_picture_files(source)
    return Pictures(files, every_n_frames if is_video else 0)
