"""``usvnet calibrate-mount`` from predictions of a boat that was driven about, and from nothing else."""

import dataclasses
import json
import math

import numpy as np
import pytest
import torch

from tests.evaluation.boats import boat, truth
from tests.geometry.boats import draw_poses, known_hull, put, repeat_camera, see
from usvnet import cli
from usvnet.evaluation.predictions import PicturePrediction, write_predictions
from usvnet.geometry.camera import camera_to, make_camera
from usvnet.geometry.camera_files import load_camera, save_camera
from usvnet.geometry.hull_files import save_hull
from usvnet.geometry.hull_model import hull_to

TRUE = make_camera([[700.0, 0, 319.5], [0, 700, 239.5], [0, 0, 1]], (640, 480), height_m=1.5, pitch_rad=0.1)


@pytest.fixture
def folder(tmp_path):
    """A camera file half a degree off, a hull, and pictures of 120 boats seen by the true camera."""
    std_rad = math.radians(0.5)
    guess = TRUE._replace(pitch_rad=TRUE.pitch_rad + std_rad, pitch_std_rad=TRUE.pitch_std_rad + std_rad)
    save_camera(guess._replace(roll_std_rad=guess.pitch_std_rad), tmp_path / "front.yaml", name="front")
    save_hull(hull_to(known_hull(1), dtype=torch.float32), tmp_path / "boat.yaml")
    torch.manual_seed(0)
    camera, hull = repeat_camera(camera_to(TRUE, dtype=torch.float64), 120), known_hull(120)
    pixels = see(put(hull.points_m, draw_poses(120, 4.0, 15.0), camera.height_m), camera)
    write(tmp_path, (pixels + torch.randn_like(pixels)).numpy())
    return tmp_path


def write(folder, pixels):
    pattern = boat(truth())
    boats = [dataclasses.replace(pattern, keypoints_px=seven, keypoint_covariance_px2=EYE) for seven in pixels]
    pictures = [PicturePrediction(f"{n}.jpg", [one]) for n, one in enumerate(boats)]
    write_predictions(folder / "predictions.jsonl", {}, pictures)


EYE = np.tile(np.eye(2), (7, 1, 1))


def run(folder, *options, source="predictions.jsonl"):
    files = [str(folder / source), "--camera", str(folder / "front.yaml"), "--output", str(folder / "found.yaml")]
    cli.run(["calibrate-mount", *files, *options])


def test_a_boat_driven_about_tells_pitch_and_roll(folder, capsys):
    run(folder, "--hull", str(folder / "boat.yaml"))
    found, guess = load_camera(folder / "found.yaml"), load_camera(folder / "front.yaml")
    assert found.pitch_rad.item() == pytest.approx(0.1, abs=math.radians(0.15))
    assert found.pitch_std_rad.item() < math.radians(0.2)
    assert torch.equal(found.K, guess.K)
    assert torch.equal(found.height_m, guess.height_m)
    said = capsys.readouterr().out
    assert "of 120 boats fit the hull" in said
    assert "boats' size" in said
    assert "caution" not in said


def test_boats_of_another_hull_are_told(folder, capsys):
    pixels = np.stack([np.arange(14.0).reshape(7, 2) * 9 % 70 + 200 for _ in range(90)])
    lines = (folder / "predictions.jsonl").read_text()
    write(folder, pixels)
    (folder / "predictions.jsonl").write_text(
        lines + "\n".join((folder / "predictions.jsonl").read_text().splitlines()[1:])
    )
    run(folder, "--hull", str(folder / "boat.yaml"))
    assert "of the boats do not fit the hull" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ((), "need --hull"),
        (("--hull", "boat.yaml", "--hold", "roll"), "neither --hold"),
        (("--hull", "none.yaml"), "none.yaml"),
    ],
)
def test_what_does_not_go_together_is_refused(folder, options, message):
    at = [str(folder / option) if option.endswith(".yaml") else option for option in options]
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        run(folder, *at)
    assert not (folder / "found.yaml").exists()


def test_bad_predictions_are_refused_by_file_and_line(folder):
    hull = ("--hull", str(folder / "boat.yaml"))
    with pytest.raises(FileNotFoundError, match=r"none\.jsonl: no such file"):
        run(folder, *hull, source="none.jsonl")
    lines = (folder / "predictions.jsonl").read_text().splitlines()
    (folder / "predictions.jsonl").write_text("\n".join(lines[:4]))
    with pytest.raises(ValueError, match=r"predictions\.jsonl: 3 of 3 boats fit the hull, expected at least 5"):
        run(folder, *hull)
    lines[2] = json.dumps(json.loads(lines[2]) | {"size_px": [1280, 960]})
    (folder / "predictions.jsonl").write_text("\n".join(lines))
    with pytest.raises(ValueError, match=r"predictions\.jsonl:3: picture of 1280 x 960, expected 640 x 480"):
        run(folder, *hull)
    (folder / "readings.csv").write_text("u_px,v_px,range_m\n10,400,5\n")
    with pytest.raises(ValueError, match="goes with predictions"):
        run(folder, *hull, source="readings.csv")
