"""The fit of a hull against the pose that was put in, solvePnP, and its own derivatives."""

import math

import cv2
import numpy as np
import pytest
import torch

from usvnet.geometry.camera import make_camera
from usvnet.geometry.elimination import solve_positive
from usvnet.geometry.hull_fit import HullFit, chi_squared_limit, fit_hulls
from usvnet.geometry.hull_sight import HullSight, predict_keypoints, sight_hulls
from usvnet.geometry.lens import undistort
from usvnet.types import Camera, Hull

from .boats import draw_poses, known_hull, put, repeat_camera, see

STD = {
    "focal_std_px": 3.0,
    "height_std_m": 0.02,
    "pitch_std_rad": math.radians(0.3),
    "roll_std_rad": math.radians(0.3),
    "wave_std_m": 0.02,
}


def mounted(boats: int, **std: float) -> Camera:
    K = [[700.0, 0, 319.5], [0, 695.0, 239.5], [0, 0, 1]]
    distortion = (-0.1, 0.02, 0.001, -0.001, 0.0)
    camera = make_camera(
        K, (640, 480), distortion, height_m=1.5, pitch_rad=0.1, roll_rad=0.03, dtype=torch.float64, **std
    )
    return repeat_camera(camera, boats)


def sight(
    keypoints_px: torch.Tensor, camera: Camera, hull: Hull, std_px: float = 1.0, leaning: bool = True
) -> HullSight:
    """One boat (F, 7, 2) in each of F pictures."""
    covariance = std_px**2 * torch.eye(2, dtype=keypoints_px.dtype).expand(len(keypoints_px), 1, 7, 2, 2)
    roll_std_rad, pitch_std_rad = (0.05, 0.035) if leaning else (0.0, 0.0)
    return sight_hulls(undistort(keypoints_px, camera), covariance, camera, hull, roll_std_rad, pitch_std_rad, 0.0)


def wrapped(angle: torch.Tensor) -> torch.Tensor:
    return torch.atan2(angle.sin(), angle.cos())


def test_elimination_is_linalg_solve():
    torch.manual_seed(0)
    factor = torch.randn(4, 3, 10, 10, dtype=torch.float64)
    matrix, right = factor @ factor.mT + 0.1 * torch.eye(10), torch.randn(4, 3, 10, 2, dtype=torch.float64)
    torch.testing.assert_close(solve_positive(matrix, right), torch.linalg.solve(matrix, right))


def test_a_perfect_sight_gives_the_pose_back():
    torch.manual_seed(0)
    camera, hull = mounted(200, **STD), known_hull(200, scale_std=0.1)
    pose = draw_poses(200, 3.0, 60.0)
    fit = fit_hulls(sight(see(put(hull.points_m, pose, camera.height_m), camera), camera, hull))
    right, ahead, heading = pose
    torch.testing.assert_close(fit.state[:, 0, 0].exp(), torch.hypot(right, ahead), rtol=1e-5, atol=0)
    torch.testing.assert_close(fit.state[:, 0, 1], torch.atan2(right, ahead), rtol=0, atol=1e-6)
    assert wrapped(fit.state[:, 0, 2] - heading).abs().max() < 1e-4
    assert fit.state[:, 0, 3:].abs().max() < 1e-3
    assert fit.cost.max() < 1e-4
    assert (fit.degrees_of_freedom == 11).all()


def test_the_jacobian_is_autograds():
    torch.manual_seed(0)
    camera, hull = mounted(1, **STD), known_hull(1, scale_std=0.1, point_std_m=0.01)
    seen = sight(see(put(hull.points_m, draw_poses(1, 6.0, 8.0), camera.height_m), camera), camera, hull)
    seen = seen._replace(curvature_per_m=1e-3)
    state = torch.randn(1, 1, 1, 10, dtype=torch.float64) * 0.3 + torch.tensor([2.0] + 9 * [0.0])
    by_autograd = torch.autograd.functional.jacobian(lambda s: predict_keypoints(s, seen).xy, state)
    torch.testing.assert_close(predict_keypoints(state, seen).jacobian, by_autograd[:, :, :, :, :, 0, 0, 0])


def fitted_state(keypoints_px: torch.Tensor, camera: Camera, hull: Hull) -> torch.Tensor:
    fit: HullFit = fit_hulls(sight(keypoints_px, camera, hull))
    return torch.cat([fit.state, fit.covariance.diagonal(dim1=-2, dim2=-1).sqrt()], -1)


def test_gradcheck_where_the_hull_fits():
    """The last two steps carry the gradient: exact at a perfect fit, where the residuals' curvature does not count."""
    torch.manual_seed(1)
    camera, hull = mounted(2, **STD), known_hull(2, scale_std=0.1, point_std_m=0.01)
    pixels = see(put(hull.points_m, draw_poses(2, 6.0, 12.0), camera.height_m), camera).requires_grad_()

    def outcome(pixels: torch.Tensor, pitch: torch.Tensor, height: torch.Tensor) -> torch.Tensor:
        return fitted_state(pixels, camera._replace(pitch_rad=pitch, height_m=height), hull)

    arguments = (pixels, camera.pitch_rad.clone().requires_grad_(), camera.height_m.clone().requires_grad_())
    assert torch.autograd.gradcheck(outcome, arguments, rtol=1e-3, atol=1e-5, fast_mode=True)


def test_with_noise_the_gradient_is_that_of_the_minimum():
    torch.manual_seed(2)
    camera, hull = mounted(3, **STD), known_hull(3, scale_std=0.1)
    pixels = see(put(hull.points_m, draw_poses(3, 6.0, 15.0), camera.height_m), camera)
    pixels = (pixels + torch.randn_like(pixels)).requires_grad_()
    way = torch.randn_like(pixels)
    fit_hulls(sight(pixels, camera, hull)).state[..., :4].sum().backward()
    step = 1e-5

    def settled(pixels: torch.Tensor) -> torch.Tensor:
        with torch.no_grad():
            return fit_hulls(sight(pixels, camera, hull), 30).state[..., :4].sum()

    expected = (settled(pixels + step * way) - settled(pixels - step * way)) / (2 * step)
    assert pixels.grad is not None
    assert float((pixels.grad * way).sum()) == pytest.approx(float(expected), rel=0.01)


def test_it_is_what_solvepnp_finds_when_nothing_is_known_beforehand_and_better_when_something_is():
    """cv2.solvePnP (iterative) has six free numbers; ours has the water under the boat."""
    torch.manual_seed(3)
    boats = 60
    camera, hull = mounted(boats), known_hull(boats)
    pose = draw_poses(boats, 5.0, 12.0)
    level = put(hull.points_m, pose, camera.height_m)
    pixels = see(level, camera)
    pixels = pixels + torch.randn_like(pixels)
    truth = torch.hypot(pose[0], pose[1])
    ours = fit_hulls(sight(pixels, camera, hull, leaning=False)).state[:, 0, 0].exp()

    loose = camera._replace(
        pitch_std_rad=camera.pitch_std_rad + 10,
        roll_std_rad=camera.roll_std_rad + 10,
        height_std_m=camera.height_std_m + 100,
    )
    free = fit_hulls(sight(pixels, loose, hull, leaning=False), 12)
    K, lens = camera.K[0].numpy(), camera.distortion[0].numpy()
    theirs, costs = [], []
    for i in range(boats):
        points, seen = hull.points_m[i].numpy(), pixels[i].numpy()
        guess = np.array([[float(pose[0][i])], [1.0], [float(pose[1][i])]])
        found = []
        for turn in range(8):
            s, c = math.sin(turn * math.pi / 4), math.cos(turn * math.pi / 4)
            axes = cv2.Rodrigues(np.array([[s, -c, 0], [0, 0, -1], [c, s, 0]]))[0]
            _, axes, place = cv2.solvePnP(points, seen, K, lens, axes, guess.copy(), useExtrinsicGuess=True)
            miss = cv2.projectPoints(points, axes, place, K, lens)[0][:, 0] - seen
            found.append((float((miss**2).sum()), float(np.linalg.norm(place))))
        cost, distance_m = min(found)
        costs.append(cost)
        theirs.append(math.sqrt(max(distance_m**2 - 1.5**2, 0.0)))
    theirs_m = torch.tensor(theirs, dtype=torch.float64)
    plain = (free.weight[:, 0] == 1).all(-1)  # no keypoint is far off, so ours is a plain sum of squares too
    assert plain.sum() > 30
    gap = (free.cost[plain, 0] / torch.tensor(costs, dtype=torch.float64)[plain] - 1).abs()
    assert float(gap.quantile(0.9)) < 0.03

    def rms(range_m: torch.Tensor) -> float:
        return float((range_m / truth - 1).square().mean().sqrt())

    assert rms(ours) < 0.5 * rms(theirs_m)


def test_sigmas_are_those_of_monte_carlo_and_the_cost_is_a_chi_squared():
    torch.manual_seed(4)
    boats = 2000
    camera, hull = mounted(boats), known_hull(boats)
    pose = tuple(value[:1].expand(boats) for value in draw_poses(1, 8.0, 10.0))
    pixels = see(put(hull.points_m, pose, camera.height_m), camera)
    fit = fit_hulls(sight(pixels + torch.randn_like(pixels), camera, hull, leaning=False))
    for i in (0, 1, 2):
        assert float(fit.state[:, 0, i].std()) == pytest.approx(
            float(fit.covariance[:, 0, i, i].mean().sqrt()), rel=0.06
        )
    assert float(fit.cost.mean()) == pytest.approx(11, rel=0.05)
    torch.testing.assert_close(chi_squared_limit(torch.tensor([11.0])), torch.tensor([24.72]), rtol=0.003, atol=0)


def test_one_wrong_keypoint_loses_its_say():
    torch.manual_seed(5)
    camera, hull = mounted(300, **STD), known_hull(300)
    pixels = see(put(hull.points_m, draw_poses(300, 5.0, 12.0), camera.height_m), camera)
    pixels = pixels + torch.randn_like(pixels)
    clean = fit_hulls(sight(pixels, camera, hull))
    which, angle = torch.randint(0, 7, (300,)), torch.rand(300, dtype=torch.float64) * 2 * math.pi
    spoiled = pixels.clone()
    spoiled[torch.arange(300), which] += 40 * torch.stack([angle.cos(), angle.sin()], -1)
    fit = fit_hulls(sight(spoiled, camera, hull))
    assert float(fit.weight[torch.arange(300), 0, which].quantile(0.95)) < 0.01
    moved = (fit.state - clean.state)[:, 0, 0].abs() / clean.covariance[:, 0, 0, 0].sqrt()
    assert float(moved.quantile(0.9)) < 1.5


def test_scripted_is_eager():
    torch.manual_seed(6)
    camera, hull = mounted(5, **STD), known_hull(5, scale_std=0.1, point_std_m=0.01)
    pixels = see(put(hull.points_m, draw_poses(5, 5.0, 20.0), camera.height_m), camera)
    pixels = pixels + torch.randn_like(pixels)
    seen = sight(pixels, camera, hull)
    for expected, got in zip(fit_hulls(seen), torch.jit.script(fit_hulls)(seen)):
        torch.testing.assert_close(got, expected, rtol=1e-6, atol=1e-8)
