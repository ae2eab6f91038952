import math

import cv2
import numpy as np
import pytest
import torch
from torch import float64

from tests.simulator.small_frames import STRONG_LENS, small_camera
from usvnet.geometry.camera import make_camera, project
from usvnet.simulator.frame_spec import ShutterSpec
from usvnet.simulator.optics import Optics, pinhole_view, view_limits

STILL = ShutterSpec()
ODD = make_camera(
    [[205.0, 0, 84.3], [0, 198.0, 55.1], [0, 0, 1]], (160, 120), STRONG_LENS, height_m=1.2, pitch_rad=0.1, dtype=float64
)
ROLLING = ShutterSpec(0.0, 0.04, 0.5, -0.7, 0.4)


def rays_of(optics, pixels, time_s):
    """Rays in the camera frame of mid-exposure, by way of the pinhole picture."""
    places = optics.pinhole_of(pixels, time_s)
    middle = np.array([optics.view.width - 1, optics.view.height - 1]) / 2
    return np.concatenate([(places - middle) / optics.view.focal_px, np.ones((len(places), 1))], 1)


def test_a_pinhole_camera_at_rest_is_left_alone_bit_for_bit():
    optics = Optics(small_camera(), STILL)
    picture = np.random.default_rng(0).random((120, 160, 3), np.float32)
    assert optics.identity
    assert (optics.view.width, optics.view.height) == (160, 120)
    assert np.array_equal(optics.apply(picture), picture)
    assert np.array_equal(
        optics.apply_labels(np.arange(160 * 120, dtype=np.int32).reshape(120, 160), 1).ravel(), np.arange(160 * 120)
    )


@pytest.mark.parametrize(
    "camera", [small_camera(), small_camera(distortion=STRONG_LENS), ODD], ids=["pinhole", "lens", "odd"]
)
@pytest.mark.parametrize("shutter", [STILL, ROLLING], ids=["still", "rolling"])
def test_a_pixels_ray_projects_back_to_the_pixel(camera, shutter):
    optics = Optics(camera, shutter)
    pixels = np.random.default_rng(1).uniform([0, 0], [159, 119], (200, 2))
    rays = rays_of(optics, pixels, optics.row_time_s(pixels[:, 1]))
    for distance in (0.5, 30.0):
        assert np.abs(optics.project(distance * rays) - pixels).max() < 1e-6


def test_projection_is_that_of_the_geometry_and_of_opencv():
    points = np.random.default_rng(2).uniform([-1, -1, 4], [1, 1, 20], (50, 3))
    seen = Optics(ODD, STILL).project(points)
    ours = project(torch.from_numpy(points)[None], ODD)[0].numpy()
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), ODD.K[0].numpy(), np.array(STRONG_LENS))
    assert np.abs(seen - ours).max() < 1e-12
    assert np.abs(seen - theirs[:, 0]).max() < 1e-9


@pytest.mark.parametrize(
    "shutter", [STILL, ROLLING, ShutterSpec(0.02, 0.03, 0.3, 0.4, -0.2)], ids=["still", "rolling", "blurred"]
)
def test_dots_of_the_pinhole_land_where_points_project(shutter):
    """A dot drawn in the pinhole picture comes out where it projects, to what interpolation can do (0.03 px)."""
    optics = Optics(ODD, shutter)
    goals = np.array([[30.0, 25.0], [80.3, 60.2], [131.6, 95.7], [25.1, 92.4]])
    places = optics.pinhole_of(goals, optics.row_time_s(goals[:, 1]))
    u, v = np.meshgrid(np.arange(optics.view.width), np.arange(optics.view.height))
    x, y = np.meshgrid(np.arange(160.0), np.arange(120.0))
    pixels = np.stack([x.ravel(), y.ravel()], -1)
    seen_at = optics.pinhole_of(pixels, optics.row_time_s(pixels[:, 1])).reshape(120, 160, 2)
    for goal, place in zip(goals, places):
        dot = np.exp(-((u - place[0]) ** 2 + (v - place[1]) ** 2) / (2 * 2.0**2)).astype(np.float32)[..., None]
        drawn = optics.apply(dot)[..., 0]
        ideal = np.exp(-((seen_at - place) ** 2).sum(-1) / (2 * 2.0**2))
        centroid, exact = (np.array([(x * w).sum(), (y * w).sum()]) / w.sum() for w in (drawn, ideal))
        assert np.abs(centroid - exact).max() < 0.03
        assert np.abs(exact - goal).max() < 0.03, "a lens bends a dot of 2 px by no more"


def test_masks_are_warped_like_the_picture():
    optics = Optics(ODD, STILL)
    u, v = np.meshgrid(np.arange(optics.view.width * 2), np.arange(optics.view.height * 2))
    fine = (u * 10_000 + v).astype(np.int32)
    seen = optics.apply_labels(fine, 2)
    assert seen.shape == (240, 320)
    for part in ([20, 11], [169, 110], [301, 220]):  # sub-pixels, two along each side of a pixel
        place = optics.pinhole_of((np.array([part]) + 0.5) / 2 - 0.5, np.zeros(1))[0]
        found = seen[part[1], part[0]]
        assert np.abs((np.array([found // 10_000, found % 10_000]) + 0.5) / 2 - 0.5 - place).max() <= 0.2501


@pytest.mark.parametrize(
    ("rates", "axis", "sign"), [((0.5, 0, 0), 1, -1), ((0, 0.5, 0), 0, -1)], ids=["nose down", "to the right"]
)
def test_the_scene_moves_against_the_camera(rates, axis, sign):
    """A point straight ahead moves by f tan(rate t): up when the nose goes down, left when the camera turns right."""
    optics = Optics(small_camera(), ShutterSpec(0.0, 0.1, *rates))
    point = np.array([[0.0, 0.0, 10.0]])
    late, early = (optics._project_at(point, np.array([t]))[0] for t in (0.05, -0.05))
    assert late[axis] - early[axis] == pytest.approx(sign * 2 * 190 * math.tan(0.5 * 0.05), rel=1e-9)


def test_a_clockwise_camera_sees_the_scene_turn_the_other_way():
    optics = Optics(small_camera(), ShutterSpec(0.0, 0.1, 0, 0, 0.5))
    right = np.array([[3.0, 0.0, 10.0]])
    assert optics._project_at(right, np.array([0.05]))[0, 1] < optics._project_at(right, np.array([0.0]))[0, 1]


def test_a_rolling_shutter_shears_a_mast():
    """While the camera turns right, lower rows are read later and see things further left: by f rate t(v)."""
    optics = Optics(small_camera(pitch_rad=0.0), ShutterSpec(0.0, 0.04, 0, 0.5, 0))
    top, bottom = optics.project(np.array([[0.0, -2.5, 10.0], [0.0, 2.5, 10.0]]))
    assert top[0] - bottom[0] == pytest.approx(190 * 0.5 * 0.04 * (bottom[1] - top[1]) / 119, rel=0.03)


def test_motion_blur_spreads_a_dot_along_the_motion():
    still, moving = (Optics(small_camera(), ShutterSpec(0.05, 0.0, 0, rate, 0)) for rate in (0.0, 1.0))
    spreads = []
    for optics in (still, moving):
        u, v = np.meshgrid(np.arange(optics.view.width), np.arange(optics.view.height))
        middle = [(optics.view.width - 1) / 2, (optics.view.height - 1) / 2]
        dot = np.exp(-((u - middle[0]) ** 2 + (v - middle[1]) ** 2) / 2).astype(np.float32)[..., None]
        seen = optics.apply(dot)[..., 0]
        x, y = np.meshgrid(np.arange(160), np.arange(120))
        spreads.append([math.sqrt(((a - c) ** 2 * seen).sum() / seen.sum()) for a, c in ((x, 79.5), (y, 59.5))])
    travel = 190 * 1.0 * 0.05
    assert spreads[1][0] == pytest.approx(math.hypot(spreads[0][0], travel / math.sqrt(12)), rel=0.05)
    assert spreads[1][1] == pytest.approx(spreads[0][1], rel=0.02)


@pytest.mark.parametrize(
    "camera", [small_camera(distortion=STRONG_LENS), ODD, small_camera(distortion=[0.1, 0, 0, 0, 0])]
)
def test_the_view_shows_every_ray_of_the_picture(camera):
    shutter = ShutterSpec(0.02, 0.03, 0.5, -0.5, 0.3)
    optics = Optics(camera, shutter)
    u, v = np.meshgrid([-0.5, 40, 80, 159.5], [-0.5, 60, 119.5])
    corners = np.stack([u.ravel(), v.ravel()], -1)
    for offset in (-0.01, 0.01):
        places = optics.pinhole_of(corners, optics.row_time_s(corners[:, 1]) + offset)
        assert places.min() > 1
        assert (places < [optics.view.width - 2, optics.view.height - 2]).all()
    assert pinhole_view(camera, shutter).width < 300


def test_the_limits_of_the_view_are_those_of_its_corners():
    camera = small_camera(roll_rad=0.05)
    lowest, aside = view_limits(camera, STILL)
    assert lowest > math.radians(6) + math.atan(60 / 190)
    assert math.atan(80 / 190) < aside < 0.6


def test_a_lens_that_cannot_be_undone_is_named():
    folding = small_camera(focal_px=60.0, distortion=[-0.9, 0, 0, 0, 0])
    with pytest.raises(ValueError, match="cannot be undone at pixel"):
        Optics(folding, STILL)
