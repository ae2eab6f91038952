"""Cameras, hulls, checkpoints, pictures and predictions: read, or refused in one sentence, whatever is in them."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given

from usvnet.checkpoints import load_model, read_checkpoint
from usvnet.data.pictures import read_picture
from usvnet.evaluation.predictions import PicturePrediction, read_meta, read_predictions, write_predictions
from usvnet.evaluation.records import ESTIMATORS, BoatRecord, RangeRecord
from usvnet.geometry.camera import make_camera
from usvnet.geometry.camera_files import load_camera, save_camera
from usvnet.geometry.hull_files import load_hull, save_hull
from usvnet.geometry.hull_model import generic_hull

from .mutations import EXAMPLES, quick, read_or_refused, spoilt_bytes, spoilt_text, spoilt_values

BOMB = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n" for before, name in zip("abcdefgh", "bcdefghi")
)
"""A few lines of YAML that are a list of 9**9 numbers, for whoever writes it out."""


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("style", ["ros", "opencv"])
def test_cameras(tmp_path: Path, style: str, examples: int):
    path = tmp_path / "camera.yaml"
    K = [[170, 0, 80], [0, 170, 60], [0, 0, 1]]
    save_camera(make_camera(K, (160, 120), [0.01] * 5, height_m=1.5, pitch_rad=0.1), path, style)

    @quick(examples)
    @given(spoilt_text(path.read_text()))
    def read(data: bytes) -> None:
        path.write_bytes(data)
        camera = read_or_refused(lambda: load_camera(path), path)
        assert camera is None or all(torch.isfinite(numbers).all() for numbers in camera)
        assert camera is None or camera.K[0, 0, 0] > 0

    read()


@pytest.mark.parametrize("examples", EXAMPLES)
def test_hulls(tmp_path: Path, examples: int):
    path = tmp_path / "hull.yaml"
    save_hull(generic_hull(), path)

    @quick(examples)
    @given(spoilt_text(path.read_text()))
    def read(data: bytes) -> None:
        path.write_bytes(data)
        hull = read_or_refused(lambda: load_hull(path), path)
        assert hull is None or all(torch.isfinite(numbers).all() for numbers in hull)

    read()


@pytest.mark.parametrize(
    "key", ["image_width", "camera_matrix", "distortion_coefficients", "mount", "distortion_model"]
)
def test_a_bomb_of_aliases_is_refused_without_being_written_out(tmp_path: Path, key: str):
    path = tmp_path / "camera.yaml"
    sound = {
        "image_width": "160",
        "image_height": "120",
        "camera_matrix": "{data: [170, 0, 80, 0, 170, 60, 0, 0, 1]}",
        "distortion_coefficients": "{data: [0, 0, 0, 0, 0]}",
        "mount": "{height_m: 1.5, pitch_deg: 6, roll_deg: 0}",
    }
    path.write_text(BOMB + "".join(f"{name}: {value}\n" for name, value in (sound | {key: "*i"}).items()))
    with pytest.raises(ValueError, match=rf"camera\.yaml: {key}: expected"):
        load_camera(path)


@pytest.mark.parametrize("examples", EXAMPLES)
def test_damaged_checkpoints(tmp_path: Path, examples: int):
    path = tmp_path / "best.ckpt"
    weights = {"model.layer.weight": torch.arange(6.0)}
    torch.save({"usvnet": {"variant": "n", "curved_water": False}, "state_dict": weights}, path)

    @quick(examples)
    @given(spoilt_bytes(path.read_bytes()))
    def read(data: bytes) -> None:
        path.write_bytes(data)
        checkpoint = read_or_refused(lambda: read_checkpoint(path), path)
        assert checkpoint is None or isinstance(checkpoint["usvnet"]["variant"], str)

    read()


@pytest.mark.parametrize("examples", [pytest.param(6, id="few"), pytest.param(300, id="many", marks=pytest.mark.slow)])
def test_checkpoints_that_say_something_else(untrained: Path, tmp_path: Path, examples: int):
    path = tmp_path / "best.ckpt"
    sound = torch.load(untrained, weights_only=True)
    sound["usvnet"]["intervals"] = {"waterline": [1.0, 1.2, 40]}
    sound["state_dict"] = {"model.network.stem": None} | dict(list(sound["state_dict"].items())[:1])

    @quick(examples)
    @given(spoilt_values(sound))
    def read(content: object) -> None:
        torch.save(content, path)
        assert read_or_refused(lambda: load_model(path), path) is None  # its weights are not all there

    read()


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".webp", ".tif"])
def test_pictures(tmp_path: Path, suffix: str, examples: int):
    path = tmp_path / f"a{suffix}"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 256, (12, 16, 3), np.uint8))

    @quick(examples)
    @given(spoilt_bytes(path.read_bytes()))
    def read(data: bytes) -> None:
        path.write_bytes(data)
        picture = read_or_refused(lambda: read_picture(path), path)
        assert picture is None or (picture.dtype == np.uint8 and picture.ndim == 3 and picture.shape[2] == 3)

    read()


def predicted() -> PicturePrediction:
    ranges = {name: RangeRecord(9.0, 0.4, 8.9, 0.1, np.array([0.9, 1.5, 8.8]), True) for name in ESTIMATORS}
    boat = BoatRecord(
        np.array([4.0, 5, 60, 40]), 0.9, np.full((7, 2), 20.0), np.tile(np.eye(2), (7, 1, 1)), np.full(7, 0.8), ranges
    )
    return PicturePrediction("a.png", [boat])


@pytest.mark.parametrize("examples", EXAMPLES)
def test_predictions(tmp_path: Path, examples: int):
    path = tmp_path / "predictions.jsonl"
    meta = {"checkpoint": "abc", "intervals": {"waterline": [1.1, 1.2, 40]}}
    write_predictions(path, meta, [predicted(), predicted()])
    sound = path.read_text()
    lines = [json.loads(line) for line in sound.splitlines()]

    @quick(examples)
    @given(spoilt_text(sound) | spoilt_values(lines).map(lambda tree: "\n".join(map(json.dumps, tree)).encode()))
    def read(data: bytes) -> None:
        path.write_bytes(data)
        read_or_refused(lambda: read_meta(path), path)
        for _, boats in read_or_refused(lambda: read_predictions(path), path) or []:
            for boat in boats:
                assert boat.box_px.shape == (4,)
                assert boat.keypoint_covariance_px2.shape == (7, 2, 2)
                assert isinstance(boat.score, float)
                assert all(math.isfinite(estimate.bearing_rad) for estimate in boat.ranges.values())

    read()
