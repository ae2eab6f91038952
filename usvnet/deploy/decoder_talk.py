"""What FFmpeg and OpenCV say of a broken video, which they write past Python: kept off the screen, and counted.

FFmpeg fills damaged places of a frame with what it finds beside them, and only says so on stderr. In the middle of a
progress bar its words help nobody, but that it had to is worth knowing.
"""

import os
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from usvnet.wording import counted

FFMPEG = re.compile(rb"\[(?P<who>[^\]@]+) @ (?:0x)?[0-9a-fA-F]+\] *(?P<what>.*)")
REPEATED = re.compile(rb"\s*Last message repeated (\d+) times?")
OPENCV = re.compile(rb"\[ *(?:INFO|WARN|ERROR|FATAL):[^\]]*\] global ")
LINES = {"tcp", "udp", "http", "https", "tls", "rtsp", "rtp", "rtmp", "srt"}
"""Parts of FFmpeg that speak of the connection: what becomes of that is told by the stream."""


class DecoderTalk:
    """How often the decoder complained of a picture, and what it said first."""

    def __init__(self) -> None:
        self.complaints = 0
        self.first = ""
        self._of_pictures = False

    def hears(self, line: bytes) -> bool:
        """Count a line of stderr; False where it is none of FFmpeg's or OpenCV's."""
        if said := FFMPEG.match(line):
            self._of_pictures = said["who"].decode(errors="replace") not in LINES
            self.complaints += self._of_pictures
            if self._of_pictures and not self.first:
                self.first = said["what"].decode(errors="replace").strip()
            return True
        if repeated := REPEATED.match(line):
            self.complaints += int(repeated[1]) if self._of_pictures else 0
            return True
        return OPENCV.match(line) is not None

    def told(self) -> str:
        """One sentence of it; empty where there was nothing."""
        if not self.complaints:
            return ""
        times = counted(self.complaints, "time")
        return f"the decoder complained {times} (first: {self.first}): some frames may be damaged"


@contextmanager
def decoder_talk() -> Iterator[DecoderTalk]:
    """Take from stderr what FFmpeg and OpenCV write there, as long as the context lasts; all else goes through."""
    talk = DecoderTalk()
    screen = os.dup(2)
    listening, speaking = os.pipe()
    os.set_blocking(speaking, False)  # a line is lost rather than the program stopped, should nobody listen
    listener = threading.Thread(target=_listen, args=(listening, screen, talk), daemon=True)
    python_stderr = sys.stderr
    direct = _directly(screen)
    os.dup2(speaking, 2)
    os.close(speaking)
    listener.start()
    try:
        yield talk
    finally:
        if direct is not None:
            sys.stderr = python_stderr
            direct.close()
        os.dup2(screen, 2)  # the last end to speak into is closed, so the listener ends
        listener.join()
        os.close(screen)


def _directly(screen: int) -> TextIO | None:
    """Let Python write to the screen itself, where a progress bar finds its terminal; None where it does not now."""
    try:
        if sys.stderr.fileno() != 2:
            return None
    except (AttributeError, OSError, ValueError):  # none, or one that is no file
        return None
    sys.stderr.flush()
    sys.stderr = os.fdopen(os.dup(screen), "w", buffering=1, encoding=sys.stderr.encoding, errors=sys.stderr.errors)
    return sys.stderr


def _listen(listening: int, screen: int, talk: DecoderTalk) -> None:
    with os.fdopen(listening, "rb") as lines:
        for line in lines:
            if not talk.hears(line):
                os.write(screen, line)
