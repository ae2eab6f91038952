"""``usvnet predict`` from the command line to the files."""

import csv
import json
import os
import re
import signal

import cv2
import numpy as np
import pytest
from turned_jpegs import write_turned

from usvnet import cli
from usvnet.commands import predict as command
from usvnet.deploy import predictor as predictor_room
from usvnet.deploy.streams import LiveStream
from usvnet.files import Terminated
from usvnet.geometry.camera import make_camera
from usvnet.geometry.camera_files import save_camera

SIZE_PX = (96, 64)


@pytest.fixture(autouse=True)
def not_compiled(monkeypatch):
    """A network as it is: making it fast takes longer than these pictures."""

    def with_confidence(model, confidence):
        model.score_threshold = confidence
        return model

    monkeypatch.setattr(predictor_room, "_made_fast", with_confidence)


@pytest.fixture
def camera(tmp_path):
    path = tmp_path / "camera.yaml"
    K = [[90.0, 0, 47.5], [0, 90.0, 31.5], [0, 0, 1]]
    save_camera(make_camera(K, SIZE_PX, height_m=1.5, pitch_rad=0.3), path)
    return path


def picture(number, size_px=SIZE_PX):
    return np.random.default_rng(number).integers(0, 255, (size_px[1], size_px[0], 3), np.uint8)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "pictures").mkdir()
    for number in range(4):
        cv2.imwrite(str(tmp_path / "pictures" / f"{number}.png"), picture(number))
    return tmp_path / "pictures"


@pytest.fixture
def video(tmp_path):
    path = tmp_path / "sea.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 10.0, SIZE_PX)
    for number in range(6):
        writer.write(picture(number))
    writer.release()
    return path


@pytest.fixture
def predict(camera, untrained, tmp_path):
    """Run the command; returns the folder of its results."""

    def run(source, *options):
        arguments = ["predict", str(source), "--camera", str(camera), "--checkpoint", str(untrained)]
        settings = ["--output", str(tmp_path / "out"), "--confidence", "0", "--image-size", "64"]
        cli.run([*arguments, *settings, *options])
        return tmp_path / "out"

    return run


def results(out):
    meta, *frames = [json.loads(line) for line in (out / "predictions.jsonl").read_text().splitlines()]
    rows = list(csv.DictReader((out / "predictions.csv").open(newline="")))
    assert [row["image"] for row in rows] == [frame["image"] for frame in frames for _ in frame["boats"]]
    return meta["meta"], frames


def names(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_a_folder_with_a_bad_picture(predict, folder, capsys):
    (folder / "2.png").write_bytes(b"damaged")
    out = predict(folder)
    meta, frames = results(out)
    assert names(out) == [*(f"pictures/{n}.png" for n in (0, 1, 3)), "predictions.csv", "predictions.jsonl"]
    assert [frame["image"] for frame in frames] == ["0.png", "1.png", "3.png"]
    assert all(frame["size_px"] == list(SIZE_PX) and frame["boats"] for frame in frames)
    assert (meta["source"], meta["image_size"], meta["confidence"]) == (str(folder), 64, 0)
    told = capsys.readouterr()
    assert "3 frames in" in told.out
    assert "frames per second" in told.out
    assert "1 frame could not be read" in told.out
    assert "2.png" in told.err


def test_a_glob_in_batches_is_the_same_as_a_folder(predict, folder):
    _, one_by_one = results(predict(folder, "--save", "none"))
    _, together = results(predict(folder / "*.png", "--save", "none", "--batch-size", "3"))
    assert [frame["image"] for frame in one_by_one] == [frame["image"] for frame in together]
    for frame, other in zip(one_by_one, together):
        boxes, other_boxes = ([boat["box_px"] for boat in f["boats"]] for f in (frame, other))
        np.testing.assert_allclose(boxes, other_boxes, atol=0.01)


def test_one_picture(predict, folder, capsys):
    out = predict(folder / "1.png", "--estimator", "box_bottom")
    meta, (frame,) = results(out)
    assert frame["image"] == "1.png"
    assert {boat["estimator"] for boat in frame["boats"]} == {meta["estimator"]} == {"box_bottom"}
    assert cv2.imread(str(out / "pictures" / "1.png")).shape == (128, 192, 3)
    assert "1 frame in " in capsys.readouterr().out


def test_a_picture_is_predicted_as_it_stands_upright(predict, tmp_path):
    (tmp_path / "phone").mkdir()
    write_turned(tmp_path / "phone" / "turned.jpg", picture(0))
    upright = cv2.imread(str(tmp_path / "phone" / "turned.jpg"))
    cv2.imwrite(str(tmp_path / "phone" / "upright.png"), upright)
    turned, same = results(predict(tmp_path / "phone"))[1]
    assert turned["size_px"] == list(SIZE_PX)
    assert turned["boats"] == same["boats"]
    assert cv2.imread(str(tmp_path / "out" / "pictures" / "turned.jpg")).shape[1::-1] == (192, 128)


def length(path):
    video = cv2.VideoCapture(str(path))
    return sum(1 for _ in iter(video.grab, False))


def test_a_video(predict, video):
    out = predict(video)
    _, frames = results(out)
    assert names(out) == ["predictions.csv", "predictions.jsonl", "video.mp4"]
    assert [frame["time_s"] for frame in frames] == pytest.approx([n / 10 for n in range(6)])
    assert length(out / "video.mp4") == 6


def test_a_damaged_video_is_told_in_one_sentence_and_not_by_its_decoder(predict, video, capfd):
    data = bytearray(video.read_bytes())
    begin, end = data.find(b"mdat") + 4, data.find(b"moov") - 4
    for place in range((begin + end) // 2, end, 97):
        data[place] ^= 0xFF
    video.write_bytes(data)
    predict(video, "--save", "none")
    said = capfd.readouterr()
    assert " @ 0x" not in said.err
    assert re.search(r"^the decoder complained \d+ times? \(first: .+\): some frames may be damaged$", said.out, re.M)
    video.write_bytes(b"no video")
    with pytest.raises(ValueError, match=r"sea\.mp4: not a video that OpenCV can read"):
        predict(video)
    assert capfd.readouterr().err == ""


def test_files_are_looked_at_before_the_network(predict, folder):
    with pytest.raises(FileNotFoundError, match="no file matches"):
        predict(folder / "none.png", "--checkpoint", "no.ckpt")


def test_a_glob_takes_the_pictures_among_other_files(predict, folder):
    (folder / "notes.md").write_text("# no picture")
    (folder / "3.png").rename(folder / "3.photo")  # known by its first bytes
    assert [frame["image"] for frame in results(predict(folder / "*", "--save", "none"))[1]] == [
        *("0.png", "1.png", "2.png", "3.photo")
    ]


def test_what_an_earlier_run_left_in_the_folder_is_told(predict, video, folder, capsys):
    out = predict(video, "--max-frames", "1")
    predict(folder / "0.png")
    assert f"note: still there from an earlier run: {out / 'video.mp4'}\n" in capsys.readouterr().out
    predict(folder / "1.png")
    assert f"from an earlier run: {out / 'video.mp4'}, {out / 'pictures'}\n" in capsys.readouterr().out


def test_every_second_frame_as_pictures_without_the_chart(predict, video):
    out = predict(video, "--every", "2", "--max-frames", "2", "--save", "pictures", "--show-topdown", "false")
    assert [frame["frame"] for frame in results(out)[1]] == [0, 2]
    assert names(out / "pictures") == ["frame 000000.jpg", "frame 000002.jpg"]


def test_a_camera_of_another_size_is_scaled_and_says_so(predict, folder, capsys):
    for number in range(4):
        cv2.imwrite(str(folder / f"{number}.png"), picture(number, (144, 96)))
    predict(folder, "--save", "none")
    assert "camera.yaml: scaled from 96 x 64 to pictures of 144 x 96" in capsys.readouterr().out


def test_an_imu_turns_the_camera_of_every_frame_at_its_time(predict, video, folder, tmp_path, capsys):
    log = tmp_path / "imu.csv"
    log.write_text("time_s,pitch_deg,roll_deg\n10.0,10,1\n10.2,12,3\n")
    settings = ["--imu", str(log), "--imu-offset-s", "10", "--save", "none"]
    frames = results(predict(video, *settings))[1]
    mount = pytest.approx((np.degrees(0.3), 0.0), rel=1e-5)
    angles = [(frame["pitch_deg"], frame["roll_deg"]) for frame in frames]
    assert angles[:3] == [pytest.approx(pair, rel=1e-5) for pair in ((10, 1), (11, 2), (12, 3))]
    assert angles[3:] == [mount] * 3
    assert "imu read 3, imu silent 3" in capsys.readouterr().out
    with pytest.raises(ValueError, match=r"imu: rtsp://camera: what is taken now is in no log yet"):
        predict("rtsp://camera", *settings)
    with pytest.raises(ValueError, match=r"imu: .*: pictures have no time"):
        predict(folder, *settings)


def test_the_horizon_turns_the_camera_where_it_is_seen(predict, folder, tmp_path, camera, capsys):
    K = [[400.0, 0, 319.5], [0, 400.0, 239.5], [0, 0, 1]]
    std = np.radians(1.0)
    mount = {"height_m": 1.5, "pitch_rad": 0.1, "pitch_std_rad": std, "roll_std_rad": std}
    save_camera(make_camera(K, (640, 480), **mount), camera)
    sea = np.full((480, 640, 3), (200, 180, 160), np.uint8)
    sea[210:] = (90, 70, 60)
    noise = np.random.default_rng(0).normal(0, 2, sea.shape)
    for number in range(4):
        cv2.imwrite(str(folder / f"{number}.png"), np.clip(sea + noise, 0, 255).astype(np.uint8))
    (frame, *_) = results(predict(folder, "--attitude", "horizon", "--save", "none"))[1]
    seen_deg = np.degrees(np.arctan((239.5 - 209.5) / 400)) + 0.037  # and the dip of the horizon, from 1.5 m
    assert frame["pitch_deg"] == pytest.approx(seen_deg, abs=0.02)
    assert "horizon seen 4" in capsys.readouterr().out


def test_a_video_is_followed_and_pictures_are_not(predict, video, folder, capsys):
    out = predict(video, "--track", "--tracking.lost-s", "1.5", "--batch-size", "4")
    meta, frames = results(out)
    assert names(out) == ["predictions.csv", "predictions.jsonl", "tracks.csv", "tracks.txt", "video.mp4"]
    assert meta["tracking"]["lost_s"] == 1.5
    assert all("track" in boat for frame in frames for boat in frame["boats"])
    assert "boats followed" in capsys.readouterr().out
    assert "track_id" not in (predict(video, "--save", "none") / "predictions.csv").read_text()
    with pytest.raises(ValueError, match=r"track: .*: pictures have no time, expected their fps"):
        predict(folder, "--track")


def test_pictures_of_a_known_pace_are_followed(predict, folder, video):
    frames = results(predict(folder, "--track", "--fps", "4", "--every", "2", "--save", "video"))[1]
    assert [frame["time_s"] for frame in frames] == [0, 0.5]
    assert all("track" in boat for frame in frames for boat in frame["boats"])
    assert cv2.VideoCapture(str(folder.parent / "out" / "video.mp4")).get(cv2.CAP_PROP_FPS) == 2
    with pytest.raises(ValueError, match=r"fps: .*sea\.mp4 is a video and has its own pace, expected pictures"):
        predict(video, "--fps", "4")


def test_pictures_too_far_apart_to_be_followed_are_refused(predict, folder, video, tmp_path):
    with pytest.raises(ValueError, match=r"frames are 4 s apart, expected at most the 2 s of --tracking\.lost-s"):
        predict(folder, "--track", "--fps", "0.5", "--every", "2")
    with pytest.raises(ValueError, match=r"frames are 0\.3 s apart, expected at most the 0\.2 s"):
        predict(video, "--track", "--every", "3", "--tracking.lost-s", "0.2")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("number", "end"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)])
def test_a_signal_leaves_whole_files(predict, video, tmp_path, monkeypatch, number, end):
    count = command.Tally.count

    def interrupted(tally, *arguments):
        count(tally, *arguments)
        if tally.frames == 3:
            os.kill(os.getpid(), number)

    monkeypatch.setattr(command.Tally, "count", interrupted)
    with pytest.raises(KeyboardInterrupt) as ended:
        predict(video)
    assert ended.type is end
    out = tmp_path / "out"
    assert names(out) == ["predictions.csv", "predictions.jsonl", "video.mp4"]
    assert len(results(out)[1]) == 3
    assert length(out / "video.mp4") == 3


class Line:
    """A camera whose line breaks after each of its pictures and in the end stays dead."""

    left = 3

    def __init__(self):
        self.fresh = True

    def isOpened(self):
        return True

    def get(self, key):
        return 0.0

    def grab(self):
        alive, self.fresh = self.fresh and Line.left > 0, False
        Line.left -= alive
        return alive

    def retrieve(self):
        return True, picture(Line.left)

    def release(self):
        pass


def test_a_stream_that_does_not_come_back_leaves_whole_files(predict, tmp_path, monkeypatch, capsys):
    def open_line(source, tell, every, fps):
        return LiveStream(source, Line, tell, every, waits_s=(0.0, 0.0))

    monkeypatch.setattr(command, "open_source", open_line)
    monkeypatch.setattr(Line, "left", 3)
    with pytest.raises(ConnectionError, match="did not come back"):
        predict("rtsp://camera")
    out = tmp_path / "out"
    assert names(out) == ["predictions.csv", "predictions.jsonl", "video.mp4"]
    said = capsys.readouterr()
    lost = sum(int(line.split()[0]) for line in said.out.splitlines() if "overtaken" in line)
    assert len(results(out)[1]) + lost == 3
    assert "3 times the stream broke off" in said.out
    assert said.err.count("is back") == 2
    assert "is given up after 2 attempts" in said.err


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--estimator", "sonar"], "estimator: got 'sonar'"),
        (["--batch-size", "0"], "batch_size: got 0"),
        (["--max-frames", "0"], "max_frames: got 0"),
        (["--every", "0"], "every: got 0"),
        (["--fps", "0"], "fps: got 0"),
        (["--save", "film"], "save"),
        (["--track", "--tracking.lost-s", "0"], "tracking.lost_s: got 0"),
        (["--checkpoint", "no.ckpt"], "no.ckpt: no such checkpoint file"),
        (["--model", "no.onnx"], "checkpoint and model: got both"),
        (["--camera", "no.yaml"], "no.yaml"),
    ],
)
def test_a_wrong_option_leaves_nothing(predict, folder, tmp_path, options, sentence):
    with pytest.raises((ValueError, FileNotFoundError), match=sentence):
        predict(folder, *options)
    assert not (tmp_path / "out").exists()


def test_a_source_that_does_not_fit_leaves_nothing(predict, folder, tmp_path):
    for number in range(4):
        cv2.imwrite(str(folder / f"{number}.png"), picture(number, (64, 64)))
    with pytest.raises(ValueError, match=r"camera\.yaml was calibrated for pictures of 96 x 64, but these are 64 x 64"):
        predict(folder)
    for number in range(4):
        (folder / f"{number}.png").write_bytes(b"damaged")
    with pytest.raises(ValueError, match="none of its pictures can be read"):
        predict(folder)
    with pytest.raises(FileNotFoundError, match="no file matches"):
        predict(folder / "*.gif")
    (folder / "notes.md").write_text("# no picture")
    for source in ("notes.md", "*.md"):
        with pytest.raises(ValueError, match=r"notes\.md: neither a picture \(.*\.jpg.* nor a video \(.*\.mp4"):
            predict(folder / source)
    assert not (tmp_path / "out").exists()


def test_results_do_not_replace_their_own_source(predict, folder, tmp_path):
    pictures = predict(folder) / "pictures"
    before = (pictures / "0.png").read_bytes()
    with pytest.raises(ValueError, match="would replace its original"):
        predict(pictures)
    assert (pictures / "0.png").read_bytes() == before
