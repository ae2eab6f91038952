"""Boats made wrong are wrong as they should be, and near ones are refused."""

import math

import pytest
import torch

from usvnet.detector_errors import OTHER_END
from usvnet.evaluation.integrity import WRONG, reflect, shares_caught, swap_ends, swap_sides
from usvnet.evaluation.reranging import Cases
from usvnet.geometry.camera import make_camera, project, stack_cameras
from usvnet.geometry.hull_model import generic_hull, hull_to
from usvnet.geometry.ranging import RangingLayer
from usvnet.geometry.rays import level_rotation

BOATS = 6


def level_m(upside_down: bool = False) -> torch.Tensor:
    """Points (6, 7, 3) of boats 5 to 7 m ahead that head all round, or of their deck's mirror image in the water."""
    x, y, z = hull_to(generic_hull(BOATS), dtype=torch.float64).points_m.unbind(-1)
    heading = torch.arange(BOATS, dtype=torch.float64)[:, None] * (2 * math.pi / BOATS) + 0.3
    ahead = torch.linspace(5, 7, BOATS, dtype=torch.float64)[:, None]
    right, forward = x * heading.sin() - y * heading.cos(), x * heading.cos() + y * heading.sin()
    return torch.stack([right, 1.5 + z if upside_down else 1.5 - z, ahead + forward], -1)


@pytest.fixture
def cases() -> Cases:
    K = [[700.0, 0, 319.5], [0, 700.0, 239.5], [0, 0, 1]]
    one = make_camera(K, (640, 480), height_m=1.5, pitch_rad=0.2, roll_rad=0.05, dtype=torch.float64)
    camera = stack_cameras([one] * BOATS)
    hull = hull_to(generic_hull(BOATS), dtype=torch.float64)
    hull = hull._replace(scale_std=0 * hull.scale_std, point_std_m=0 * hull.point_std_m)
    keypoints_px = project(level_m() @ level_rotation(camera.pitch_rad, camera.roll_rad), camera)
    covariance_px2 = torch.eye(2, dtype=torch.float64).expand(BOATS, 7, 2, 2)
    boxes_px = torch.cat([keypoints_px.amin(1), keypoints_px.amax(1)], -1)
    return Cases(keypoints_px, covariance_px2, boxes_px, camera, hull)


def test_a_reflection_is_the_boat_upside_down(cases):
    camera = cases.camera
    expected = project(level_m(upside_down=True) @ level_rotation(camera.pitch_rad, camera.roll_rad), camera)
    torch.testing.assert_close(reflect(cases), expected)


def test_ends_and_sides_change_places(cases):
    before, ends = cases.keypoints_px, swap_ends(cases)
    assert torch.equal(ends[:, 3], before[:, 6])
    assert torch.equal(ends[:, 1], before[:, 5])  # a boat turned about has its port on the other side
    assert torch.equal(ends[:, 0], before[:, 4:6].mean(1))
    assert [OTHER_END[n] for n in OTHER_END] == list(range(7))
    assert torch.equal(swap_sides(cases)[:, [1, 2, 4, 5]], before[:, [2, 1, 5, 4]])


def test_near_boats_made_wrong_are_refused(cases):
    limit, caught = shares_caught(cases, RangingLayer(), draws=60)
    assert 0.5 < limit < 1.2
    assert caught.keys() == WRONG.keys()
    assert (caught["reflection"] > 0.99).all()
    assert caught["swapped ends"].mean() > 0.7
    assert caught["swapped sides"].mean() > 0.7


def test_twice_the_false_alarms_catch_no_less(cases):
    strict, few = shares_caught(cases, RangingLayer(), false_alarms=0.01)
    loose, more = shares_caught(cases, RangingLayer(), false_alarms=0.1)
    assert loose < strict
    assert all((more[name] >= few[name]).all() for name in WRONG)
