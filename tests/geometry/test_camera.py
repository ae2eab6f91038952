import math

import cv2
import numpy as np
import pytest
import torch
from torch.autograd import gradcheck

from usvnet.geometry.camera import (
    camera_to,
    crop_camera,
    flip_camera,
    letterbox_camera,
    letterbox_matrix,
    make_camera,
    project,
    scale_camera,
    scale_matrix,
    select_camera,
    stack_cameras,
    transform_camera,
    with_attitude,
)
from usvnet.geometry.ranging import RangingLayer

GOOD = {"K": [[700, 0, 320], [0, 700, 240], [0, 0, 1]], "size_px": (640, 480), "height_m": 1.5}


def world_points() -> torch.Tensor:
    """Points (1, 200, 3) in front of the camera, all over its picture."""
    torch.manual_seed(0)
    points = torch.rand(1, 200, 3, dtype=torch.float64)
    points[..., 2] = 3 + 20 * points[..., 2]
    points[..., :2] = (points[..., :2] - 0.5) * torch.tensor([0.85, 0.65], dtype=torch.float64) * points[..., 2:]
    return points


def moved(pixels: torch.Tensor, A: torch.Tensor) -> torch.Tensor:
    return pixels * torch.stack([A[..., 0, 0], A[..., 1, 1]], -1) + A[..., :2, 2]


def crop_matrix(left_px: float, top_px: float) -> torch.Tensor:
    return torch.tensor([[1, 0, -left_px], [0, 1, -top_px], [0, 0, 1]], dtype=torch.float64)


MOVES = {
    "scale": (lambda camera: scale_camera(camera, (320, 200)), scale_matrix((640.0, 480.0), (320, 200))),
    "letterbox": (lambda camera: letterbox_camera(camera, (416, 416)), letterbox_matrix((640.0, 480.0), (416, 416))),
    "crop": (lambda camera: crop_camera(camera, 31, -12, (300, 200)), crop_matrix(31, -12)),
}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"K": [[0, 0, 320], [0, 700, 240], [0, 0, 1]]}, "K: expected a focal length above 0 px, got fx = 0"),
        ({"K": [[700, 0, math.nan], [0, 700, 240], [0, 0, 1]]}, "K: expected finite numbers"),
        ({"K": [[700, 2, 320], [0, 700, 240], [0, 0, 1]]}, r"K: expected \[\[fx, 0, cx\]"),
        ({"K": [[700, 0], [0, 700]]}, "K: expected a 3 x 3 matrix"),
        ({"size_px": (640, 0)}, "size_px: expected a width and a height above 0"),
        ({"distortion": [0.1, 0.1]}, "distortion: expected 4 or 5 coefficients, got 2"),
        ({"distortion": [0.1, 0.1, 0, math.inf]}, "distortion: expected finite numbers"),
        ({"height_m": 0.0}, "height_m: expected metres above the water, got 0"),
        ({"height_m": math.nan}, "height_m: expected metres above the water, got nan"),
        ({"pitch_rad": 6.0}, "pitch_rad: expected an angle within one half turn, got 6"),
        ({"roll_rad": math.nan}, "roll_rad: expected an angle"),
        ({"pitch_std_rad": -0.1}, "pitch_std_rad: expected a standard deviation of at least 0"),
        ({"focal_std_px": math.nan}, "focal_std_px: expected a standard deviation of at least 0"),
    ],
)
def test_make_camera_refuses(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        make_camera(**(GOOD | change))


def test_make_camera_takes_lists_arrays_and_tensors():
    K = GOOD["K"]
    for form in (K, np.array(K), torch.tensor(K)):
        camera = make_camera(form, (640, 480), [0.1, 0.2, 0.3, 0.4], height_m=2)
        assert camera.K.tolist() == [K]
        torch.testing.assert_close(camera.distortion, torch.tensor([[0.1, 0.2, 0.3, 0.4, 0.0]]))
        assert {field.dtype for field in camera} == {torch.float32}
        assert {len(field) for field in camera} == {1}


def test_project_is_opencvs(camera):
    points = world_points()
    K, distortion = camera.K[0].numpy(), camera.distortion[0].numpy()
    expected, _ = cv2.projectPoints(points[0].numpy(), np.zeros(3), np.zeros(3), K, distortion)
    np.testing.assert_allclose(project(points, camera)[0].numpy(), expected[:, 0], atol=1e-9)


def test_project_golden(camera):
    # cv2.projectPoints(np.array([[1.0, 0.5, 4.0]]), np.zeros(3), np.zeros(3), K, D) of OpenCV 5.0, K and D of conftest
    golden = [493.22139135360715, 320.97124042606356]
    point = torch.tensor([[[1.0, 0.5, 4.0]]], dtype=torch.float64)
    torch.testing.assert_close(
        project(point, camera)[0, 0], torch.tensor(golden, dtype=torch.float64), rtol=0, atol=1e-9
    )


def test_a_point_without_a_pixel_is_nan_and_pulls_on_nothing():
    camera = make_camera(GOOD["K"], (640, 480), (-0.3, 0, 0, 0), height_m=1.5)  # folds over at r = 1.05
    points = torch.tensor([[[0.1, 0.1, 1.0], [0.1, 0.1, -1.0], [0.1, 0.1, 0.0], [1.5, 0.0, 1.0]]], requires_grad=True)
    pixels = project(points, camera)
    assert torch.isnan(pixels).all(-1).tolist() == [[False, True, True, True]]
    pixels[~torch.isnan(pixels)].sum().backward()
    assert torch.isfinite(points.grad).all()
    assert (points.grad[0, 1:] == 0).all()


@pytest.mark.parametrize("move", MOVES)
def test_project_then_move_is_move_then_project(camera, move):
    apply, A = MOVES[move]
    points = world_points()
    torch.testing.assert_close(
        project(points, apply(camera)), moved(project(points, camera), A.double()), atol=1e-4, rtol=0
    )


@pytest.mark.parametrize("move", MOVES)
def test_a_moved_picture_keeps_its_ranges_and_their_stds(camera, water_px, pixel_covariance, move):
    apply, _ = MOVES[move]
    after = apply(camera)
    A = after.K @ torch.linalg.inv(camera.K)
    S = A[:, None, :2, :2]
    before = RangingLayer().range_points(water_px, pixel_covariance, camera)
    then = RangingLayer().range_points(moved(water_px, A[0]), S @ pixel_covariance @ S, after)
    for a, b in zip(before, then):
        torch.testing.assert_close(a, b, rtol=1e-9, atol=1e-9)


def test_flip_mirrors_the_picture_and_the_world(camera):
    points = world_points()
    mirrored = project(points * torch.tensor([-1.0, 1.0, 1.0]), flip_camera(camera))
    pixels = project(points, camera)
    torch.testing.assert_close(mirrored, torch.stack([639 - pixels[..., 0], pixels[..., 1]], -1))


def test_flip_keeps_ranges_and_turns_bearings(camera, water_px, pixel_covariance):
    mirrored = torch.stack([639 - water_px[..., 0], water_px[..., 1]], -1)
    covariance = pixel_covariance * torch.tensor([[1.0, -1.0], [-1.0, 1.0]])
    before = RangingLayer().range_points(water_px, pixel_covariance, camera)
    then = RangingLayer().range_points(mirrored, covariance, flip_camera(camera))
    for name in ("slant_m", "slant_std_m", "horizontal_m"):
        torch.testing.assert_close(getattr(then, name), getattr(before, name), rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(then.bearing_rad, -before.bearing_rad)


def test_flip_twice_is_nothing(camera):
    for a, b in zip(flip_camera(flip_camera(camera)), camera):
        torch.testing.assert_close(a, b)


def test_letterbox_fits_edge_to_edge():
    A = letterbox_matrix((640, 480), (320, 320))  # half size, 40 rows above and below
    corners = torch.tensor([[-0.5, -0.5], [639.5, 479.5]])
    torch.testing.assert_close(moved(corners, A), torch.tensor([[-0.5, 39.5], [319.5, 279.5]]))


def test_letterbox_that_only_pads_keeps_whole_pixels():
    A = letterbox_matrix((640, 481), (640, 640))
    torch.testing.assert_close(A, torch.tensor([[1.0, 0, 0], [0, 1, 79], [0, 0, 1]]))


def test_letterbox_does_not_depend_on_the_precision():
    sizes = torch.cartesian_prod(torch.arange(100.0, 1300, 37), torch.arange(100.0, 1300, 41))
    for target in ((416, 416), (640, 384)):
        single, double = letterbox_matrix(sizes, target), letterbox_matrix(sizes.double(), target)
        assert (single - double).abs().max() < 1e-3


def test_letterbox_of_pictures_of_several_sizes(camera):
    other = camera._replace(size_px=torch.tensor([[1280.0, 720.0]], dtype=torch.float64))
    both = letterbox_camera(stack_cameras([camera, other]), (320, 320))
    for index, one in enumerate((camera, other)):
        for a, b in zip(select_camera(both, index), letterbox_camera(one, (320, 320))):
            torch.testing.assert_close(a, b)
    assert both.size_px.tolist() == [[320, 320], [320, 320]]


def test_transform_refuses_turns_and_mirrors(camera):
    mirror = torch.tensor([[-1.0, 0, 639], [0, 1, 0], [0, 0, 1]])
    turn = torch.tensor([[0.0, -1, 479], [1, 0, 0], [0, 0, 1]])
    for A in (mirror, turn):
        with pytest.raises(ValueError, match="A: expected positive scales and a shift"):
            transform_camera(camera, A, (640, 480))


def test_stack_select_and_move_to_dtype(camera):
    tilted = with_attitude(camera, 0.2, -0.1)
    batch = camera_to(stack_cameras([camera, tilted]), dtype=torch.float32)
    assert {field.dtype for field in batch} == {torch.float32}
    for index, one in enumerate((camera, tilted)):
        for a, b in zip(select_camera(batch, index), camera_to(one, dtype=torch.float32)):
            assert torch.equal(a, b)
    with pytest.raises(IndexError):
        select_camera(batch, 2)


def test_attitude_override_keeps_what_is_not_given(camera):
    batch = stack_cameras([camera, camera])
    changed = with_attitude(batch, torch.tensor([0.1, 0.2]), 0.05, pitch_std_rad=0.001)
    torch.testing.assert_close(changed.pitch_rad, torch.tensor([0.1, 0.2]).double())
    assert changed.roll_rad.tolist() == [0.05, 0.05]
    assert changed.pitch_std_rad.tolist() == [0.001, 0.001]
    assert torch.equal(changed.roll_std_rad, batch.roll_std_rad)
    assert torch.equal(changed.K, batch.K)


def test_gradcheck_project(camera):
    points = world_points()[:, :4].requires_grad_()
    K, distortion = camera.K.clone().requires_grad_(), camera.distortion.clone().requires_grad_()
    assert gradcheck(lambda p, K, d: project(p, camera._replace(K=K, distortion=d)), (points, K, distortion))
