import math

import pytest
import torch
from torch.autograd import gradcheck

from usvnet.geometry.camera import camera_to, make_camera, project, select_camera, stack_cameras, with_attitude
from usvnet.geometry.ranging import RangingLayer, paper_range
from usvnet.geometry.rays import level_rays, level_rotation
from usvnet.types import Camera, RangeEstimate

PARAMETERS = ("K", "distortion", "height_m", "pitch_rad", "roll_rad")
BOTH_WATERS = pytest.mark.parametrize("curved", [False, True], ids=["flat", "curved"])


def one_px(points: torch.Tensor) -> torch.Tensor:
    return torch.eye(2, dtype=points.dtype).expand(*points.shape, 2)


def plain_camera(**mount: float) -> Camera:
    mount = {"height_m": 1.5, "pitch_rad": math.radians(6)} | mount
    return make_camera([[700, 0, 319.5], [0, 700, 239.5], [0, 0, 1]], (640, 480), dtype=torch.float64, **mount)


def total(estimate: RangeEstimate) -> torch.Tensor:
    """Everything in an estimate that is valid, summed: a loss that touches every output."""
    valid = estimate.valid
    ranges = estimate.slant_m[valid].sum() + estimate.slant_std_m[valid].sum() + estimate.horizontal_m[valid].sum()
    return ranges + estimate.bearing_rad.sum() + estimate.position_m.sum()


def test_level_frame_is_the_one_of_the_conventions():
    pitch, roll = torch.tensor([0.2, -0.1, 0.4]).double(), torch.tensor([0.3, 0.5, -1.0]).double()
    for i, (p, r) in enumerate(zip(pitch, roll)):
        Rz = torch.tensor([[r.cos(), -r.sin(), 0], [r.sin(), r.cos(), 0], [0, 0, 1]], dtype=torch.float64)
        Rx = torch.tensor([[1, 0, 0], [0, p.cos(), p.sin()], [0, -p.sin(), p.cos()]], dtype=torch.float64)
        torch.testing.assert_close(level_rotation(pitch, roll)[i], Rx @ Rz)
    axis = level_rotation(torch.tensor([0.1]), torch.tensor([0.0]))[0] @ torch.tensor([0.0, 0.0, 1.0])
    assert axis[1] > 0  # pitch > 0: the optical axis points below the horizontal
    right = level_rotation(torch.tensor([0.0]), torch.tensor([0.1]))[0] @ torch.tensor([1.0, 0.0, 0.0])
    assert right[1] > 0  # roll > 0: turned clockwise seen from behind, so that its right side goes down


def test_points_on_the_water_give_back_their_range(camera):
    # Forwards: points of the water in the level frame, into the camera, through the lens, and back again.
    torch.manual_seed(0)
    bearing = (torch.rand(1, 50, dtype=torch.float64) - 0.5) * 0.7
    distance = 4 + 60 * torch.rand(1, 50, dtype=torch.float64)
    height = camera.height_m.expand(1, 50)
    points = torch.stack([distance * bearing.sin(), height, distance * bearing.cos()], -1)
    R = level_rotation(camera.pitch_rad, camera.roll_rad)
    pixels = project(points @ R, camera)  # points @ R is R^T applied to each of them
    got = RangingLayer().range_points(pixels, one_px(pixels), camera)
    assert got.valid.all()
    torch.testing.assert_close(got.slant_m, points.norm(dim=-1), rtol=1e-7, atol=0)
    torch.testing.assert_close(got.horizontal_m, distance, rtol=1e-7, atol=0)
    torch.testing.assert_close(got.bearing_rad, bearing, rtol=1e-7, atol=1e-9)
    torch.testing.assert_close(got.position_m, points, rtol=1e-7, atol=1e-7)


def test_paper_range_is_the_general_form_without_roll_and_distortion(water_px):
    camera = plain_camera()
    general = RangingLayer().range_points(water_px, one_px(water_px), camera)
    paper = paper_range(water_px, camera.K, camera.height_m, camera.pitch_rad)
    torch.testing.assert_close(paper, general.slant_m, rtol=1e-12, atol=0)
    sky = water_px - torch.tensor([0.0, 400.0])
    assert torch.isinf(paper_range(sky, camera.K, camera.height_m, camera.pitch_rad)).all()


def test_paper_range_golden():
    # By hand: on the optical axis beta = pitch, so D = h / sin(pitch) = 1.5 / sin(6 deg).
    camera = plain_camera()
    centre = torch.tensor([[[319.5, 239.5]]], dtype=torch.float64)
    paper = paper_range(centre, camera.K, camera.height_m, camera.pitch_rad)
    assert paper.item() == pytest.approx(14.350158, abs=1e-6)


def test_one_pixel_at_ten_metres_costs_one_percent():
    # The design's floor: 1 px at h = 1.5 m, f = 700 px, 10 m away is 0.95 % of range.
    camera = plain_camera()
    down = math.asin(1.5 / 10) - math.radians(6)
    pixel = torch.tensor([[[319.5, 239.5 + 700 * math.tan(down)]]], dtype=torch.float64)
    got = RangingLayer().range_points(pixel, one_px(pixel), camera)
    assert got.slant_m.item() == pytest.approx(10.0)
    assert got.slant_std_m.item() / 10 == pytest.approx(0.0095, abs=0.0002)


@BOTH_WATERS
def test_std_is_the_first_order_of_autograd(camera, water_px, pixel_covariance, curved):
    layer = RangingLayer(curved)

    def slant(points, pitch, roll, height, focal_scale):
        scale = torch.stack([focal_scale, focal_scale, torch.ones_like(focal_scale)])
        moved = camera._replace(
            K=torch.diag(scale) @ (camera.K - CENTRE) + CENTRE, pitch_rad=pitch, roll_rad=roll, height_m=height
        )
        return layer.range_points(points, pixel_covariance, moved).slant_m

    CENTRE = camera.K * torch.tensor([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    scale = torch.tensor(1.0, dtype=torch.float64)
    arguments = (water_px, camera.pitch_rad, camera.roll_rad, camera.height_m, scale)
    by_px, by_pitch, by_roll, by_height, by_scale = torch.autograd.functional.jacobian(slant, arguments)
    J = torch.stack([by_px[0, i, 0, i] for i in range(6)])
    variance = (
        torch.einsum("pi,pij,pj->p", J, pixel_covariance[0], J)
        + (by_pitch[0, :, 0] * camera.pitch_std_rad) ** 2
        + (by_roll[0, :, 0] * camera.roll_std_rad) ** 2
        + by_height[0, :, 0] ** 2 * (camera.height_std_m**2 + camera.wave_std_m**2)
        + (by_scale[0] * camera.focal_std_px / camera.K[0, 1, 1]) ** 2
    )
    got = layer.range_points(water_px, pixel_covariance, camera)
    torch.testing.assert_close(got.slant_std_m[0], variance.sqrt(), rtol=1e-9, atol=0)


@BOTH_WATERS
def test_std_is_monte_carlos(camera, water_px, pixel_covariance, curved):
    torch.manual_seed(0)
    samples, layer = 200_000, RangingLayer(curved)
    points, covariance = water_px[:, 1:2], pixel_covariance[:, 1:2]
    first_order = layer.range_points(points, covariance, camera).slant_std_m

    def noise(std: torch.Tensor) -> torch.Tensor:
        return std * torch.randn(samples, dtype=torch.float64)

    fraction = noise(camera.focal_std_px / camera.K[:, 1, 1])
    K = camera.K.repeat(samples, 1, 1)
    K[:, 0, 0] *= 1 + fraction
    K[:, 1, 1] *= 1 + fraction
    noisy = camera._replace(
        K=K,
        height_m=camera.height_m + noise(camera.height_std_m) + noise(camera.wave_std_m),
        pitch_rad=camera.pitch_rad + noise(camera.pitch_std_rad),
        roll_rad=camera.roll_rad + noise(camera.roll_std_rad),
    )
    shake = torch.randn(samples, 1, 2, dtype=torch.float64) @ torch.linalg.cholesky(covariance[0, 0]).T
    slant = layer.range_points(points + shake, covariance, noisy).slant_m
    torch.testing.assert_close(slant.std(0), first_order[0], rtol=0.02, atol=0)


@BOTH_WATERS
def test_above_the_horizon_there_is_no_range(curved):
    camera = plain_camera(pitch_rad=0.0)
    pixels = torch.tensor([[[100.0, 0.0], [319.5, 239.5], [600.0, 239.4], [600.0, 245.0]]], dtype=torch.float64)
    got = RangingLayer(curved).range_points(pixels, one_px(pixels), camera)
    assert got.valid.tolist() == [[False, False, False, True]]
    for field in (got.slant_m, got.slant_std_m, got.horizontal_m):
        assert torch.isinf(field).tolist() == [[True, True, True, False]]
        assert (field > 0).all()
    assert (got.position_m[:, :3] == 0).all()


@BOTH_WATERS
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("distorted", [False, True])
def test_whatever_comes_in_no_nan_comes_out_or_back(camera, curved, dtype, distorted):
    camera = camera_to(with_attitude(camera, 0.0, 0.0), dtype=dtype)
    if not distorted:
        camera = camera._replace(distortion=torch.zeros_like(camera.distortion))
    camera = Camera(*(field.clone().requires_grad_() for field in camera))
    cx, cy = camera.K[0, 0, 2].item(), camera.K[0, 1, 2].item()
    pixels = [[cx, cy - 1e-6], [cx, cy], [cx, cy + 1e-6], [cx, cy + 0.01], [cx, cy + 0.5], [cx, cy + 100]]
    pixels += [[cx, 0.0], [1e6, 1e6], [-1e6, 1e6], [1e6, -1e6], [1e6, cy], [1e20, 1e20], [-1e38, 1e38]]
    pixels += [[math.nan, 1.0], [1.0, math.inf], [-math.inf, math.nan], [1500.0, 1500.0]]
    points = torch.tensor([pixels], dtype=dtype, requires_grad=True)
    covariance = one_px(points).clone().requires_grad_()
    got = RangingLayer(curved).range_points(points, covariance, camera)
    assert got.valid.any()
    assert (got.slant_m > 0).all()
    assert torch.equal(torch.isfinite(got.slant_m), got.valid)
    assert torch.equal(torch.isfinite(got.slant_std_m), got.valid)
    assert torch.isfinite(got.bearing_rad).all()
    assert torch.isfinite(got.position_m).all()
    total(got).backward()
    for leaf in (points, covariance, *camera):
        assert leaf.grad is None or torch.isfinite(leaf.grad).all()
    assert (points.grad[0, 5] != 0).any()
    assert (points.grad[0, 13:16] == 0).all()


def test_a_pixel_that_the_lens_cannot_see_has_no_range(camera):
    points = torch.tensor([[[300.0, 300.0], [1e6, 1e6], [math.nan, 300.0]]], dtype=torch.float64)
    got = RangingLayer().range_points(points, one_px(points), camera)
    assert got.valid.tolist() == [[True, False, False]]
    assert torch.isinf(got.slant_m).tolist() == [[False, True, True]]


def test_straight_down_has_a_range_but_no_bearing_and_finite_gradients():
    camera = camera_to(plain_camera(pitch_rad=math.pi / 4), dtype=torch.float32)
    points = torch.tensor([[[319.5, 239.5 + 700]]], requires_grad=True)  # 45 degrees below an axis 45 degrees down
    got = RangingLayer().range_points(points, one_px(points), camera)
    assert got.position_m.tolist() == [[[0, pytest.approx(1.5), 0]]]
    assert got.bearing_rad.item() == 0
    total(got).backward()
    assert torch.isfinite(points.grad).all()


def test_a_camera_without_any_uncertainty_still_has_a_gradient(water_px):
    points = water_px.clone().requires_grad_()
    got = RangingLayer().range_points(points, torch.zeros(1, 6, 2, 2, dtype=torch.float64), plain_camera())
    total(got).backward()
    assert torch.isfinite(points.grad).all()


def test_waterline_is_the_nearer_of_bow_and_stern_and_box_bottom_the_boxs(camera):
    keypoints = torch.full((1, 3, 7, 2), 300.0, dtype=torch.float64)
    keypoints[0, 0, 3], keypoints[0, 0, 6] = torch.tensor([[200.0, 320.0], [260.0, 300.0]])  # bow nearer
    keypoints[0, 1, 3], keypoints[0, 1, 6] = torch.tensor([[200.0, 300.0], [260.0, 320.0]])  # stern nearer
    keypoints[0, 2, 3], keypoints[0, 2, 6] = torch.tensor([[200.0, 10.0], [260.0, 300.0]])  # bow in the sky
    keypoints.requires_grad_()
    covariance = torch.eye(2, dtype=torch.float64).expand(1, 3, 7, 2, 2)
    boxes = torch.tensor([[[190.0, 250.0, 270.0, 325.0]]], dtype=torch.float64).expand(1, 3, 4)
    layer = RangingLayer()
    ranges = layer(keypoints, covariance, boxes, camera)
    box_bottom, waterline = ranges.box_bottom, ranges.waterline

    chosen = torch.stack([keypoints[0, 0, 3], keypoints[0, 1, 6], keypoints[0, 2, 6]])[None]
    for got, expected in zip(waterline, layer.range_points(chosen, one_px(chosen), camera)):
        torch.testing.assert_close(got, expected)
    bottom = torch.tensor([[[230.0, 325.0]]], dtype=torch.float64).expand(1, 3, 2)
    for got, expected in zip(box_bottom, layer.range_points(bottom, one_px(bottom), camera)):
        torch.testing.assert_close(got, expected)

    waterline.slant_m.sum().backward()
    pulled = keypoints.grad[0].abs().sum(-1) > 0
    assert [row.nonzero().flatten().tolist() for row in pulled] == [[3], [6], [6]]


def test_batched_is_looped(camera, water_px, pixel_covariance):
    cameras = [camera, with_attitude(camera, 0.2, -0.1), plain_camera(height_m=3.0)]
    points = torch.cat([water_px, water_px + 3, water_px - 2])
    batched = RangingLayer().range_points(points, pixel_covariance.expand(3, -1, -1, -1), stack_cameras(cameras))
    for i, one in enumerate(cameras):
        looped = RangingLayer().range_points(points[i : i + 1], pixel_covariance, one)
        for a, b in zip(batched, looped):
            torch.testing.assert_close(a[i : i + 1], b, rtol=1e-12, atol=1e-12)
    assert torch.equal(select_camera(stack_cameras(cameras), 1).pitch_rad, cameras[1].pitch_rad)


@BOTH_WATERS
def test_scripted_is_eager(camera, water_px, pixel_covariance, curved):
    torch.manual_seed(0)
    layer = RangingLayer(curved)
    scripted = torch.jit.script(layer)
    batch = stack_cameras([camera, with_attitude(camera, 0.15, 0.2)])
    for boats in (1, 4):
        keypoints = torch.rand(2, boats, 7, 2, dtype=torch.float64) * 640
        covariance = torch.eye(2, dtype=torch.float64).expand(2, boats, 7, 2, 2)
        boxes = torch.rand(2, boats, 4, dtype=torch.float64) * 640
        expected, got = layer(keypoints, covariance, boxes, batch), scripted(keypoints, covariance, boxes, batch)
        for eager, other in ((expected.box_bottom, got.box_bottom), (expected.waterline, got.waterline)):
            for a, b in zip(eager, other):
                torch.testing.assert_close(a, b, rtol=1e-12, atol=1e-12)
    for a, b in zip(
        layer.range_points(water_px, pixel_covariance, camera),
        scripted.range_points(water_px, pixel_covariance, camera),
    ):
        torch.testing.assert_close(a, b, rtol=1e-12, atol=1e-12)


def test_autocast_and_half_precision_do_not_reach_the_geometry(camera, water_px, pixel_covariance):
    single = camera_to(camera, dtype=torch.float32)
    points, covariance = water_px.float(), pixel_covariance.float()
    expected = RangingLayer().range_points(points, covariance, single)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        got = RangingLayer().range_points(points, covariance, single)
    for a, b in zip(got, expected):
        assert torch.equal(a, b)
    half = RangingLayer().range_points(points.bfloat16(), covariance.bfloat16(), single)
    assert half.slant_m.dtype == torch.float32
    rounded = RangingLayer().range_points(points.bfloat16().float(), covariance.bfloat16().float(), single)
    for a, b in zip(half, rounded):
        assert torch.equal(a, b)


@BOTH_WATERS
def test_gradcheck(camera, water_px, pixel_covariance, curved):
    points, covariance = water_px[:, 1:3].clone().requires_grad_(), pixel_covariance[:, 1:3].clone().requires_grad_()
    names = [name for name in camera._fields if name != "size_px"]
    fields = [getattr(camera, name).clone().requires_grad_() for name in names]
    layer = RangingLayer(curved)

    def everything(points, covariance, *fields):
        moved = camera._replace(**dict(zip(names, fields)))
        return layer.range_points(points, covariance, moved)[:5]

    assert gradcheck(everything, (points, covariance, *fields))


def test_gradcheck_of_the_parts(camera, water_px):
    points = water_px[:, :3].clone().requires_grad_()
    K, distortion, height, pitch, roll = (getattr(camera, name).clone().requires_grad_() for name in PARAMETERS)
    assert gradcheck(level_rotation, (pitch, roll))
    assert gradcheck(paper_range, (points, K, height, pitch))

    def rays(points, K, distortion, pitch, roll):
        return level_rays(points, camera._replace(K=K, distortion=distortion, pitch_rad=pitch, roll_rad=roll))

    assert gradcheck(rays, (points, K, distortion, pitch, roll))
