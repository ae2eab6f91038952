import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from usvnet.data import read_dataset
from usvnet.data.pictures import read_picture

COUNTS = {"train": 12, "val": 6, "test": 6}


def shrink(root: Path, target: Path, monkeypatch: pytest.MonkeyPatch, *options: str) -> None:
    counts = [word for split, number in COUNTS.items() for word in (f"--{split}", str(number))]
    arguments = ["shrink", str(root / "data" / "sample"), str(target), "--size", "160", *counts, *options]
    monkeypatch.setattr(sys, "argv", arguments)
    runpy.run_path(str(root / "scripts" / "shrink_dataset.py"), run_name="__main__")


def test_a_shrunk_dataset_is_the_same_at_half_the_size(root: Path, tmp_path: Path, monkeypatch):
    shrink(root, tmp_path / "a", monkeypatch)
    for split, number in COUNTS.items():
        large = {frame.name: frame for frame in read_dataset(root / "data" / "sample", split)}
        small = read_dataset(tmp_path / "a", split)
        scenes = [frame.scene for frame in small]
        assert {scenes.count(scene) for scene in set(scenes)} == {number // 6}
        for frame in small:
            before = large[frame.name]
            assert read_picture(frame.image_path).shape == (160, 160, 3)
            np.testing.assert_allclose(frame.keypoints_px, (before.keypoints_px + 0.5) / 2 - 0.5, atol=1e-6)
            np.testing.assert_array_equal(frame.range_m, before.range_m)
            half = torch.tensor([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
            torch.testing.assert_close(frame.camera.K[0], half @ before.camera.K[0])
            assert frame.camera.pitch_rad == before.camera.pitch_rad


def test_the_seed_chooses(root: Path, tmp_path: Path, monkeypatch):
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        shrink(root, tmp_path / name, monkeypatch, "--seed", seed)
    tables = {name: (tmp_path / name / "frames.csv").read_text() for name in "abc"}
    assert tables["a"] == tables["b"] != tables["c"]


def test_too_many_pictures_are_an_error(root: Path, tmp_path: Path, monkeypatch, capsys):
    with pytest.raises(SystemExit) as exit_code:
        shrink(root, tmp_path / "a", monkeypatch, "--val", "31")
    assert exit_code.value.code == 2
    assert "30 pictures in a split, expected at least the 31" in capsys.readouterr().err
