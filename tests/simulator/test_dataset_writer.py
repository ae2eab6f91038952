"""One frame: whole or not at all, exact when it is read again, refused when picture and labels do not fit."""

import dataclasses
import json
import math

import numpy as np
import pytest
from fake_renderer import render_frame
from small_dataset import write_settings

from usvnet.commands.simulated_dataset import boat_labels
from usvnet.data.formats.yolo import format_line, parse_line
from usvnet.simulator.dataset_writer import read_truths, remove_leftovers, truth_path, whole_pictures, write_frame
from usvnet.simulator.scenario import Scenario
from usvnet.simulator.settings import load_settings
from usvnet.simulator.tables import boat_rows, frame_row, range_rows, write_table
from usvnet.simulator.truth import frame_truth, laser_readings, plain


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    scenario = Scenario(load_settings(write_settings(tmp_path_factory.mktemp("settings"))))
    return [render_frame(scenario.frame(number), "preview") for number in range(scenario.total)]


@pytest.fixture
def lone(frames):
    """A frame with the laser and one boat that is wholly in the picture."""
    return next(f for f in frames if len(f.boats) == 1 and f.spec.has_laser and (f.boats[0].visibility == 2).all())


def with_boat(frame, **changes):
    return dataclasses.replace(frame, boats=(dataclasses.replace(frame.boats[0], **changes),))


def test_the_truth_reads_back_bit_for_bit(frames, tmp_path):
    for frame in frames:
        write_frame(tmp_path, frame)
    truths = {truth["image"]: truth for truth in read_truths(tmp_path)}
    assert sorted(truths) == sorted(frame.spec.name for frame in frames) == whole_pictures(tmp_path)
    for frame in frames:
        truth = truths[frame.spec.name]
        assert truth["size_px"] == frame.spec.camera.size_px[0].tolist()
        assert truth["spec"]["camera"]["pitch_rad"] == frame.spec.camera.pitch_rad.item()
        assert truth["spec"]["sea"]["slope_std"] == frame.spec.sea.slope_std
        for written, boat in zip(truth["boats"], frame.boats, strict=True):
            np.testing.assert_array_equal(np.array(written["keypoints_px"]), boat.keypoints_px)
            np.testing.assert_array_equal(np.array(written["laser_hit_m"], float), boat.laser_hit_m)
            assert written["spec"]["hull"]["name"] == boat.spec.hull.name


def test_label_files_follow_the_half_pixel_rule(frames):
    """Pixel i covers [i, i + 1) in a label file and has its centre at i here."""
    for frame in frames:
        size_px = tuple(frame.spec.camera.size_px[0].int().tolist())
        for boat in frame_truth(frame)["boats"]:
            labels = boat_labels(boat)
            read = parse_line(format_line(labels, size_px), size_px)
            seen = labels.visibility[0] > 0
            np.testing.assert_allclose(read.keypoints_px[0, seen], np.array(boat["keypoints_px"])[seen], atol=1e-6)
            np.testing.assert_allclose(read.boxes_px[0], boat["box_px"], atol=1e-6)
            np.testing.assert_array_equal(read.visibility[0], boat["visibility"])
            assert (read.keypoints_px[0, ~seen] == -0.5).all()


def test_a_keypoint_behind_the_camera_can_be_written(lone, tmp_path):
    keypoints = lone.boats[0].keypoints_px.copy()
    keypoints[0] = np.nan
    write_frame(tmp_path, with_boat(lone, keypoints_px=keypoints, visibility=np.array([0, 2, 2, 2, 2, 2, 2])))
    (truth,) = read_truths(tmp_path)
    assert truth["boats"][0]["keypoints_px"][0] == [None, None]
    assert format_line(boat_labels(truth["boats"][0]), tuple(truth["size_px"])).split()[5:8] == ["0", "0", "0"]


def test_the_laser_reads_the_nearer_waterline_point_with_its_noise(frames):
    errors = []
    for frame in frames:
        for boat, reading_m in zip(frame.boats, laser_readings(frame), strict=True):
            in_view = (boat.visibility[[3, 6]] > 0).all()
            assert math.isfinite(reading_m) == (frame.spec.has_laser and in_view)
            errors.append(reading_m - boat.slant_m.min())
        np.testing.assert_equal(laser_readings(frame), laser_readings(frame))
    errors = np.array(errors)[np.isfinite(errors)]
    assert len(set(errors)) == len(errors) > 5
    assert 0.005 < np.sqrt((errors**2).mean()) < 0.05  # 2 cm


def test_rows_say_what_is_true_of_the_boat(lone):
    truth = frame_truth(lone)
    row, (boat_row,), (range_row,), boat = frame_row(truth), boat_rows(truth), range_rows(truth), lone.boats[0]
    assert {key: row[key] for key in boat_row if key not in ("image", "instance")} == {
        key: value for key, value in boat_row.items() if key not in ("image", "instance")
    }
    nearest = int(np.argmin(boat.slant_m))
    assert row["nearest_waterline"] == ("bow_bottom", "stern_bottom")[nearest]
    assert (row["true_slant_m"], row["true_horizontal_m"]) == (boat.slant_m[nearest], boat.horizontal_m[nearest])
    assert (row["water_height_bow_m"], row["water_height_stern_m"]) == (0.03, -0.01)
    height_m = lone.spec.camera.height_m.item()
    aimed_m = math.hypot(row["laser_x_m"], row["laser_y_m"], row["laser_z_m"] - height_m)
    assert row["mid_hull_laser_slant_m"] == pytest.approx(aimed_m)
    assert row["sun_elevation_deg"] == pytest.approx(math.degrees(lone.spec.sky.sun_elevation_rad))
    assert row["visibility_m"] == lone.spec.air.visibility_m
    assert row["shutter_yaw_rate_deg_s"] == pytest.approx(math.degrees(lone.spec.shutter.yaw_rate_rad_s))
    assert row["pitch_deg"] == range_row["pitch_deg"] == lone.spec.measured_pitch_deg
    assert range_row["range_std_m"] == 0.02


def test_cells_hold_no_nan_and_no_minus_zero(tmp_path):
    rows = [{"a": math.nan, "b": -1e-9, "c": True}, {"a": None, "b": 0.1234567, "d": "x,y"}]
    write_table(tmp_path / "t.csv", rows, columns=("b",))
    assert (tmp_path / "t.csv").read_text() == 'b,a,c,d\n0,,1,\n0.123457,,,"x,y"\n'


def test_a_frame_is_not_whole_without_its_truth_or_its_picture(lone, frames, tmp_path):
    other = next(frame for frame in frames if frame.spec.number != lone.spec.number)
    for frame in (lone, other):
        write_frame(tmp_path, frame)
    truth_path(tmp_path, lone.spec.name).unlink()
    assert whole_pictures(tmp_path) == [other.spec.name]
    (tmp_path / "images" / other.spec.name).write_bytes(b"")
    assert whole_pictures(tmp_path) == []


def test_no_old_truth_stays_beside_a_picture_that_could_not_be_replaced(lone, tmp_path, monkeypatch):
    write_frame(tmp_path, lone)
    monkeypatch.setattr("pathlib.Path.replace", lambda *_: (_ for _ in ()).throw(OSError("no space left")))
    with pytest.raises(OSError, match="no space"):
        write_frame(tmp_path, lone)
    assert whole_pictures(tmp_path) == []


def test_leftovers_of_a_killed_run_are_removed_and_nothing_else(lone, tmp_path):
    write_frame(tmp_path, lone)
    for name in (".000003.a1b2c3_d.jpg", "frames/train/.000003.abcdefgh.json", ".gitignore", ".notes.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    orphan = tmp_path / "images" / "train" / "000007.jpg"  # the run was killed before its truth was written
    orphan.parent.mkdir(parents=True, exist_ok=True)
    orphan.write_bytes(b"x")
    assert remove_leftovers(tmp_path) == 3
    assert not orphan.exists()
    assert sorted(path.name for path in tmp_path.rglob(".*")) == [".gitignore", ".notes.txt"]
    assert whole_pictures(tmp_path) == [lone.spec.name]


def test_what_does_not_fit_together_is_refused_and_nothing_is_written(lone, tmp_path):
    outside = lone.boats[0].keypoints_px + 1000
    for broken, words in (
        (dataclasses.replace(lone, picture=lone.picture[:, :-1]), r"picture is uint8 .*expected uint8"),
        (dataclasses.replace(lone, picture=lone.picture.astype(float)), r"picture is float64"),
        (with_boat(lone, box_px=np.array([3.0, 3, 3, 9])), r"boat 0 \(\S+\): its box is \[3.0, 3.0, 3.0, 9.0\]"),
        (with_boat(lone, box_px=np.array([3.0, 3, np.nan, 9])), r"its box is"),
        (with_boat(lone, keypoints_px=outside), r"bow is at .* px with visibility 2, outside"),
        (with_boat(lone, visibility=np.full(7, 3)), r"visibility \[3"),
    ):
        with pytest.raises(ValueError, match=words):
            write_frame(tmp_path, broken)
    assert list(tmp_path.rglob("*")) == []


def test_a_damaged_truth_is_named(lone, tmp_path):
    write_frame(tmp_path, lone)
    for text in ('{"image": "tr', json.dumps({"image": "x"})):
        truth_path(tmp_path, lone.spec.name).write_text(text)
        with pytest.raises(ValueError, match=rf"{lone.spec.number:06d}\.json: damaged .*render its frame again"):
            list(read_truths(tmp_path))


def test_only_what_json_has_is_written():
    with pytest.raises(TypeError, match="set"):
        plain({1, 2})
