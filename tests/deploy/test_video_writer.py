"""Every frame of a stream stands in its video, from its own time on, and what differs from true time is told."""

import re

import cv2
import numpy as np
import pytest

from usvnet.deploy import video_writer
from usvnet.deploy.video_writer import HELD_FRAMES, RealTimeVideo, VideoWriter, best_codec

SIZE_PX = (64, 48)
STEP = 12
"""Of grey from frame to frame: more than encoding changes."""


def grey(number):
    return np.full((SIZE_PX[1], SIZE_PX[0], 3), STEP * (number % 20), np.uint8)


def written(tmp_path, times_s, most_per_s=None):
    """Pace of the video of a stream, the numbers of the frames that stand in it one after another, and what is told."""
    told = []
    video = RealTimeVideo(tmp_path / "video.mp4", "video.mp4", told.append, most_per_s)
    for number, time_s in enumerate(times_s):
        video.add(grey(number), time_s)
    video.close()
    file = cv2.VideoCapture(str(tmp_path / "video.mp4"))
    shown = []
    while (read := file.read())[0]:
        shown.append(round(read[1].mean() / STEP))
    return file.get(cv2.CAP_PROP_FPS), shown, told


def first_shown_s(pace, shown):
    return [shown.index(number) / pace for number in dict.fromkeys(shown)]


def test_frames_that_come_evenly_stand_evenly(tmp_path):
    pace, shown, told = written(tmp_path, [1000 + n / 4 for n in range(10)])
    assert (pace, told) == (8, [])
    assert shown == [n // 2 for n in range(19)]


def test_no_frame_is_left_out_where_later_ones_come_faster_than_the_first(tmp_path):
    times_s = np.cumsum([1000, *[1.0] * (HELD_FRAMES - 1), *[0.6, 0.7] * 6])
    pace, shown, told = written(tmp_path, times_s)
    assert (pace, told) == (2, [])
    assert list(dict.fromkeys(shown)) == list(range(len(times_s)))
    late_s = np.subtract(first_shown_s(pace, shown), times_s - 1000)
    assert (np.abs(late_s) <= 1 / pace + 1e-9).all()


def test_frames_that_come_all_at_once_stand_once_and_the_time_is_made_up_for(tmp_path):
    times_s = np.cumsum([1000, *[0.2] * 5, 0.01, 0.01, 0.01, 0.77])
    pace, shown, told = written(tmp_path, times_s)
    assert (pace, told) == (10, [])
    assert [shown.count(n) for n in range(10)] == [2, 2, 2, 2, 2, 1, 1, 1, 5, 1]
    assert first_shown_s(pace, shown)[-1] == pytest.approx(times_s[-1] - 1000)


def test_a_pause_is_cut_short_and_told(tmp_path):
    pace, shown, told = written(tmp_path, [0, 0.1, 0.2, 0.3, 0.4, 0.5, 30.5, 30.6, 50.6])
    assert [shown.count(n) for n in (5, 7)] == [2 * pace + 1] * 2
    (sentence,) = told
    cut_s = re.fullmatch(r"video\.mp4: 2 pauses of the stream cut short by (.*) s in all", sentence)[1]
    assert float(cut_s) == pytest.approx(50.6 + 1 / pace - len(shown) / pace, abs=1 / pace)


def test_a_slow_computer_is_no_pause(tmp_path):
    pace, shown, told = written(tmp_path, [5.0 * n for n in range(8)])
    assert (pace, shown, told) == (1, [n // 5 for n in range(36)], [])


def test_a_video_that_runs_late_says_so(tmp_path):
    times_s = np.cumsum([0, *[1.0] * (HELD_FRAMES - 1), *[0.1] * 12])
    pace, shown, told = written(tmp_path, times_s)
    assert list(dict.fromkeys(shown)) == list(range(len(times_s)))
    late_s = max(np.subtract(first_shown_s(pace, shown), times_s))
    assert told == [f"video.mp4: runs up to {late_s:.1f} s late, frames came faster than at its beginning"]


@pytest.mark.parametrize(("most_per_s", "expected"), [(25.0, 25), (None, 50), (10.0, 25)])
def test_the_video_is_no_faster_than_the_stream_says_unless_it_is(tmp_path, most_per_s, expected):
    pace, shown, _ = written(tmp_path, [n / 25 for n in range(8)], most_per_s)
    assert (pace, list(dict.fromkeys(shown))) == (expected, list(range(8)))


@pytest.mark.parametrize("count", [1, 2, HELD_FRAMES - 1])
def test_a_stream_of_few_frames_is_a_video_of_all_of_them(tmp_path, count):
    _, shown, _ = written(tmp_path, [1000.0 + n for n in range(count)])
    assert list(dict.fromkeys(shown)) == list(range(count))


def test_a_stream_of_no_frames_leaves_no_file(tmp_path):
    RealTimeVideo(tmp_path / "video.mp4", "video.mp4", print, None).close()
    assert list(tmp_path.iterdir()) == []


def test_the_first_codec_that_works_is_taken_without_a_word(tmp_path, monkeypatch, capfd):
    assert best_codec((64, 48)) in video_writer.CODECS
    monkeypatch.setattr(video_writer, "CODECS", ("none", "mp4v"))
    video = VideoWriter(tmp_path / "video.mp4", 10.0)
    video.add(grey(0))
    video.close()
    assert cv2.VideoCapture(str(tmp_path / "video.mp4")).read()[0]
    assert capfd.readouterr().err == ""
    monkeypatch.setattr(video_writer, "CODECS", ("none",))
    with pytest.raises(OSError, match="OpenCV can write no video of 64 x 48 by any of none"):
        best_codec((64, 48))
