"""The sample set that comes with the repository."""

from pathlib import Path

import pytest
import torch

from usvnet.data import BoatDataset, collate, read_dataset
from usvnet.data.check import check_dataset
from usvnet.geometry.hull_files import load_hull
from usvnet.geometry.ranging import RangingLayer

SPLITS = {"train": 120, "val": 30, "test": 24}


@pytest.fixture(scope="session")
def sample(root: Path) -> Path:
    return root / "data" / "sample"


def test_it_has_no_faults_and_every_scene(sample: Path):
    frames, faults = check_dataset(sample)
    assert faults == []
    for split, number in SPLITS.items():
        scenes = [frame.scene for frame in frames[split]]
        assert len(scenes) == number
        assert {scenes.count(scene) for scene in ("I", "II", "III", "IV", "V", "VI")} == {number // 6}
        assert all((frame.range_m > 0).all() for frame in frames[split])


def test_it_is_small(sample: Path):
    assert sum(path.stat().st_size for path in sample.rglob("*") if path.is_file()) <= 4e6


@pytest.mark.parametrize("split", SPLITS)
def test_labels_camera_and_laser_agree(sample: Path, split: str):
    """Perfect keypoints on flat water give the laser's range, but for waves and the noise of pitch and roll."""
    frames = read_dataset(sample, split)
    batch = collate([BoatDataset(frames, 320)[i] for i in range(len(frames))])
    keypoints = batch.boats.keypoints_px
    covariance = torch.eye(2).expand(*keypoints.shape, 2)
    waterline = RangingLayer()(keypoints, covariance, batch.boats.boxes_px, batch.camera).waterline
    error = (waterline.slant_m / batch.boats.range_m - 1).abs()
    assert error.max() < 0.05
    assert error.median() < 0.01


def test_its_tables_hold_nothing_but_what_a_user_could_measure(sample: Path):
    assert (sample / "frames.csv").read_text().splitlines()[0] == "image,scene,camera,pitch_deg,roll_deg"


def test_its_hulls_are_read(sample: Path):
    hulls = [load_hull(path) for path in sorted((sample / "hulls").glob("*.yaml"))]
    assert len(hulls) == 8
    assert all(0.9 <= float(hull.points_m[0, 0, 0] - hull.points_m[0, 4, 0]) <= 1.8 for hull in hulls)
