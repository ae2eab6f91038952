"""How much larger or smaller boats are drawn comes back from boats made so, whatever the attitude."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from usvnet.evaluation.conformal import MIN_BOATS
from usvnet.evaluation.range_metrics import RangedBoat
from usvnet.evaluation.size_calibration import fit_size_std
from usvnet.geometry.camera import make_camera, project
from usvnet.geometry.hull_model import generic_hull
from usvnet.geometry.rays import level_rotation

from .boats import boat, truth

NOISE_PX = 0.5
BOATS = 150


def drawn(
    size_std: float, scale_std: float = 0.0, gross: float = 0.0
) -> tuple[list[RangedBoat], list[SimpleNamespace]]:
    """Boats 5 to 12 m ahead that look larger or smaller than their hull, and some turned about."""
    torch.manual_seed(0)
    K = [[800.0, 0, 319.5], [0, 800.0, 319.5], [0, 0, 1]]
    camera = make_camera(K, (640, 640), height_m=1.5, pitch_rad=0.12, roll_rad=0.02, dtype=torch.float64)
    hull = generic_hull()._replace(scale_std=torch.tensor([scale_std]), point_std_m=torch.tensor([0.0]))
    larger = torch.exp(size_std * torch.randn(BOATS, 1).double())
    x, y, z = (larger * axis for axis in hull.points_m.double().unbind(-1))
    heading = 2 * math.pi * torch.rand(BOATS, 1).double()
    ahead = 5 + 7 * torch.rand(BOATS, 1).double()
    right, forward = x * heading.sin() - y * heading.cos(), x * heading.cos() + y * heading.sin()
    level_m = torch.stack([right, 1.5 - z, ahead + forward], -1)
    seen_px = project(level_m @ level_rotation(camera.pitch_rad, camera.roll_rad), camera)
    seen_px += NOISE_PX * torch.randn_like(seen_px)
    turned = torch.rand(BOATS) < gross
    seen_px[turned] = (2 * seen_px.mean(1, keepdim=True) - seen_px)[turned]
    ranged = []
    for n, keypoints_px in enumerate(seen_px.numpy()):
        known = truth(range_m=float(level_m[n, [3, 6]].norm(dim=-1).min()))
        covariance_px2 = NOISE_PX**2 * np.tile(np.eye(2), (7, 1, 1))
        found = dataclasses.replace(boat(known), keypoints_px=keypoints_px, keypoint_covariance_px2=covariance_px2)
        ranged.append(RangedBoat(n, known, found))
    return ranged, [SimpleNamespace(camera=camera, hull=hull)] * BOATS


@pytest.mark.parametrize("size_std", [0.03, 0.06])
def test_it_comes_back(size_std):
    assert fit_size_std(*drawn(size_std), share=0.0) == pytest.approx(size_std, rel=0.35)


def test_boats_drawn_as_they_are_need_none():
    assert fit_size_std(*drawn(0.0), share=0.0) <= 0.01


def test_boats_turned_about_do_not_rule_it():
    assert fit_size_std(*drawn(0.03, gross=0.05), share=0.0) == pytest.approx(0.03, rel=0.5)


def test_few_boats_and_unknown_hulls_say_nothing():
    ranged, frames = drawn(0.06)
    assert fit_size_std(ranged[: MIN_BOATS - 1], frames, share=0.0) == 0.0
    assert fit_size_std(*drawn(0.06, scale_std=1.0), share=0.0) == 0.0
