"""A stream that breaks is opened again, one that is faster than its user loses frames by the count, and none hangs."""

import threading

import cv2
import numpy as np
import pytest

from usvnet.deploy import streams
from usvnet.deploy.sources import VideoFile
from usvnet.deploy.streams import LiveStream, open_source, without_password

QUICK = (0.0, 0.001, 0.002)


class FakeCapture:
    """A connection that delivers ``frames`` frames, waiting for ``turn`` before each, and then breaks."""

    def __init__(self, frames, turn=None, opened=True, bad=(), count=-1.0):
        self.frames, self.turn, self.opened, self.bad, self.count = frames, turn, opened, bad, count
        self.taken = 0
        self.released = False

    def isOpened(self):
        return self.opened

    def get(self, key):
        return {cv2.CAP_PROP_FPS: 30.0, cv2.CAP_PROP_FRAME_COUNT: self.count}.get(key, 0.0)

    def grab(self):
        if not self.opened or self.taken == self.frames:
            return False
        if self.turn is not None:
            self.turn.acquire(timeout=5)
        self.taken += 1
        return True

    def retrieve(self):
        return (False, None) if self.taken - 1 in self.bad else (True, np.full((4, 6, 3), self.taken % 256, np.uint8))

    def release(self):
        self.released = True


@pytest.fixture
def told():
    return []


def stream_of(captures, told, waits_s=QUICK, **options):
    """A stream whose connections are these, in turn."""
    connections = iter(captures)
    return LiveStream("rtsp://camera", lambda: next(connections), told.append, waits_s=waits_s, **options)


def taken_in_step(stream, turn, most=1000):
    """Take frames, letting the camera make the next one only when the last was taken."""
    taken = []
    turn.release()
    for frame in stream:
        taken.append(frame)
        if len(taken) == most:
            stream.stop()
        turn.release()
    return taken


def test_a_dropped_stream_comes_back_and_says_so(told):
    turn = threading.Semaphore(0)
    dead, gone = FakeCapture(0, opened=False), [FakeCapture(0, opened=False) for _ in QUICK]
    captures = [FakeCapture(2, turn), dead, FakeCapture(3, turn), *gone]
    stream = stream_of(captures, told)
    turn.release()
    numbers = [frame.number for frame in taken_in_step(stream, turn)]
    assert numbers[-1] == 4
    assert len(numbers) + stream.losses.overtaken == 5
    assert stream.losses.interruptions == 2
    assert stream.given_up
    assert [told.index(sentence) for sentence in told if sentence.endswith("is back")] == [2]
    assert "broke off: attempt 1 of 3" in told[0]
    assert told[-1] == "rtsp://camera is given up after 3 attempts"
    assert all(capture.released for capture in captures)


def test_a_connection_that_opens_and_gives_nothing_does_not_go_on_for_ever(told):
    stream = stream_of([FakeCapture(0) for _ in range(4)], told)
    assert list(stream) == []
    assert stream.given_up
    assert stream.losses.interruptions == 1
    assert not any("is back" in sentence for sentence in told)


def test_overtaken_frames_are_counted_and_only_the_newest_is_kept(told):
    stream = stream_of([FakeCapture(500), *(FakeCapture(0, opened=False) for _ in QUICK)], told)
    frames = list(stream)
    assert len(frames) + stream.losses.overtaken == 500
    assert frames[-1].number == 499
    assert [frame.number for frame in frames] == sorted({frame.number for frame in frames})


def test_frames_that_cannot_be_decoded_are_counted(told):
    capture = FakeCapture(4, bad={1, 2})
    stream = stream_of([capture, *(FakeCapture(0, opened=False) for _ in QUICK)], told)
    frames = list(stream)
    assert stream.losses.unreadable == 2
    assert len(frames) + stream.losses.overtaken == 2


def test_an_error_while_reading_is_raised_and_not_swallowed(told):
    capture = FakeCapture(3)
    capture.retrieve = lambda: 1 / 0
    with pytest.raises(ZeroDivisionError):
        list(stream_of([capture], told))


def test_every_third_frame(told):
    turn = threading.Semaphore(100)
    stream = stream_of([FakeCapture(9, turn), *(FakeCapture(0, opened=False) for _ in QUICK)], told, every=3)
    frames = list(stream)
    assert {frame.number for frame in frames} <= {0, 3, 6}
    assert len(frames) + stream.losses.overtaken == 3
    assert stream.frames_per_s == pytest.approx(10)


def test_stopping_ends_a_stream_that_is_waiting_for_its_camera(told):
    stream = stream_of([FakeCapture(1), *(FakeCapture(0, opened=False) for _ in range(9))], told, waits_s=(60.0,))
    frames = iter(stream)
    assert next(frames).number == 0
    threading.Timer(0.05, stream.stop).start()
    assert list(frames) == []
    assert not stream.given_up


def test_a_camera_that_is_not_there_is_refused_at_once(told):
    with pytest.raises(ConnectionError, match="rtsp://camera: cannot be opened"):
        stream_of([FakeCapture(0, opened=False)], told)
    with pytest.raises(ConnectionError, match="webcam 87"):
        open_source("87", told.append)


@pytest.mark.parametrize("source", ["ftp://camera/1", "file:///sea.mp4"])
def test_an_unknown_protocol_is_refused(source, told):
    with pytest.raises(ValueError, match="expected one of rtsp"):
        open_source(source, told.append)


@pytest.mark.parametrize(("count", "kind"), [(25.0, VideoFile), (-1.0, LiveStream), (0.0, LiveStream)])
def test_a_file_on_the_web_ends_and_a_stream_does_not(monkeypatch, told, count, kind):
    monkeypatch.setattr(streams, "_open_address", lambda address: FakeCapture(3, count=count))
    source = open_source("http://me:secret@camera/sea", told.append)
    assert isinstance(source, kind)
    assert source.name == "http://camera/sea"


def test_passwords_are_left_out_of_names():
    assert without_password("rtsp://me:p@ss@camera:554/1?a=b@c") == "rtsp://camera:554/1?a=b@c"
    assert without_password("http://camera/1") == "http://camera/1"
