"""Four estimators side by side: what they reach, whether their sigmas are honest, and when the hull is refused."""

import math

import pytest
import torch

from usvnet.geometry.camera import make_camera
from usvnet.geometry.hull_range import halfway
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import Camera, Hull, RangeEstimate, Ranges, Reason

from .boats import draw_poses, known_hull, nearest_m, put, repeat_camera, see, uniform

ROLL_STD_RAD, PITCH_STD_RAD = 0.05, 0.035
WAVE_M = 0.02
STD = {
    "focal_std_px": 3.0,
    "height_std_m": 0.02,
    "pitch_std_rad": math.radians(0.3),
    "roll_std_rad": math.radians(0.3),
    "wave_std_m": WAVE_M,
}


def mounted(boats: int, pitch_rad: float = 0.1, **std: float) -> Camera:
    K = [[700.0, 0, 319.5], [0, 700.0, 239.5], [0, 0, 1]]
    return repeat_camera(
        make_camera(K, (640, 480), height_m=1.5, pitch_rad=pitch_rad, dtype=torch.float64, **std), boats
    )


def noise(std: torch.Tensor) -> torch.Tensor:
    return std * torch.randn_like(std)


def disturbed(camera: Camera) -> Camera:
    """A camera as it may truly stand, going by its standard deviations."""
    scale = 1 + noise(camera.focal_std_px / 700)
    K = camera.K.clone()
    K[:, 0, 0], K[:, 1, 1] = scale * K[:, 0, 0], scale * K[:, 1, 1]
    return camera._replace(
        K=K,
        height_m=camera.height_m + noise(camera.height_std_m),
        pitch_rad=camera.pitch_rad + noise(camera.pitch_std_rad),
        roll_rad=camera.roll_rad + noise(camera.roll_std_rad),
    )


def float_boats(true: Camera, hull: Hull, near_m: float, far_m: float) -> torch.Tensor:
    """Level points (F, 7, 3) of boats that roll, pitch and ride waves, which stem and stern follow by half."""
    boats = len(hull.points_m)
    one = torch.ones(boats, dtype=torch.float64)
    lift, half = noise(true.wave_std_m), math.sqrt(0.5)
    height = true.height_m - lift
    level = put(
        hull.points_m, draw_poses(boats, near_m, far_m), height, noise(ROLL_STD_RAD * one), noise(PITCH_STD_RAD * one)
    )
    level[:, [3, 6], 1] += (1 - half) * lift[:, None] + noise(half * true.wave_std_m[:, None].expand(-1, 2))
    return level


def range_boats(pixels: torch.Tensor, camera: Camera, hull: Hull | None, std_px: float | torch.Tensor = 1.0) -> Ranges:
    """One boat in each picture, every keypoint with noise: of one standard deviation, or of seven (7, 1)."""
    std_px = torch.as_tensor(std_px, dtype=torch.float64).expand(7, 1)
    covariance = (std_px.unsqueeze(-1) ** 2 * torch.eye(2, dtype=torch.float64)).expand(len(pixels), 1, 7, 2, 2)
    boxes = torch.cat([pixels.amin(1), pixels.amax(1)], -1)[:, None]
    layer = RangingLayer(boat_roll_std_rad=ROLL_STD_RAD, boat_pitch_std_rad=PITCH_STD_RAD)
    with torch.no_grad():
        ranges: Ranges = layer((pixels + std_px * torch.randn_like(pixels))[:, None], covariance, boxes, camera, hull)
    return ranges


def relative_rmse(estimate: RangeEstimate, truth_m: torch.Tensor, chosen: torch.Tensor) -> float:
    return float((estimate.slant_m[:, 0] / truth_m - 1)[chosen].square().mean().sqrt())


@pytest.mark.parametrize(("near_m", "far_m"), [(4.0, 7.0), (7.0, 14.0), (14.0, 28.0)])
@pytest.mark.parametrize("scale_std", [0.0, 0.3])
def test_fused_is_as_good_as_the_better_one_and_every_sigma_is_honest(near_m: float, far_m: float, scale_std: float):
    torch.manual_seed(0)
    boats = 1500
    camera = mounted(boats, **STD)
    point_std_m = 0.03 if scale_std else 0.0
    told = known_hull(boats, scale_std, point_std_m)
    shape = told.points_m + point_std_m * torch.randn_like(told.points_m)
    shape[:, [3, 6], 2] = 0.0
    size = torch.exp(scale_std * torch.randn(boats, dtype=torch.float64))
    true = disturbed(camera)
    level = float_boats(true, told._replace(points_m=size[:, None, None] * shape), near_m, far_m)
    pixels, truth_m = see(level, true), nearest_m(level)
    ranges = range_boats(pixels.nan_to_num(), camera, told)
    chosen = ranges.hull.valid[:, 0] & ranges.waterline.valid[:, 0] & pixels.isfinite().all(-1).all(-1)
    assert chosen.double().mean() > 0.9

    rmse = {name: relative_rmse(getattr(ranges, name), truth_m, chosen) for name in ("waterline", "hull", "fused")}
    assert rmse["fused"] <= 1.02 * min(rmse["waterline"], rmse["hull"])
    for name in rmse:
        estimate = getattr(ranges, name)
        score = ((estimate.slant_m[:, 0] - truth_m) / estimate.slant_std_m[:, 0])[chosen]
        assert float(score.square().mean().sqrt()) == pytest.approx(1.0, abs=0.1), name
    better = torch.minimum(ranges.waterline.slant_std_m, ranges.hull.slant_std_m)[:, 0]
    same = (ranges.hull.position_m - ranges.waterline.position_m).norm(dim=-1)[:, 0] < 0.5
    assert (ranges.fused.slant_std_m[:, 0] <= 1.001 * better)[chosen & same].double().mean() > 0.99
    assert ranges.heading_std_rad.isfinite().all()


def test_sigmas_are_honest_where_deck_points_alone_say_how_high_a_boat_rides():
    """A network's sharp points are those of the deck, and what it cannot see is how far a wave has lifted them."""
    torch.manual_seed(0)
    boats = 1500
    still = {"height_std_m": 0.005, "pitch_std_rad": 1e-3, "roll_std_rad": 1e-3, "focal_std_px": 0.5}
    camera = mounted(boats, **STD | still)
    hull, true = known_hull(boats, 0.0, 0.0), disturbed(camera)
    level = float_boats(true, hull, 4.0, 7.0)
    pixels, truth_m = see(level, true), nearest_m(level)
    std_px = torch.tensor([0.5, 0.5, 0.5, 8.0, 0.5, 0.5, 8.0]).unsqueeze(-1)
    ranges = range_boats(pixels.nan_to_num(), camera, hull, std_px)
    chosen = ranges.hull.valid[:, 0] & pixels.isfinite().all(-1).all(-1)
    assert chosen.double().mean() > 0.9
    score = ((ranges.hull.slant_m[:, 0] - truth_m) / ranges.hull.slant_std_m[:, 0])[chosen]
    assert float(score.square().mean().sqrt()) == pytest.approx(1.0, abs=0.08)


def test_the_floors_of_the_design():
    """1 px at 10 m, h = 1.5 m, f = 700 px, a hull of 1 m: waterline 0.95 %, hull 0.39 %; with 0.3 deg of pitch 3.6 %.

    What the hull reaches with that pitch depends on its freeboard and heading: 1.2 to 2.7 % with this one.
    """
    boats = 12
    hull = known_hull(boats, size=1 / 1.1)
    heading = torch.arange(boats, dtype=torch.float64) * (2 * math.pi / boats)
    ten = torch.full((boats,), 10.0, dtype=torch.float64)
    camera = mounted(boats)
    pixels = see(put(hull.points_m, (0 * ten, ten, heading), camera.height_m), camera)[:, None]
    covariance = torch.eye(2, dtype=torch.float64).expand(boats, 1, 7, 2, 2)
    layer = RangingLayer(boat_roll_std_rad=0.0, boat_pitch_std_rad=0.0)

    def floors(camera: Camera) -> tuple[torch.Tensor, torch.Tensor]:
        ranges = layer(pixels, covariance, torch.zeros(boats, 1, 4, dtype=torch.float64), camera, hull)
        return tuple((e.slant_std_m / e.slant_m)[:, 0] for e in (ranges.waterline, ranges.hull))

    waterline, fitted = floors(camera)
    assert float(waterline.mean()) == pytest.approx(0.0095, abs=0.0006)
    assert float(fitted.mean()) == pytest.approx(0.0039, abs=0.0006)
    waterline, fitted = floors(mounted(boats, pitch_std_rad=math.radians(0.3)))
    assert float(waterline.mean()) == pytest.approx(0.036, abs=0.002)
    assert 0.011 < float(fitted.min()) < float(fitted.max()) < 0.027


def scenes(boats: int, near_m: float, far_m: float) -> tuple[Camera, Camera, Hull, torch.Tensor]:
    camera, hull = mounted(boats, **STD), known_hull(boats)
    true = disturbed(camera)
    return camera, true, hull, float_boats(true, hull, near_m, far_m)


def share_refused(pixels: torch.Tensor, camera: Camera, hull: Hull) -> float:
    seen = pixels.isfinite().all(-1).all(-1)
    reason = range_boats(pixels.nan_to_num(), camera, hull).hull.reason[:, 0]
    return float((reason[seen] == Reason.MISFIT.value).double().mean())


def test_what_does_not_fit_is_refused_and_what_fits_is_not():
    torch.manual_seed(1)
    camera, true, hull, level = scenes(1500, 4.0, 12.0)
    pixels = see(level, true)
    assert 0.003 < share_refused(pixels, camera, hull) < 0.02

    def reflected(keypoints: list[int]) -> torch.Tensor:
        mirrored = level.clone()
        mirrored[:, keypoints, 1] = 2 * true.height_m[:, None] - level[:, keypoints, 1]
        return see(mirrored, true)

    swapped = pixels[:, [0, 5, 4, 6, 2, 1, 3]].clone()
    swapped[:, 0] = pixels[:, 4:6].mean(1)
    assert share_refused(reflected([0, 1, 2, 4, 5]), camera, hull) > 0.99
    assert share_refused(reflected([0, 1]), camera, hull) > 0.99
    assert share_refused(swapped, camera, hull) > 0.8
    assert share_refused(pixels[:, [0, 2, 1, 3, 5, 4, 6]], camera, hull) > 0.85
    assert share_refused(pixels, camera, hull._replace(points_m=0.6 * hull.points_m)) > 0.9


def test_where_the_hull_is_refused_fused_lies_between_waterline_and_box():
    torch.manual_seed(2)
    camera, true, hull, level = scenes(50, 5.0, 8.0)
    level[:, [0, 1, 2, 4, 5], 1] = 2 * true.height_m[:, None] - level[:, [0, 1, 2, 4, 5], 1]
    ranges = range_boats(see(level, true).nan_to_num(), camera, hull)
    refused = ranges.hull.reason == Reason.MISFIT.value
    assert refused.double().mean() > 0.9
    assert (~ranges.hull.valid[refused]).all()
    assert ranges.hull.slant_m[refused].isinf().all()
    fused, waterline, box = (
        RangeEstimate(*(field[refused] for field in one)) for one in (ranges.fused, ranges.waterline, ranges.box_bottom)
    )
    assert fused.valid.all()
    torch.testing.assert_close(fused.slant_m, (waterline.slant_m + box.slant_m) / 2)
    torch.testing.assert_close(fused.horizontal_m, (waterline.horizontal_m + box.horizontal_m) / 2)
    torch.testing.assert_close(fused.position_m.norm(dim=-1), fused.slant_m)
    torch.testing.assert_close(fused.bearing_rad, (waterline.bearing_rad + box.bearing_rad) / 2, rtol=0, atol=0.01)
    apart_m, mean_std_m = (waterline.slant_m - box.slant_m) / 2, (waterline.slant_std_m + box.slant_std_m) / 2
    torch.testing.assert_close(fused.slant_std_m, torch.hypot(apart_m, mean_std_m))


def test_halfway_between_one_estimate_and_none_is_that_one():
    camera, hull = mounted(1), known_hull(1)
    pose = tuple(torch.tensor([value], dtype=torch.float64) for value in (0.0, 8.0, 0.5))
    ranges = range_boats(see(put(hull.points_m, pose, camera.height_m), camera), camera, hull)
    none = ranges.waterline._replace(
        slant_m=torch.full((1, 1), torch.inf).double(),
        slant_std_m=torch.full((1, 1), torch.inf).double(),
        valid=torch.zeros(1, 1, dtype=torch.bool),
        reason=torch.full((1, 1), Reason.HORIZON.value),
    )
    for pair in ((ranges.box_bottom, none), (none, ranges.box_bottom)):
        for found, expected in zip(halfway(*pair), ranges.box_bottom, strict=True):
            torch.testing.assert_close(found, expected, rtol=1e-6, atol=1e-9)
    nothing = halfway(none, none)
    assert not nothing.valid.any()
    assert nothing.slant_m.isinf().all()
    assert (nothing.reason == Reason.HORIZON.value).all()


def test_above_the_horizon_the_hulls_size_still_ranges():
    """The camera takes itself for level: no ray meets the water, but a boat of known size is as far as it looks."""
    camera, hull = mounted(20, pitch_rad=0.07, pitch_std_rad=0.04), known_hull(20)
    pose = (0 * uniform(20, 0, 1), uniform(20, 30.0, 40.0), uniform(20, -math.pi, math.pi))
    level = put(hull.points_m, pose, camera.height_m)
    tilted = camera._replace(pitch_rad=camera.pitch_rad - 0.07)
    ranges = range_boats(see(level, camera), tilted, hull)
    assert (ranges.waterline.reason == Reason.HORIZON.value).all()
    assert ranges.fused.valid.double().mean() > 0.8
    valid = ranges.fused.valid[:, 0]
    error_m = (ranges.fused.slant_m[:, 0] - nearest_m(level))[valid].abs()
    assert (error_m < 4 * ranges.fused.slant_std_m[valid, 0]).all()
    assert (error_m / nearest_m(level)[valid]).median() < 0.1


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_whatever_comes_in_no_nan_comes_out_or_back(dtype: torch.dtype):
    torch.manual_seed(3)
    layer = RangingLayer()
    camera = Camera(*(field[:1].to(dtype) for field in mounted(1, **STD)))
    for spread_px in (0.0, 1.0, 30.0, 1e4, math.inf):
        pixels = 640 * torch.rand(1, 50, 1, 2, dtype=dtype) + spread_px * torch.randn(1, 50, 7, 2, dtype=dtype)
        pixels.requires_grad_()
        covariance = (500 * torch.rand(1, 50, 7, 1, 1, dtype=dtype) * torch.eye(2, dtype=dtype)).requires_grad_()
        ranges = layer(pixels, covariance, torch.rand(1, 50, 4, dtype=dtype), camera)
        for estimate in (ranges.hull, ranges.fused):
            assert not any(field.isnan().any() for field in estimate)
            assert (estimate.valid == (estimate.reason == Reason.OK.value)).all()
            assert estimate.slant_m[estimate.valid].isfinite().all()
        assert not ranges.misfit.isnan().any()
        total = sum(e.slant_m[e.valid].sum() + e.slant_std_m[e.valid].sum() for e in (ranges.hull, ranges.fused))
        if bool(ranges.fused.valid.any()):
            total.backward()
            assert pixels.grad is not None
            assert pixels.grad.isfinite().all()
            assert covariance.grad is None or covariance.grad.isfinite().all()


def test_a_mirrored_world_has_mirrored_answers():
    torch.manual_seed(4)
    camera, hull = mounted(10), known_hull(10)
    pixels = see(put(hull.points_m, draw_poses(10, 5.0, 10.0), camera.height_m), camera)
    mirrored = pixels[:, [0, 2, 1, 3, 5, 4, 6]] * torch.tensor([-1.0, 1.0]) + torch.tensor([639.0, 0.0])
    one, other = (range_boats(p, camera, hull, std_px=0.01) for p in (pixels, mirrored))
    torch.testing.assert_close(other.hull.slant_m, one.hull.slant_m, rtol=1e-3, atol=0)
    torch.testing.assert_close(other.heading_rad, -one.heading_rad, rtol=0, atol=1e-2)


def test_scripted_is_eager():
    torch.manual_seed(5)
    camera, true, hull, level = scenes(6, 5.0, 15.0)
    pixels = see(level, true).nan_to_num()[:, None]
    covariance = torch.eye(2, dtype=torch.float64).expand(6, 1, 7, 2, 2)
    boxes = torch.cat([pixels.amin(2), pixels.amax(2)], -1)
    layer = RangingLayer()
    scripted = torch.jit.script(layer)
    for shape in (hull, None):
        expected, got = (one(pixels, covariance, boxes, camera, shape) for one in (layer, scripted))
        for a, b in zip((*expected.hull, *expected.fused, *expected[4:]), (*got.hull, *got.fused, *got[4:])):
            torch.testing.assert_close(a, b, rtol=1e-6, atol=1e-8)


class Exportable(torch.nn.Module):
    """The layer behind plain tensors."""

    def __init__(self) -> None:
        super().__init__()
        self.layer = RangingLayer()

    def forward(self, pixels: torch.Tensor, covariance: torch.Tensor, boxes: torch.Tensor, *camera: torch.Tensor):
        ranges = self.layer(pixels, covariance, boxes, Camera(*camera))
        return *ranges.hull, *ranges.fused, ranges.heading_rad, ranges.misfit


@pytest.mark.slow
def test_exported_is_eager():
    torch.manual_seed(6)
    camera, true, _, level = scenes(3, 5.0, 12.0)
    pixels = see(level, true).nan_to_num()[:, None]
    covariance = torch.eye(2, dtype=torch.float64).expand(3, 1, 7, 2, 2).contiguous()
    arguments = (pixels, covariance, torch.cat([pixels.amin(2), pixels.amax(2)], -1), *camera)
    eager = Exportable().eval()
    exported = torch.export.export(eager, arguments).module()
    for expected, got in zip(eager(*arguments), exported(*arguments)):
        torch.testing.assert_close(got, expected)
