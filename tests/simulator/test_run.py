"""A whole dataset with a renderer of milliseconds: stopped, resumed, refused, failing."""

import fcntl
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from fake_renderer import render_frame
from small_dataset import SETTINGS, TOTAL, files_of, simulate_small, write_settings

from usvnet.data.check import check_dataset
from usvnet.data.reader import read_dataset
from usvnet.geometry.camera_files import load_camera
from usvnet.geometry.hull_files import load_hull
from usvnet.simulator import workers
from usvnet.simulator.dataset_writer import read_truths, whole_frames
from usvnet.simulator.scenario import Scenario
from usvnet.simulator.selection import parse_numbers, spread_sample
from usvnet.simulator.settings import load_settings

SPLITS = {"train": 14, "val": 6, "test": 4}
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    return write_settings(tmp_path_factory.mktemp("settings"))


@pytest.fixture(scope="module")
def complete(config, tmp_path_factory):
    """A dataset that was rendered by one worker without an interruption."""
    root = tmp_path_factory.mktemp("simulated") / "complete"
    summary = simulate_small(config, root)
    assert (summary.asked, summary.whole, summary.rendered, summary.failed) == (TOTAL, 0, TOTAL, [])
    assert summary.seconds == pytest.approx({"drawing": 0.001 * TOTAL})
    return root


@pytest.fixture
def copied(complete, tmp_path):
    return Path(shutil.copytree(complete, tmp_path / "copied"))


def start(config, root, workers, **environment):
    """A run in a process group of its own; it hears Ctrl-C also where the tests run in the background of a shell."""
    code = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from pathlib import Path; from usvnet.files import run_program; from small_dataset import simulate_small\n"
        f"if __name__ == '__main__': run_program(\n"
        f"    lambda: simulate_small(Path({str(config)!r}), Path({str(root)!r}), workers={workers}))"
    )
    paths = os.pathsep.join([str(HERE.parents[1]), str(HERE)])
    return subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": paths, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_for_frames(root, number):
    deadline = time.monotonic() + 60
    while len(whole_frames(root)) < number:
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_the_dataset_reads_back_exactly(config, complete):
    scenario = Scenario(load_settings(config))
    frames, faults = check_dataset(complete)
    assert faults == []
    assert {split: len(members) for split, members in frames.items()} == SPLITS
    number, boats, ranges = 0, 0, 0
    for split in SPLITS:
        for frame in read_dataset(complete, split):
            spec = scenario.frame(number)
            assert (frame.name, frame.scene) == (spec.name, spec.scene)
            assert np.degrees(frame.camera.pitch_rad.item()) == pytest.approx(spec.measured_pitch_deg, abs=1e-5)
            mount_std_deg = np.degrees(scenario.cameras()[spec.camera_name].roll_std_rad.item())
            std_deg = mount_std_deg if spec.attitude_std_deg is None else spec.attitude_std_deg
            assert np.degrees(frame.camera.roll_std_rad.item()) == pytest.approx(std_deg, abs=1e-5)
            truths = render_frame(spec, "standard").boats
            for i, truth in enumerate(truths):
                np.testing.assert_allclose(frame.boxes_px[i], truth.box_px, atol=1e-3)
                seen = truth.visibility > 0
                np.testing.assert_allclose(frame.keypoints_px[i, seen], truth.keypoints_px[seen], atol=1e-3)
                np.testing.assert_array_equal(frame.visibility[i], truth.visibility)
                assert (frame.range_m[i] > 0) == (spec.has_laser and seen[[3, 6]].all())
                if frame.range_m[i] > 0:
                    assert frame.range_m[i] == pytest.approx(truth.slant_m.min(), abs=0.1)
                    assert frame.range_std_m[i] == 0.02
            assert len(frame.boxes_px) == len(truths)
            number, boats, ranges = number + 1, boats + len(truths), ranges + int((frame.range_m > 0).sum())
    assert number == TOTAL
    assert boats > ranges > 0


def test_every_kind_of_frame_is_in_it(complete):
    truths = list(read_truths(complete))
    assert {len(truth["boats"]) for truth in truths} == {0, 1, 2}
    assert any(boat["truncated"] for truth in truths for boat in truth["boats"])
    empty = next(truth["image"] for truth in truths if not truth["boats"])
    assert (complete / "labels" / empty).with_suffix(".txt").read_bytes() == b""
    rows = (complete / "frames.csv").read_text().splitlines()
    assert len(rows) == TOTAL + 1
    assert len({row.count(",") for row in rows}) == 1


def test_cameras_and_hulls_are_those_of_the_scenario(config, complete):
    for name, camera in Scenario(load_settings(config)).cameras().items():
        read = load_camera(complete / "cameras" / f"{name}.yaml")
        assert all(bool((a == b).all()) for a, b in zip(read, camera, strict=True))
    boat = next(boat for truth in read_truths(complete) for boat in truth["boats"])
    hull = load_hull(complete / "hulls" / f"{boat['spec']['hull']['name']}.yaml").points_m[0].numpy()
    np.testing.assert_array_equal(hull, np.array(boat["hull_keypoints_m"], np.float32))


def test_coco_and_yolo_say_the_same(complete, copied):
    expected = read_dataset(complete, "train")
    text = (copied / "data.yaml").read_text()
    (copied / "data.yaml").write_text(text.replace("train: images/train", "train: annotations/train.json"))
    for ours, theirs in zip(expected, read_dataset(copied, "train"), strict=True):
        np.testing.assert_allclose(ours.boxes_px, theirs.boxes_px, atol=1e-6)
        np.testing.assert_allclose(ours.keypoints_px, theirs.keypoints_px, atol=1e-6)


def test_killed_ten_times_it_ends_with_the_same_bytes(config, complete, tmp_path):
    root = tmp_path / "killed"
    command = [sys.executable, str(HERE / "killed_runs.py"), str(config), str(root), "10"]
    paths = os.pathsep.join([str(HERE.parents[1]), str(HERE)])
    killed = subprocess.run(command, env={**os.environ, "PYTHONPATH": paths}, capture_output=True, text=True)
    assert killed.returncode == 0, killed.stderr
    whole = [int(line) for line in killed.stdout.splitlines() if line.isdigit()]
    assert len(whole) == 10
    assert len({number for number in whole if 0 < number < TOTAL}) >= 2, "no kill fell between two frames"
    simulate_small(config, root, workers=2)
    assert files_of(root) == files_of(complete)


def test_ctrl_c_stops_at_once_and_the_next_run_goes_on(config, complete, tmp_path):
    root = tmp_path / "interrupted"
    run = start(config, root, 2, FAKE_SECONDS="0.3")
    wait_for_frames(root, 2)
    os.killpg(run.pid, signal.SIGINT)
    out, err = run.communicate(timeout=20)  # returns when no process holds the pipes any more, workers neither
    assert (run.returncode, err) == (130, "interrupted\n")
    there = len(whole_frames(root))
    assert f"{there} of {TOTAL} frames are there, the same command goes on" in out
    assert there < TOTAL
    assert not (root / "data.yaml").exists()
    summary = simulate_small(config, root)
    assert (summary.whole, summary.rendered) == (there, TOTAL - there)
    assert files_of(root) == files_of(complete)


def test_workers_end_when_their_parent_is_killed(config, tmp_path):
    run = start(config, tmp_path / "orphans", 1, FAKE_SECONDS="0.3")
    wait_for_frames(tmp_path / "orphans", 1)
    os.kill(run.pid, signal.SIGKILL)
    run.communicate(timeout=20)


def test_frames_that_fail_or_kill_their_worker_are_named_and_the_others_are_rendered(
    config, complete, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("FAKE_FAILS", "3 9")
    monkeypatch.setenv("FAKE_DIES", "16")
    monkeypatch.setenv("FAKE_LEAVES", str(tmp_path / "set/images/train/.000016.half_way.jpg"))
    summary = simulate_small(config, tmp_path / "set", workers=2)
    assert sorted(summary.failed) == [3, 9, 16]
    assert summary.rendered == TOTAL - 3
    said = capsys.readouterr().out
    assert "frame 3 (seed 7) failed: RuntimeError: the paint is not dry\n" in said
    assert "frame 16 (seed 7) failed: its process was killed twice" in said
    frames, faults = check_dataset(tmp_path / "set")
    assert (faults, sum(map(len, frames.values()))) == ([], TOTAL - 3)
    assert not list((tmp_path / "set").rglob(".*"))

    monkeypatch.setenv("FAKE_FAILS", "")
    monkeypatch.setenv("FAKE_DIES", "")
    summary = simulate_small(config, tmp_path / "set")
    assert (summary.whole, summary.rendered) == (TOTAL - 3, 3)
    assert files_of(tmp_path / "set") == files_of(complete)


def test_it_does_not_wait_for_workers_that_always_die(config, tmp_path, monkeypatch):
    monkeypatch.setenv("FAKE_DIES", " ".join(map(str, range(TOTAL))))
    monkeypatch.setattr(workers, "MAX_BARREN", 2)
    with pytest.raises(ValueError, match="rendering processes were killed 2 times without one frame"):
        simulate_small(config, tmp_path / "set")


def test_when_every_frame_fails_there_is_no_dataset(config, tmp_path, monkeypatch):
    monkeypatch.setenv("FAKE_FAILS", "3")
    with pytest.raises(ValueError, match="not one frame has been rendered"):
        simulate_small(config, tmp_path / "set", only="3")


def test_single_frames_are_rendered_again_to_the_same_bytes(config, complete, copied):
    for place in ("images/val/000017.jpg", "frames/val/000017.json", "labels/val/000017.txt"):
        (copied / place).write_bytes(b"spoilt")
    summary = simulate_small(config, copied, only="17")
    assert (summary.asked, summary.whole, summary.rendered) == (1, 0, 1)
    assert files_of(copied) == files_of(complete)


def test_a_sample_is_a_dataset_and_grows_to_the_whole(config, complete, tmp_path):
    summary = simulate_small(config, tmp_path / "set", frames=6)
    assert summary.asked == 6
    frames, faults = check_dataset(tmp_path / "set")
    assert faults == []
    assert {split: len(members) for split, members in frames.items()} == {"train": 2, "val": 2, "test": 2}
    assert all({frame.scene for frame in members} == {"I", "V"} for members in frames.values())
    assert simulate_small(config, tmp_path / "set").whole == 6
    assert files_of(tmp_path / "set") == files_of(complete)


def test_a_scaled_dataset_has_smaller_pictures_and_cameras(config, complete, tmp_path):
    simulate_small(config, tmp_path / "half", scale=0.5, only="0-5")
    half = {frame.name: frame for frame in read_dataset(tmp_path / "half", "train")}
    compared = 0
    for frame in read_dataset(complete, "train"):
        if frame.name in half:
            small = half[frame.name]
            assert cv2.imread(str(small.image_path)).shape[1::-1] == tuple(size // 2 for size in frame.size_px)
            seen = frame.visibility > 0
            np.testing.assert_allclose(small.keypoints_px[seen], frame.keypoints_px[seen] / 2 - 0.25, atol=1e-3)
            np.testing.assert_array_equal(small.range_m, frame.range_m)
            compared += int(seen.sum())
    assert compared > 7


def test_a_folder_of_another_dataset_is_refused(config, copied, tmp_path):
    again = "delete it or choose another folder"
    with pytest.raises(ValueError, match=f"was rendered with quality standard: {again}"):
        simulate_small(config, copied, quality="high")
    with pytest.raises(ValueError, match=f"was rendered with scale 1.0: {again}"):
        simulate_small(config, copied, scale=0.5)
    with pytest.raises(ValueError, match=f"was rendered with another configuration: {again}"):
        simulate_small(write_settings(tmp_path / "other", SETTINGS.replace("seed: 7", "seed: 8")), copied)
    (copied / "manifest.json").write_text("{")
    with pytest.raises(ValueError, match=r"manifest.json: damaged"):
        simulate_small(config, copied)
    (copied / "manifest.json").unlink()
    with pytest.raises(ValueError, match=r"copied holds other files and no manifest.json: choose another folder"):
        simulate_small(config, copied)


def test_the_manifest_says_what_it_was_made_with_and_no_place(config, complete):
    text = (complete / "manifest.json").read_text()
    manifest = json.loads(text)
    assert manifest["config"] == SETTINGS
    assert manifest["frames"] == SPLITS
    assert manifest["seed"] == 7
    assert manifest["engine"] == "fake"
    assert manifest["command"] == "usvnet simulate --config small.yaml --quality standard --scale 1"
    assert str(config.parent) not in text


def test_other_versions_are_told(config, copied, capsys):
    manifest = (copied / "manifest.json").read_text()
    (copied / "manifest.json").write_text(re.sub(r'"numpy": "[^"]*"', '"numpy": "1.0"', manifest))
    simulate_small(config, copied)
    assert "was begun with numpy 1.0, now it is" in capsys.readouterr().out


def test_two_runs_do_not_share_a_folder(config, copied):
    handle = os.open(copied, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        with pytest.raises(ValueError, match="another run is writing into this folder"):
            simulate_small(config, copied)
    finally:
        os.close(handle)


def test_samples_and_numbers(config):
    scenario = Scenario(load_settings(config))
    assert spread_sample(scenario, TOTAL + 5) == list(range(TOTAL))
    assert len(spread_sample(scenario, 7)) == 7
    assert parse_numbers("3, 17,20-22,21", TOTAL) == [3, 17, 20, 21, 22]
    for text, words in (("24", "0 to 23"), ("5-3", "0 to 23"), ("x", "such as 17"), ("", "such as"), ("-3", "such as")):
        with pytest.raises(ValueError, match=words):
            parse_numbers(text, TOTAL)
    with pytest.raises(ValueError, match="--frames is 0"):
        spread_sample(scenario, 0)
