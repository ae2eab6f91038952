"""Webcams and network streams: always the newest frame, and patience with a line that breaks."""

import threading
import time
from collections.abc import Callable, Iterator

import cv2

from usvnet.deploy.sources import Capture, Frame, Source, Tell, VideoFile, check_every, decoded, is_address, open_files
from usvnet.wording import counted

PROTOCOLS = ("rtsp", "rtsps", "http", "https", "rtmp", "udp", "tcp", "rtp", "srt")
OPEN_TIMEOUT_MS, READ_TIMEOUT_MS = 10_000, 5_000
WAITS_S = (0.5, 1.0, 2.0, 4.0, 8.0, 15.0, 30.0)
"""Pauses before each attempt to open a stream again; after the last one it is given up."""
LOOK_S = 0.1
"""How often a waiting program looks whether it was asked to stop."""


class LiveStream(Source):
    """The newest frame of a webcam or a stream, each at most once.

    A thread reads all the time, as fast as frames come, so that what is handed out is never older than the time that
    the last one took. One frame waits at most: a newer one takes its place, and the lost one is counted. A stream that
    breaks off is opened again after a pause, which grows; when the last attempt has failed the iteration ends.

    Args:
        name: what a person calls it.
        open_capture: opens it, and opens it anew.
        tell: is told when it breaks off and when it is back.
        every: take one frame in so many.
        waits_s: the pauses.

    Raises:
        ConnectionError: it cannot be opened.
    """

    is_live = True

    def __init__(
        self,
        name: str,
        open_capture: Callable[[], Capture],
        tell: Tell,
        every: int = 1,
        waits_s: tuple[float, ...] = WAITS_S,
    ) -> None:
        self.open_capture = open_capture
        self.every = every
        self.waits_s = waits_s
        self.capture = open_capture()
        if not self.capture.isOpened():
            raise ConnectionError(f"{name}: cannot be opened, is the camera there and its address right?")
        rate = float(self.capture.get(cv2.CAP_PROP_FPS))
        super().__init__(name, tell, frames_per_s=rate / every if 0 < rate < 1000 else None)
        self.given_up = False
        self._change = threading.Condition()
        self._newest: Frame | None = None
        self._ended = False
        self._failure: Exception | None = None

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames until the stream is stopped or given up."""
        reader = threading.Thread(target=self._read, name=f"reader of {self.name}", daemon=True)
        reader.start()
        try:
            while (frame := self._take()) is not None:
                yield frame
                del frame  # or two would be kept while the next one is awaited
        finally:
            self.stop()
            reader.join(READ_TIMEOUT_MS / 1000)
        if self._failure is not None:
            raise self._failure

    def _take(self) -> Frame | None:
        """Wait for a frame that has not been handed out; None when there will be none."""
        with self._change:
            while self._newest is None:
                if self._ended or self._stopped.is_set():
                    return None
                self._change.wait(LOOK_S)
            frame, self._newest = self._newest, None
        return None if self._stopped.is_set() else frame

    def _read(self) -> None:
        """Fill the place of the newest frame, in a thread of its own."""
        index = attempt = 0
        try:
            while not self._stopped.is_set():
                if not self.capture.grab():
                    if not self._reopen(attempt):
                        return
                    attempt += 1
                    continue
                if attempt:
                    self.tell(f"{self.name} is back")
                    attempt = 0
                if index % self.every == 0:
                    time_s = time.time()
                    picture = decoded(self.capture)
                    if picture is None:
                        self.losses.unreadable += 1
                        self.tell(f"skipped frame {index} of {self.name}: it cannot be decoded")
                    else:
                        self._put(Frame(f"frame {index:06d}", index, time_s, picture))
                index += 1
        except Exception as error:  # a thread must not die in silence: the iteration raises it
            self._failure = error
        finally:
            self.capture.release()
            with self._change:
                self._ended = True
                self._change.notify()

    def _put(self, frame: Frame) -> None:
        with self._change:
            self.losses.overtaken += self._newest is not None
            self._newest = frame
            self._change.notify()

    def _reopen(self, attempt: int) -> bool:
        """Open the stream once more, after the pause of this attempt; False when it was stopped or is given up."""
        self.losses.interruptions += attempt == 0
        self.capture.release()
        if attempt == len(self.waits_s):
            self.given_up = True
            self.tell(f"{self.name} is given up after {counted(attempt, 'attempt')}")
            return False
        wait_s = self.waits_s[attempt]
        self.tell(f"{self.name} broke off: attempt {attempt + 1} of {len(self.waits_s)} in {wait_s:g} s")
        if self._stopped.wait(wait_s):
            return False
        self.capture = self.open_capture()  # where this fails, so does the next grab
        return True


def open_source(source: str, tell: Tell, every: int = 1, fps: float | None = None) -> Source:
    """Open whatever a person names: pictures, a video, the number of a webcam, or the address of a stream.

    Args:
        source: path, folder, glob, webcam index, or address (rtsp://, http:// and so on).
        tell: is told of everything that goes wrong later.
        every: take one frame in so many.
        fps: how many pictures of a folder were taken a second.

    Raises:
        FileNotFoundError: nothing there.
        ConnectionError: a webcam or stream that cannot be opened.
        ValueError: not a video, a protocol that is not known, ``every`` below 1, or ``fps`` of what has its own pace.
    """
    check_every(every)
    if fps is not None and is_stream(source):
        raise ValueError(f"fps: {source} has its own pace, expected pictures")
    if source.isdecimal():
        return LiveStream(f"webcam {source}", lambda: cv2.VideoCapture(int(source)), tell, every)
    if not is_address(source):
        return open_files(source, tell, every, fps)
    protocol = source.split("://")[0].lower()
    if protocol not in PROTOCOLS:
        raise ValueError(f"{source}: got the protocol {protocol!r}, expected one of {', '.join(PROTOCOLS)}")
    stream = LiveStream(without_password(source), lambda: _open_address(source), tell, every)
    if stream.capture.get(cv2.CAP_PROP_FRAME_COUNT) > 0:  # a file on the web has an end, a stream has none
        return VideoFile(stream.name, stream.capture, tell, every)
    return stream


def is_stream(source: str) -> bool:
    """Whether ``source`` is the number of a webcam or an address, and not files."""
    return source.isdecimal() or is_address(source)


def without_password(address: str) -> str:
    """``rtsp://user:secret@camera/1`` as ``rtsp://camera/1``: names go into files and onto screens."""
    protocol, _, rest = address.partition("://")
    host, slash, path = rest.partition("/")
    return f"{protocol}://{host.rpartition('@')[2]}{slash}{path}"


def _open_address(address: str) -> Capture:
    timeouts = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_TIMEOUT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_TIMEOUT_MS]
    return cv2.VideoCapture(address, cv2.CAP_FFMPEG, timeouts)
