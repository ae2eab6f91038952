"""Photographs and videos come frame by frame, and what cannot be read is counted and named."""

import weakref

import cv2
import numpy as np
import pytest

from usvnet.deploy.sources import VideoFile, is_address, open_files

SIZE_PX = (64, 48)


def picture(grey):
    return np.full((SIZE_PX[1], SIZE_PX[0], 3), grey, np.uint8)


@pytest.fixture
def folder(tmp_path):
    for number in range(4):
        cv2.imwrite(str(tmp_path / f"{number}.png"), picture(40 * number))
    return tmp_path


@pytest.fixture
def video(tmp_path):
    path = tmp_path / "sea.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 10.0, SIZE_PX)
    for number in range(12):
        writer.write(picture(20 * number))
    writer.release()
    return path


@pytest.fixture
def told():
    return []


class FakeVideo:
    """Stands in for a video whose frames ``broken`` cannot be decoded and whose header promises ``promised``."""

    def __init__(self, frames, promised, broken=()):
        self.frames, self.promised, self.broken = frames, promised, broken
        self.position = -1
        self.released = False

    def get(self, key):
        return {cv2.CAP_PROP_FRAME_COUNT: self.promised, cv2.CAP_PROP_FPS: 5.0}.get(key, 0.0)

    def grab(self):
        self.position += 1
        return self.position < self.frames

    def retrieve(self):
        return (False, None) if self.position in self.broken else (True, picture(self.position))

    def release(self):
        self.released = True


def test_a_folder_comes_in_order_as_rgb(folder, told):
    cv2.imwrite(str(folder / "2.png"), np.full((48, 64, 3), (255, 0, 0), np.uint8))
    source = open_files(str(folder), told.append)
    frames = list(source)
    assert [frame.name for frame in frames] == ["0.png", "1.png", "2.png", "3.png"]
    assert [frame.number for frame in frames] == [0, 1, 2, 3]
    assert frames[2].picture[0, 0].tolist() == [0, 0, 255]
    assert frames[0].time_s is None
    assert source.total == 4


def test_a_damaged_picture_is_skipped_counted_and_named(folder, told):
    (folder / "1.png").write_bytes(b"no picture")
    source = open_files(str(folder), told.append)
    assert [frame.name for frame in source] == ["0.png", "2.png", "3.png"]
    assert source.losses.unreadable == 1
    assert len(told) == 1
    assert "1.png" in told[0]


def test_names_of_a_glob_start_at_the_folder_that_holds_all(folder, told):
    (folder / "a" / "b").mkdir(parents=True)
    cv2.imwrite(str(folder / "a" / "b" / "5.png"), picture(3))
    names = [frame.name for frame in open_files(f"{folder}/**/*.png", told.append)]
    assert names == ["0.png", "1.png", "2.png", "3.png", "a/b/5.png"]


def test_every_second_picture_and_stop(folder, told):
    assert [frame.name for frame in open_files(str(folder), told.append, every=2)] == ["0.png", "2.png"]
    source = open_files(str(folder), told.append)
    frames = iter(source)
    next(frames)
    source.stop()
    assert list(frames) == []


def test_a_source_knows_its_own_files(folder, video, told):
    photographs = open_files(str(folder / "*.png"), told.append)
    assert photographs.holds(folder / "x" / ".." / "1.png")
    assert not photographs.holds(folder / "9.png")
    film = open_files(str(video), told.append)
    assert film.holds(video)
    assert not film.holds(folder / "1.png")


@pytest.mark.parametrize("every", [1, 3])
def test_a_video_has_its_frames_and_their_times(video, told, every):
    source = open_files(str(video), told.append, every)
    frames = list(source)
    assert [frame.number for frame in frames] == list(range(0, 12, every))
    assert source.total == len(frames)
    assert source.frames_per_s == pytest.approx(10 / every)
    assert [frame.time_s for frame in frames] == pytest.approx([frame.number / 10 for frame in frames])
    for frame in frames:
        assert np.abs(frame.picture.astype(int) - 20 * frame.number).mean() < 4
    assert told == []


def test_frames_that_cannot_be_decoded_or_are_missing_are_counted(told):
    capture = FakeVideo(frames=6, promised=9, broken={2})
    source = VideoFile("sea.mp4", capture, told.append)
    assert [frame.number for frame in source] == [0, 1, 3, 4, 5]
    assert source.losses.unreadable == 4
    assert len(told) == 2
    assert "frame 2 of sea.mp4" in told[0]
    assert "only 6 of the 9 frames" in told[1]
    assert capture.released


def test_a_video_without_a_clock_counts_its_frames(told):
    assert [frame.time_s for frame in VideoFile("x", FakeVideo(4, 4), told.append)] == pytest.approx([0, 0.2, 0.4, 0.6])


def test_a_stopped_video_does_not_miss_frames(told):
    source = VideoFile("sea.mp4", FakeVideo(frames=9, promised=9), told.append)
    for frame in source:
        if frame.number == 3:
            source.stop()
    assert (told, source.losses.unreadable) == ([], 0)


def test_a_source_keeps_no_frame_that_was_handed_out(folder, video, told):
    for source in (open_files(str(folder / "*.png"), told.append), open_files(str(video), told.append)):
        handed_out = []
        for frame in source:
            handed_out.append(weakref.ref(frame.picture))
            del frame
            assert sum(picture() is not None for picture in handed_out) <= 1


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("nothing", "no file matches"),
        ("*.gif", "no file matches"),
        ("empty", "no pictures in the folder"),
        ("text.mp4", "not a video that OpenCV can read"),
        ("*", "one video or only photos"),
    ],
)
def test_what_cannot_be_a_source_is_refused(tmp_path, told, source, sentence):
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.mp4").write_text("no video")
    (tmp_path / "other.mp4").write_text("no video")
    with pytest.raises((ValueError, FileNotFoundError), match=sentence):
        open_files(str(tmp_path / source), told.append)


def test_a_step_below_one_is_refused(folder, told):
    with pytest.raises(ValueError, match="every: got 0"):
        open_files(str(folder), told.append, every=0)


def test_addresses_are_told_from_files():
    assert is_address("rtsp://camera/1")
    assert not is_address("C:/videos/sea.mp4")
    assert not is_address("a/b.mp4")
