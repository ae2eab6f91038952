"""What is written says the same in every form, is whole, and replaces nothing of the source's."""

import csv
import dataclasses
import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from evaluation.boats import boat, truth

from usvnet.deploy.annotated import annotated_pictures, annotated_video
from usvnet.deploy.outputs import FrameBoats, Outputs, boat_table, json_lines, table_header
from usvnet.deploy.sources import Frame, Source
from usvnet.evaluation.predictions import read_predictions
from usvnet.evaluation.records import ESTIMATORS
from usvnet.geometry.camera import make_camera
from usvnet.types import KEYPOINT_NAMES
from usvnet.visualize.scene import SceneDrawer

META = {"camera": "front.yaml"}
SIZE_PX = (320, 256)
CAMERA = make_camera([[300.0, 0, 159.5], [0, 300.0, 127.5], [0, 0, 1]], SIZE_PX, height_m=1.5, pitch_rad=0.1)


class FakeSource(Source):
    """Knows its pace and its files, and has no frames."""

    def __init__(self, frames_per_s=None, is_live=False, files=()):
        super().__init__("fake", print, frames_per_s=frames_per_s)
        self.is_live = is_live
        self.files = files

    def holds(self, path):
        return path in self.files

    def __iter__(self):
        return iter(())


def found(number=0, boats=(), name=None, time_s=None, size_px=SIZE_PX):
    picture = np.full((size_px[1], size_px[0], 3), 20 * number, np.uint8)
    return FrameBoats(Frame(name or f"frame {number:06d}", number, time_s, picture), list(boats), CAMERA)


def lost(of):
    estimate = dataclasses.replace(
        of.ranges["waterline"], slant_m=math.inf, slant_std_m=math.inf, horizontal_m=math.inf, valid=False
    )
    return dataclasses.replace(of, ranges=dict.fromkeys(ESTIMATORS, estimate))


BOATS = [boat(truth(range_m=12.3456789), std_m=0.5), lost(boat(truth(shift_px=20, range_m=9.0), score=0.4))]


def written(tmp_path, frames, estimator="waterline"):
    with Outputs(
        {
            tmp_path / "a.jsonl": lambda: json_lines(tmp_path / "a.jsonl", META, estimator),
            tmp_path / "a.csv": lambda: boat_table(tmp_path / "a.csv", estimator),
        }
    ) as outputs:
        for frame in frames:
            outputs.write(frame)
    lines = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    return lines, list(csv.DictReader((tmp_path / "a.csv").open(newline="")))


def test_table_and_lines_agree(tmp_path):
    (meta, first, second, third), rows = written(
        tmp_path, [found(0, BOATS, time_s=0.0), found(1, [], time_s=0.04), found(2, BOATS[:1], time_s=0.08)]
    )
    assert meta == {"meta": META}
    assert [(row["image"], row["frame"], row["boat"]) for row in rows] == [
        ("frame 000000", "0", "0"),
        ("frame 000000", "0", "1"),
        ("frame 000002", "2", "0"),
    ]
    assert (second["boats"], second["size_px"], second["time_s"]) == ([], list(SIZE_PX), 0.04)
    for row, (frame, said) in zip(rows, [(first, said) for said in first["boats"]] + [(third, third["boats"][0])]):
        assert float(row["time_s"]) == frame["time_s"]
        assert float(row["score"]) == said["score"]
        assert [float(row[f"{side}_px"]) for side in ("x1", "y1", "x2", "y2")] == said["box_px"]
        estimate = said[said["estimator"]]
        assert row["estimator"] == said["estimator"] == "waterline"
        assert row["valid"] == str(int(estimate["valid"]))
        for column, value in (
            *((name, estimate[name]) for name in ("slant_m", "slant_std_m", "horizontal_m", "bearing_deg")),
            *zip(("low_90_m", "high_90_m"), estimate["interval_90_m"]),
            *((f"{name}_slant_m", said[name]["slant_m"]) for name in ESTIMATORS),
            *((f"{name}_slant_std_m", said[name]["slant_std_m"]) for name in ESTIMATORS),
        ):
            assert row[column] == ("" if value is None else str(value))
        for k, name in enumerate(KEYPOINT_NAMES):
            assert [float(row[f"{name}_{axis}_px"]) for axis in "uv"] == said["keypoints_px"][k]
            assert float(row[f"{name}_visibility"]) == said["visibility"][k]
            covariance = [float(row[f"{name}_{part}_px2"]) for part in ("uu", "uv", "vv")]
            assert covariance == said["keypoint_covariance_px2"][k]


def test_an_interval_is_90_percent_and_what_is_not_known_is_empty(tmp_path):
    (_, first), rows = written(tmp_path, [found(0, BOATS)])
    assert float(rows[0]["low_90_m"]) == pytest.approx(12.3456789 - 1.644854 * 0.5, rel=1e-6)
    assert rows[0]["time_s"] == ""
    assert (rows[1]["slant_m"], rows[1]["low_90_m"], rows[1]["valid"]) == ("", "", "0")
    assert first["boats"][1]["waterline"]["slant_m"] is None
    assert list(rows[0]) == table_header()


def test_lines_are_read_by_the_evaluation(tmp_path):
    written(tmp_path, [found(0, BOATS, name="a/1.jpg"), found(1)])
    first, second = read_predictions(tmp_path / "a.jsonl", META)
    assert (first.image, len(first.boats), second.boats) == ("a/1.jpg", 2, [])
    assert first.boats[0].ranges["waterline"].slant_m == pytest.approx(12.3456789, rel=1e-6)


def test_time_of_a_stream_keeps_its_microseconds(tmp_path):
    (_, line), _ = written(tmp_path, [found(time_s=1795512558.953968)])
    assert line["time_s"] == 1795512558.953968


def test_nothing_is_left_where_nothing_was_found(tmp_path):
    with Outputs({tmp_path / "a.csv": lambda: boat_table(tmp_path / "a.csv", "waterline")}) as outputs:
        pass
    assert outputs.written == []
    assert list(tmp_path.iterdir()) == []


def test_what_was_written_before_an_error_is_kept(tmp_path):
    outputs = Outputs({tmp_path / "a.csv": lambda: boat_table(tmp_path / "a.csv", "waterline")})

    def interrupted():
        with outputs:
            outputs.write(found(0, BOATS))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert len((tmp_path / "a.csv").read_text().splitlines()) == 3
    assert list(tmp_path.iterdir()) == outputs.written


def drawn(writer, frames):
    with writer as write:
        for frame in frames:
            write(frame)


def test_pictures_keep_their_names(tmp_path):
    frames = [found(1, BOATS, name="a/1.png"), found(2, name="2.jpg"), found(3), found(4, name="4.tif")]
    drawn(annotated_pictures(tmp_path, SceneDrawer("waterline"), FakeSource()), frames)
    names = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*")}
    assert names == {"a/1.png", "2.jpg", "frame 000003.jpg", "4.tif.jpg"}
    picture = cv2.imread(str(tmp_path / "a" / "1.png"))
    assert picture.shape == (512, 640, 3)
    assert (np.abs(picture.astype(int) - (71, 82, 255)).max(axis=-1) < 30).any()  # port is red, stored BGR


def frames_of(path: Path):
    video = cv2.VideoCapture(str(path))
    count = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
    return video.get(cv2.CAP_PROP_FPS), [video.read()[1][5, 5].mean() for _ in range(count)]


def test_a_video_has_a_frame_for_a_frame(tmp_path):
    path = tmp_path / "video.mp4"
    drawn(
        annotated_video(path, SceneDrawer("waterline"), FakeSource(12.5)), [found(n, time_s=n / 12.5) for n in range(9)]
    )
    rate, greys = frames_of(path)
    assert rate == pytest.approx(12.5)
    assert greys == pytest.approx([20 * n for n in range(9)], abs=6)
    assert list(tmp_path.iterdir()) == [path]


def test_a_video_of_a_stream_lasts_as_long_as_the_stream(tmp_path):
    path = tmp_path / "video.mp4"
    frames = [found(n, time_s=1000 + n / 5) for n in range(8)]
    drawn(annotated_video(path, SceneDrawer("waterline"), FakeSource(25.0, is_live=True)), frames)
    rate, greys = frames_of(path)
    assert (rate, len(greys)) == (10, 15)
    assert greys == pytest.approx([20 * (n // 2) for n in range(15)], abs=6)


def test_pictures_of_another_size_fit_into_the_video(tmp_path):
    path = tmp_path / "video.mp4"
    frames = [found(0), found(5, size_px=(640, 512)), found(9)]
    drawn(annotated_video(path, SceneDrawer("waterline"), FakeSource()), frames)
    assert frames_of(path)[1] == pytest.approx([0, 100, 180], abs=6)


def test_the_source_is_never_replaced(tmp_path):
    video, picture = tmp_path / "video.mp4", tmp_path / "1.jpg"
    source = FakeSource(files={video, picture})
    for file in (video, picture):
        file.write_bytes(b"original")
    with pytest.raises(ValueError, match=r"video\.mp4: .* would replace its original"):
        drawn(annotated_video(video, SceneDrawer("waterline"), source), [])
    with pytest.raises(ValueError, match=r"1\.jpg: .* would replace its original"):
        drawn(annotated_pictures(tmp_path, SceneDrawer("waterline"), source), [found(name="1.jpg")])
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == {video: b"original", picture: b"original"}


def test_a_refusal_leaves_an_earlier_run_s_results_alone(tmp_path):
    table, video = tmp_path / "a.csv", tmp_path / "video.mp4"
    table.write_text("of an earlier run")
    drawer, source = SceneDrawer("waterline"), FakeSource(files={video})
    writers = {table: lambda: boat_table(table, "waterline"), video: lambda: annotated_video(video, drawer, source)}
    with pytest.raises(ValueError, match="would replace its original"), Outputs(writers) as outputs:
        outputs.write(found(0, BOATS))
    assert table.read_text() == "of an earlier run"
    assert list(tmp_path.iterdir()) == [table]


def test_a_name_that_is_no_utf_8_stands_as_its_bytes(tmp_path):
    _, rows = written(tmp_path, [found(0, BOATS[:1], name="K\udcfcste.jpg")])
    assert rows[0]["image"] == r"K\udcfcste.jpg"
