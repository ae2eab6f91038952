"""The accuracy benchmark ranges the peer's boats by the paper's formula and compares what it should."""

import importlib.util
import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from usvnet.geometry.camera import make_camera, project
from usvnet.types import WATERLINE_KEYPOINTS


@pytest.fixture(scope="module")
def accuracy(root):
    spec = importlib.util.spec_from_file_location("accuracy", root / "benchmarks" / "accuracy.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def level_to_camera(pitch_rad: float, roll_rad: float) -> torch.Tensor:
    """The inverse of Rx(pitch) Rz(roll), see usvnet/types.py."""
    (cp, sp), (cr, sr) = ((math.cos(angle), math.sin(angle)) for angle in (pitch_rad, roll_rad))
    Rx = torch.tensor([[1, 0, 0], [0, cp, sp], [0, -sp, cp]], dtype=torch.float64)
    Rz = torch.tensor([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]], dtype=torch.float64)
    return (Rx @ Rz).T


def test_true_keypoints_on_the_water_give_the_true_ranges(accuracy):
    K = [[500, 0, 319.5], [0, 510, 239.5], [0, 0, 1]]
    camera = make_camera(K, (640, 480), height_m=1.5, pitch_rad=0.1, roll_rad=0.02)
    on_water_m = torch.tensor([[1.0, 1.5, 9.0], [0.5, 1.5, 7.0], [0.75, 1.5, 8.0]], dtype=torch.float64)
    in_camera_m = on_water_m @ level_to_camera(0.1, 0.02).T
    bow_px, stern_px, box_px = project(in_camera_m[None], camera)[0].double().numpy()
    keypoints = np.full((7, 2), 100.0)
    keypoints[list(WATERLINE_KEYPOINTS)] = bow_px, stern_px
    box = [box_px[0] - 20, box_px[1] - 10, box_px[0] + 20, box_px[1]]
    boat = {"box_px": box, "score": 0.9, "keypoints_px": keypoints.tolist(), "visibility": [1.0] * 7}
    record = accuracy.ranged(boat, SimpleNamespace(camera=camera))
    assert record.ranges["waterline"].slant_m == pytest.approx(np.hypot(np.hypot(0.5, 1.5), 7.0), rel=1e-5)
    assert record.ranges["box_bottom"].slant_m == pytest.approx(np.hypot(np.hypot(0.75, 1.5), 8.0), rel=1e-5)
    assert record.ranges["waterline"].usable
    above = boat | {"keypoints_px": [[100.0, 10.0]] * 7}
    assert not accuracy.ranged(above, SimpleNamespace(camera=camera)).ranges["waterline"].usable


def scores(strict, rmse_m):
    pose = SimpleNamespace(map50=0.8, map50_95=0.5)
    waterline = SimpleNamespace(rmse_m=rmse_m, mae_m=rmse_m / 2, missed=1)
    return SimpleNamespace(
        pose=pose,
        pose_strict=SimpleNamespace(map50_95=strict),
        keypoints=SimpleNamespace(overall=SimpleNamespace(median_px=2.0)),
        ranges=SimpleNamespace(overall={"waterline": waterline}),
    )


def test_scores_are_subtracted_and_errors_divided(accuracy):
    table = accuracy.comparison([scores(0.3, 0.2), scores(0.5, 0.4)], [scores(0.3, 0.6)])
    between = dict(zip((column.title for column in table.columns), table.rows[-1], strict=True))
    assert between["strict mAP50-95"] == pytest.approx(0.1)
    assert between["waterline RMSE m"] == pytest.approx(0.5)
    assert len(table.rows) == 4
