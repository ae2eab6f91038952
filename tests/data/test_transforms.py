import dataclasses

import cv2
import numpy as np
import pytest
import torch

from usvnet.data.records import Frame
from usvnet.data.transforms import (
    FILL,
    mirror_frame,
    mirror_matrix,
    move_frame,
    resize_matrix,
    turn_frame,
    warp,
)
from usvnet.geometry.hull_model import mirror_hull
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import FLIP_INDEX, KEYPOINT_NAMES


def dot_picture(size_px: tuple[int, int], centre_px: np.ndarray, sigma_px: float = 3.0) -> np.ndarray:
    """A soft bright dot on the grey of the padding."""
    u, v = np.meshgrid(np.arange(size_px[0]), np.arange(size_px[1]))
    dot = np.exp(-((u - centre_px[0]) ** 2 + (v - centre_px[1]) ** 2) / (2 * sigma_px**2))
    return np.repeat((FILL + 140 * dot).round().astype(np.uint8)[..., None], 3, -1)


def dot_centre(picture: np.ndarray) -> np.ndarray:
    weight = (picture[..., 0].astype(float) - FILL).clip(0)
    v, u = np.indices(weight.shape)
    return np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()


def water_ranges(frame: Frame) -> torch.Tensor:
    """(n * 7,) range of every keypoint as if it lay on the water."""
    points = torch.from_numpy(frame.keypoints_px).float().reshape(1, -1, 2)
    return RangingLayer().range_points(points, torch.eye(2).expand(1, points.shape[1], 2, 2), frame.camera).slant_m[0]


def affine(zoom: float, shift: tuple[float, float], size_px: tuple[int, int]) -> np.ndarray:
    """About the middle of the picture."""
    A = np.diag((zoom, zoom, 1.0))
    A[:2, 2] = (1 - zoom) * (np.array(size_px) - 1) / 2 + shift
    return A


@pytest.mark.parametrize("zoom", [0.21, 0.3, 0.47, 0.5, 0.501, 0.8, 1.0, 1.6])
@pytest.mark.parametrize(("mirrored", "turn"), [(False, 0.0), (True, 0.0), (False, 0.3), (True, -0.2)])
def test_a_dot_stays_on_its_keypoint(make_frame, zoom: float, mirrored: bool, turn: float):
    frame = make_frame(3, size_px=(321, 240))
    point = frame.keypoints_px[0, 3]
    A = affine(zoom, (4.3, -2.6), frame.size_px)
    target_px = (320, 288)
    turned, T = turn_frame(frame, turn)
    moved = move_frame(turned, A, target_px)
    A = A @ T
    index = 3
    if mirrored:
        moved, A = mirror_frame(moved), mirror_matrix(target_px[0]) @ A
        index = FLIP_INDEX[index]
    picture = warp(dot_picture(frame.size_px, point, 3.0 / min(zoom, 1)), A, target_px)
    assert picture.shape == (288, 320, 3)
    np.testing.assert_allclose(dot_centre(picture), moved.keypoints_px[0, index], atol=0.1)


@pytest.mark.parametrize("zoom", [0.4, 1.0, 1.5])
def test_ranges_stay_when_picture_and_camera_move(make_frame, zoom: float):
    frame = make_frame(2, boats=2)
    expected = water_ranges(frame)
    moved = move_frame(frame, affine(zoom, (3.0, -5.5), frame.size_px), (192, 160))
    assert moved.size_px == (192, 160)
    torch.testing.assert_close(water_ranges(moved), expected, rtol=1e-4, atol=1e-4)


def test_ranges_stay_in_a_mirror_and_port_becomes_starboard(make_frame):
    frame = make_frame(2, boats=2)
    mirrored = mirror_frame(frame)
    expected = water_ranges(frame).reshape(2, 7)[:, list(FLIP_INDEX)]
    torch.testing.assert_close(water_ranges(mirrored).reshape(2, 7), expected, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(mirror_hull(mirrored.hull).points_m, frame.hull.points_m)
    width = frame.size_px[0]
    left, right = KEYPOINT_NAMES.index("bow_left"), KEYPOINT_NAMES.index("bow_right")
    np.testing.assert_allclose(mirrored.keypoints_px[:, left, 0], width - 1 - frame.keypoints_px[:, right, 0])
    np.testing.assert_array_equal(mirrored.visibility[:, left], frame.visibility[:, right])
    assert (mirrored.boxes_px[:, 2] > mirrored.boxes_px[:, 0]).all()


def test_a_mirror_twice_changes_nothing(make_frame):
    frame = dataclasses.replace(make_frame(1, boats=3), reference=np.array([-1, 1, 6]))
    twice = mirror_frame(mirror_frame(frame))
    assert mirror_frame(frame).reference.tolist() == [-1, 2, 6]
    for field in ("boxes_px", "keypoints_px", "visibility", "reference", "range_m"):
        np.testing.assert_allclose(getattr(twice, field), getattr(frame, field), atol=1e-9)
    for ours, theirs in zip(twice.camera, frame.camera):
        torch.testing.assert_close(ours, theirs)


def one_boat(make_frame, boxes_px: list[float], reference: int = -1) -> Frame:
    """Keypoints in a row along the bottom of the box."""
    frame = make_frame(0)
    x1, y1, x2, y2 = boxes_px
    keypoints = np.stack((np.linspace(x1, x2, 7), np.full(7, (y1 + y2) / 2)), -1)
    return dataclasses.replace(
        frame, boxes_px=np.array([boxes_px]), keypoints_px=keypoints[None], reference=np.array([reference])
    )


def test_what_leaves_the_frame_is_cut_off(make_frame):
    frame = one_boat(make_frame, [10.0, 20.0, 70.0, 40.0])
    A = affine(1.0, (-40.0, 0.0), frame.size_px)
    moved = move_frame(frame, A, frame.size_px)
    np.testing.assert_allclose(moved.boxes_px, [[-0.5, 20, 30, 40]])
    assert moved.visibility[0, :3].tolist() == [0, 0, 0]  # at -30, -20 and -10
    np.testing.assert_array_equal(moved.visibility[0, 3:], frame.visibility[0, 3:])


@pytest.mark.parametrize(("left", "kept"), [(47.0, 1), (49.0, 0)])
def test_a_boat_is_dropped_below_a_fifth_of_its_box(make_frame, left: float, kept: int):
    frame = one_boat(make_frame, [0.0, 20.0, 60.0, 40.0])  # 12.5 px and 11.5 px of 60 stay inside
    A = affine(1.0, (-left, 0.0), frame.size_px)
    moved = move_frame(frame, A, frame.size_px)
    assert [len(moved.boxes_px), len(moved.range_m), len(moved.reference)] == [kept] * 3


@pytest.mark.parametrize(("reference", "kept"), [(-1, False), (0, False), (3, False), (4, True), (6, True)])
def test_a_range_goes_with_its_keypoint(make_frame, reference: int, kept: bool):
    frame = one_boat(make_frame, [10.0, 20.0, 70.0, 40.0], reference)
    A = affine(1.0, (-45.0, 0.0), frame.size_px)  # keypoints 0 to 3 leave on the left
    moved = move_frame(frame, A, frame.size_px)
    assert bool(moved.range_m[0] > 0) is kept
    assert bool(moved.range_std_m[0] > 0) is kept


def test_an_unlabelled_waterline_keypoint_does_not_cost_the_range(make_frame):
    frame = one_boat(make_frame, [10.0, 20.0, 70.0, 40.0])
    frame.visibility[0, 6] = 0
    frame.keypoints_px[0, 6] = -0.5
    assert move_frame(frame, np.eye(3), frame.size_px).range_m[0] > 0


def test_fine_stripes_turn_grey_and_not_into_broad_stripes():
    stripes = np.zeros((640, 640, 3), np.uint8)
    stripes[:, ::2] = 255
    for zoom in (0.3, 0.5, 0.6):
        small = warp(stripes, affine(zoom, (0, 0), (640, 640)), (640, 640))
        inside = small[240:400, 240:400].astype(float)
        assert inside.std() < 30  # the stripes' own deviation is 127


def test_an_exact_half_is_the_mean_of_four_pixels():
    picture = np.random.default_rng(0).integers(0, 256, (64, 96, 3), np.uint8)
    small = warp(picture, resize_matrix((96, 64), (48, 32)), (48, 32))
    expected = picture.reshape(32, 2, 48, 2, 3).mean((1, 3))
    np.testing.assert_allclose(small, expected, atol=0.51)


@pytest.mark.parametrize("turn", [-0.4, 0.05, 0.4])
def test_ranges_stay_when_picture_and_camera_turn(make_frame, turn: float):
    """With the frame's tangential distortion; boats keep their ranges and nothing is cut off yet."""
    frame = make_frame(2, boats=2)
    turned, _ = turn_frame(frame, turn)
    torch.testing.assert_close(water_ranges(turned), water_ranges(frame), rtol=1e-4, atol=1e-4)
    assert turned.camera.roll_rad.item() == pytest.approx(frame.camera.roll_rad.item() + turn)
    np.testing.assert_array_equal(turned.range_m, frame.range_m)
    np.testing.assert_array_equal(turned.visibility, frame.visibility)


def test_turn_zoom_shift_and_mirror_together_keep_every_range(make_frame):
    frame = make_frame(2, boats=2)
    moved = mirror_frame(move_frame(turn_frame(frame, 0.1)[0], affine(1.3, (4.0, -3.0), frame.size_px), (192, 160)))
    expected = water_ranges(frame).reshape(2, 7)[:, list(FLIP_INDEX)]
    torch.testing.assert_close(water_ranges(moved).reshape(2, 7), expected, rtol=1e-4, atol=1e-4)


def test_a_turned_box_bounds_its_ellipse_and_its_labelled_keypoints(make_frame):
    frame = one_boat(make_frame, [40.0, 50.0, 100.0, 70.0])
    frame.visibility[0] = [2, 2, 2, 2, 2, 2, 0]  # the last, at the box's right side, is not labelled
    frame.keypoints_px[0, 6] = 1e4
    quarter, A = turn_frame(frame, np.pi / 2)
    size = (quarter.boxes_px[0, 2:] - quarter.boxes_px[0, :2]).tolist()
    assert size == pytest.approx([20, 60], abs=1e-3)
    little, A = turn_frame(frame, 0.1)
    width, height = little.boxes_px[0, 2:] - little.boxes_px[0, :2]
    assert 2 * np.hypot(30 * np.cos(0.1), 10 * np.sin(0.1)) == pytest.approx(width, abs=0.1)
    assert 2 * np.hypot(30 * np.sin(0.1), 10 * np.cos(0.1)) == pytest.approx(height, abs=0.1)
    frame.keypoints_px[0, 0] = [40.0, 70.0]  # the box's corner
    corner = A[:2, :2] @ [40.0, 70.0] + A[:2, 2]
    turned = turn_frame(frame, 0.1)[0].boxes_px[0]
    assert turned[0] == pytest.approx(min(little.boxes_px[0, 0], corner[0]), abs=1e-3)
    assert turned[3] == pytest.approx(max(little.boxes_px[0, 3], corner[1]), abs=1e-3)
    assert turned[3] > little.boxes_px[0, 3] + 1


@pytest.mark.parametrize("zoom", [0.3, 0.7, 1.0, 2.0])
def test_looking_at_the_part_shown_changes_nothing(zoom: float):
    """A frame twice as wide shows the same pixels, up to the grid that averaging starts from."""
    rng = np.random.default_rng(0)
    picture = cv2.GaussianBlur(rng.integers(0, 256, (300, 400, 3), np.uint8), (0, 0), 6)
    A = np.array([[zoom, 0, -zoom * 120.3], [0, zoom, -zoom * 90.7], [0, 0, 1]]) @ mirror_matrix(400)
    small, large = warp(picture, A, (40, 30)), warp(picture, A, (400, 300))
    np.testing.assert_allclose(small.astype(int), large[:30, :40], atol=3)


def test_a_frame_beside_the_picture_is_grey():
    A = affine(0.2, (-5000.0, 0.0), (400, 300))
    assert (warp(np.zeros((300, 400, 3), np.uint8), A, (40, 30)) == FILL).all()
