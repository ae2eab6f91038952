"""The rendered dataset's own labels, through the geometry, against its own ranges."""

import csv
import math
from pathlib import Path

import pytest
import torch

from usvnet.geometry.camera import camera_to, stack_cameras, with_attitude
from usvnet.geometry.camera_files import load_camera
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import KEYPOINT_NAMES, Camera

ROOT = Path(__file__).resolve().parents[3] / "shared" / "data" / "sixscenes-v0"
pytestmark = pytest.mark.skipif(not ROOT.is_dir(), reason="the dataset sixscenes-v0 is not beside the checkout")


def labels(image: str) -> Path:
    return (ROOT / "labels" / image).with_suffix(".txt")


@pytest.fixture(scope="module")
def truth() -> tuple[torch.Tensor, Camera, torch.Tensor, torch.Tensor]:
    """Nearest waterline pixels (F, 1, 2), true cameras, true slant ranges (F, 1) and water heights (F,) of F frames."""
    mounted = {path.stem: camera_to(load_camera(path), dtype=torch.float64) for path in ROOT.glob("cameras/*.yaml")}
    pixels, cameras, slants, waters = [], [], [], []
    with (ROOT / "frames.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            label = [float(text) for text in labels(row["image"]).read_text().split()]
            x, y, visibility = label[5 + 3 * KEYPOINT_NAMES.index(row["nearest_waterline"]) :][:3]
            if visibility == 0:
                continue
            pixels.append([640 * x - 0.5, 640 * y - 0.5])
            attitude = (math.radians(float(row[f"true_{name}_deg"])) for name in ("pitch", "roll"))
            cameras.append(with_attitude(mounted[row["camera"]], *attitude))
            slants.append(float(row["true_slant_m"]))
            waters.append(float(row[f"water_height_{row['nearest_waterline'].split('_')[0]}_m"]))
    points, slant = torch.tensor(pixels, dtype=torch.float64), torch.tensor(slants, dtype=torch.float64)
    return points[:, None], stack_cameras(cameras), slant[:, None], torch.tensor(waters, dtype=torch.float64)


def relative_error(points: torch.Tensor, camera: Camera, slant_m: torch.Tensor) -> torch.Tensor:
    covariance = torch.eye(2, dtype=points.dtype).expand(*points.shape, 2)
    return (RangingLayer().range_points(points, covariance, camera).slant_m / slant_m - 1).squeeze(1)


def test_flat_water_is_wrong_by_the_wave_and_nothing_else(truth):
    points, camera, slant, water = truth
    assert len(points) > 900
    error = relative_error(points, camera, slant)
    torch.testing.assert_close(error, water / (camera.height_m - water), rtol=0, atol=1e-4)


def test_with_the_water_at_its_true_height_ranges_are_exact(truth):
    points, camera, slant, water = truth
    corrected = camera._replace(height_m=camera.height_m - water)
    assert relative_error(points, corrected, slant).abs().max() < 1e-4
