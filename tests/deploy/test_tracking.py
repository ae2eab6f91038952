"""What a frame tells the tracker, and what the files say of the tracks."""

import csv
import dataclasses
import json
import math

import numpy as np
import pytest
import torch
from evaluation.boats import boat, truth

from usvnet.deploy.outputs import FrameBoats, Outputs, boat_table, json_lines
from usvnet.deploy.sources import Frame
from usvnet.deploy.track_fields import FIELDS
from usvnet.deploy.track_files import mot_text, track_table
from usvnet.deploy.tracking import BoatFollower, sight
from usvnet.evaluation.predictions import read_predictions
from usvnet.evaluation.records import ESTIMATORS, RangeRecord
from usvnet.geometry.camera import make_camera
from usvnet.geometry.ranging import RangingLayer
from usvnet.tracking.tracker import TrackingConfig

SIZE_PX = (640, 480)
PINHOLE = [[600.0, 0, 310.0], [0, 590.0, 230.0], [0, 0, 1]]
CAMERA_STDS = {"focal_std_px": 4.0, "height_std_m": 0.03, "pitch_std_rad": 0.004, "roll_std_rad": 0.006}
MOUNT = {"height_m": 1.6, "pitch_rad": 0.12, "roll_rad": 0.05, "distortion": (-0.1, 0.02, 0.001, -0.001, 0.0)}
CAMERA = make_camera(PINHOLE, SIZE_PX, **MOUNT, **CAMERA_STDS, wave_std_m=0.04)
RULES = TrackingConfig(confirm_hits=2, confirm_frames=3)


def ranged(of, camera=CAMERA, covariance_px2=None):
    """A boat whose range is what the geometry says of its nearer waterline keypoint."""
    points = torch.tensor(of.keypoints_px[[3, 6]])[None]
    covariance = torch.tensor(of.keypoint_covariance_px2[[3, 6]] if covariance_px2 is None else covariance_px2)[None]
    estimate = RangingLayer().double().range_points(points, covariance, camera)
    nearer = int(estimate.slant_m[0].argmin())
    values = [value[0, nearer].item() for value in estimate[:4]]
    record = RangeRecord(*values, estimate.position_m[0, nearer].numpy(), bool(estimate.valid[0, nearer]))
    return dataclasses.replace(of, ranges=dict.fromkeys(ESTIMATORS, record))


BOAT = boat(truth(shift_px=250.0))


def test_the_variance_is_split_into_what_is_new_and_what_is_shared():
    whole = ranged(BOAT)
    (sighting,) = sight([whole], "waterline", CAMERA)
    estimate = whole.ranges["waterline"]
    assert sighting.inverse_per_m == pytest.approx(1 / estimate.horizontal_m)
    to_inverse = estimate.slant_m / estimate.horizontal_m**3
    still = CAMERA._replace(wave_std_m=torch.zeros(1))
    shared = ranged(BOAT, still, np.zeros((2, 2, 2))).ranges["waterline"].slant_std_m
    sure = make_camera(PINHOLE, SIZE_PX, **MOUNT, wave_std_m=0.04)
    new = ranged(BOAT, sure).ranges["waterline"].slant_std_m
    # not exact: a boat on a wave is nearer by another fraction of the slant range than of the horizontal one
    assert sighting.common_std_per_m == pytest.approx(shared * to_inverse, rel=0.01)
    assert sighting.inverse_std_per_m == pytest.approx(new * to_inverse, rel=0.01)
    assert math.hypot(*sighting[3:]) == pytest.approx(estimate.slant_std_m * to_inverse)


def test_the_bearing_is_the_middles_and_does_not_jump_between_the_ends():
    camera = make_camera(PINHOLE, SIZE_PX, height_m=1.6, pitch_rad=0.12, **CAMERA_STDS)
    level = BOAT.keypoints_px.copy()
    bearings, ranges = [], []
    for lower in (3, 6):
        level[[3, 6], 1] = 300.0
        level[lower, 1] += 2.0
        turned = ranged(dataclasses.replace(BOAT, keypoints_px=level.copy()), camera)
        ranges.append(turned.ranges["waterline"])
        bearings.append(sight([turned], "waterline", camera)[0])
    assert abs(ranges[0].bearing_rad - ranges[1].bearing_rad) > 0.05
    assert bearings[0].bearing_rad == pytest.approx(bearings[1].bearing_rad, abs=1e-3)
    ends = sorted(estimate.bearing_rad for estimate in ranges)
    assert ends[0] < bearings[0].bearing_rad < ends[1]
    std_px = math.sqrt(2.0 / 2)  # the mean of two points of variance 2
    assert bearings[0].bearing_std_rad == pytest.approx(std_px / 600, rel=0.25)


def test_a_boat_without_a_range_has_a_bearing():
    lost = dataclasses.replace(ranged(BOAT).ranges["waterline"], valid=False, slant_m=math.inf, horizontal_m=math.inf)
    (sighting,) = sight([dataclasses.replace(BOAT, ranges=dict.fromkeys(ESTIMATORS, lost))], "hull", CAMERA)
    assert not sighting.ranged
    assert math.isfinite(sighting.bearing_rad)
    assert sight([], "hull", CAMERA) == []


def test_a_frame_without_a_time_cannot_be_followed():
    picture = np.zeros((480, 640, 3), np.uint8)
    with pytest.raises(ValueError, match=r"1\.jpg: has no time"):
        BoatFollower("waterline").follow(FrameBoats(Frame("1.jpg", 0, None, picture), [], CAMERA))


@pytest.fixture
def written(tmp_path):
    """Four frames of one boat, in the last of which it is not seen, with a new one in the third."""
    lines, table, tracks, mot = (tmp_path / name for name in ("a.jsonl", "a.csv", "tracks.csv", "tracks.txt"))
    writers = {
        lines: lambda: json_lines(lines, {}, "waterline"),
        table: lambda: boat_table(table, "waterline", tracked=True),
        tracks: lambda: track_table(tracks),
        mot: lambda: mot_text(mot),
    }
    first, new = ranged(BOAT), ranged(boat(truth(shift_px=0.0), score=0.5))
    follower = BoatFollower("waterline", RULES)
    with Outputs(writers) as outputs:
        for number, boats in enumerate([[first], [first], [new, first], []]):
            frame = Frame(f"frame {number:06d}", number, 0.1 * number, np.zeros((480, 640, 3), np.uint8))
            outputs.write(follower.follow(FrameBoats(frame, boats, CAMERA)))
    return tmp_path


def test_lines_and_table_carry_the_track_of_each_boat(written):
    frames = [json.loads(line) for line in (written / "a.jsonl").read_text().splitlines()][1:]
    tracks = [[said["track"] for said in frame["boats"]] for frame in frames]
    assert tracks[0] == [None]
    assert [list(track) for track in tracks[1]] == [list(FIELDS)]
    assert tracks[2][0] is None
    assert tracks[2][1]["id"] == 1
    assert tracks[2][1]["age_s"] == pytest.approx(0.2)
    estimate = frames[2]["boats"][1]["waterline"]
    assert tracks[2][1]["slant_m"] == pytest.approx(estimate["slant_m"], rel=1e-6)
    assert tracks[2][1]["slant_std_m"] < estimate["slant_std_m"]
    assert tracks[2][1]["cpa_m"] is None  # at rest
    rows = list(csv.DictReader((written / "a.csv").open(newline="")))
    assert [row["track_id"] for row in rows] == ["", "1", "", "1"]
    assert float(rows[3]["track_z_m"]) == tracks[2][1]["z_m"]
    assert None not in rows[0]
    assert len(read_predictions(written / "a.jsonl", {})) == 4


def test_the_table_of_tracks_also_has_boats_that_are_not_seen(written):
    rows = list(csv.DictReader((written / "tracks.csv").open(newline="")))
    assert [(row["frame"], row["id"], row["boat"]) for row in rows] == [
        ("1", "1", "0"),
        ("2", "1", "1"),
        ("3", "1", ""),
    ]
    assert float(rows[2]["unseen_s"]) == pytest.approx(0.1)
    assert float(rows[2]["slant_std_m"]) > float(rows[1]["slant_std_m"])


def test_mot_text_counts_from_one(written):
    lines = [line.split(",") for line in (written / "tracks.txt").read_text().splitlines()]
    assert [line[:2] for line in lines] == [["2", "1"], ["3", "1"]]
    assert [float(value) for value in lines[0][2:6]] == [351.5, 201.5, 80.0, 50.0]  # from x1, y1 = 350, 200
    x, y, z = (float(value) for value in lines[0][7:])
    assert (float(lines[0][6]), y) == (0.9, 1.6)
    assert math.hypot(x, y, z) == pytest.approx(ranged(BOAT).ranges["waterline"].slant_m, abs=0.01)


def beyond_the_fold(shift_px: float, ends: list[int]):
    """A boat and a camera whose lens has no ray for those waterline keypoints."""
    camera = make_camera(PINHOLE, SIZE_PX, height_m=1.6, pitch_rad=0.12, distortion=(-0.3, 0, 0, 0, 0), **CAMERA_STDS)
    whole = boat(truth(shift_px=shift_px, range_m=8.0))
    keypoints_px = whole.keypoints_px.copy()
    keypoints_px[ends] = [9000.0, 300.0]
    return whole, dataclasses.replace(whole, keypoints_px=keypoints_px), camera


@pytest.mark.parametrize(("lost", "left"), [(3, 6), (6, 3)])
def test_a_waterline_end_without_a_ray_says_nothing(lost, left):
    whole, half, camera = beyond_the_fold(350.0, [lost])
    both_there = dataclasses.replace(whole, keypoints_px=whole.keypoints_px.copy())
    both_there.keypoints_px[lost] = both_there.keypoints_px[left]
    (expected,), (sighting,) = sight([both_there], "fused", camera), sight([half], "fused", camera)
    assert sighting.bearing_rad == pytest.approx(expected.bearing_rad)
    assert sighting.common_std_per_m == pytest.approx(expected.common_std_per_m)
    assert sighting.bearing_std_rad == pytest.approx(40 / 600, rel=0.01)  # half of the box's 80 px


def test_without_a_ray_of_either_end_the_bearing_is_that_of_the_range():
    _, lost, camera = beyond_the_fold(0.0, [3, 6])
    (sighting,) = sight([lost], "fused", camera)
    assert (sighting.bearing_rad, sighting.inverse_per_m) == (0.1, 1 / 8)
    assert sighting.bearing_std_rad == pytest.approx(40 / 600, rel=0.01)
    none = dataclasses.replace(lost.ranges["fused"], valid=False, slant_m=math.inf)
    (sighting,) = sight([dataclasses.replace(lost, ranges={"fused": none})], "fused", camera)
    assert math.isnan(sighting.bearing_rad)
    assert not sighting.ranged
