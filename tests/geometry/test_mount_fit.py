"""Mounts found from synthetic readings, within the sigmas that are stated for them."""

import math

import pytest
import torch

from usvnet.geometry import mount_fit
from usvnet.geometry.camera import project, with_attitude
from usvnet.geometry.horizon import edge_px
from usvnet.geometry.mount_fit import fit_mount
from usvnet.geometry.mount_readings import MountReading
from usvnet.geometry.ranging import RangingLayer
from usvnet.geometry.rays import level_rotation
from usvnet.geometry.water import horizon_dip_rad
from usvnet.types import Camera

TRUE_HEIGHT_M, TRUE_PITCH_DEG, TRUE_ROLL_DEG, TRUE_HEADING_DEG = 1.62, 6.7, -1.3, 40.0
PIXELS = [(60, 460), (560, 440), (320, 330), (90, 280), (600, 300), (330, 240)]


@pytest.fixture
def camera(camera: Camera) -> Camera:
    """The shared one with a lens that is known exactly, on calm water."""
    return camera._replace(wave_std_m=0 * camera.wave_std_m, focal_std_px=0 * camera.focal_std_px)


@pytest.fixture
def true(camera: Camera) -> Camera:
    camera = camera._replace(height_m=torch.tensor([TRUE_HEIGHT_M], dtype=torch.float64))
    return with_attitude(camera, math.radians(TRUE_PITCH_DEG), math.radians(TRUE_ROLL_DEG))


def ranged(true: Camera, generator: torch.Generator | None = None, range_std_m: float = 0.03) -> list[MountReading]:
    """Ranges to points on the curved water at PIXELS, and what was picked and read of them."""
    points = torch.tensor([PIXELS], dtype=torch.float64)
    exact = RangingLayer(curved_water=True).range_points(points, torch.zeros(1, len(PIXELS), 2, 2).double(), true)
    assert exact.valid.all()
    slant = exact.slant_m[0]
    if generator is not None:
        points = points + torch.randn(points.shape, generator=generator, dtype=torch.float64)
        slant = slant + range_std_m * torch.randn(slant.shape, generator=generator, dtype=torch.float64)
    rows = zip(points[0].tolist(), slant.tolist())
    return [MountReading(i + 2, "", "range", u, v, r, range_std_m) for i, ((u, v), r) in enumerate(rows)]


def surveyed(true: Camera, generator: torch.Generator | None = None) -> list[MountReading]:
    """Points 20 to 60 m away and 0 to 5 m above the water, in a survey that knows nothing of the camera's heading."""
    places = torch.tensor([[-6.0, 0, 20], [9, 2, 30], [-12, 5, 45], [15, 1, 60]], dtype=torch.float64)
    level = torch.stack([places[:, 0], TRUE_HEIGHT_M - places[:, 1], places[:, 2]], -1)
    in_camera = level @ level_rotation(true.pitch_rad, true.roll_rad)[0]
    pixels = project(in_camera[None], true)[0]
    if generator is not None:
        pixels = pixels + torch.randn(pixels.shape, generator=generator, dtype=torch.float64)
    c, s = math.cos(math.radians(TRUE_HEADING_DEG)), math.sin(math.radians(TRUE_HEADING_DEG))
    rows = zip(pixels.tolist(), places.tolist())
    return [
        MountReading(i + 2, "", "point", u, v, right_m=c * x + s * z, forward_m=c * z - s * x, up_m=up)
        for i, ((u, v), (x, up, z)) in enumerate(rows)
    ]


def horizon(true: Camera, generator: torch.Generator | None = None) -> list[MountReading]:
    pixels = edge_px(true, horizon_dip_rad(true.height_m), torch.tensor([[-0.3, 0.3]], dtype=torch.float64))[0]
    if generator is not None:
        pixels = pixels + torch.randn(pixels.shape, generator=generator, dtype=torch.float64)
    return [MountReading(i + 2, "", "horizon", u, v) for i, (u, v) in enumerate(pixels.tolist())]


def mount(camera: Camera) -> list[float]:
    return [camera.height_m.item(), math.degrees(camera.pitch_rad.item()), math.degrees(camera.roll_rad.item())]


def stds(camera: Camera) -> list[float]:
    return [
        camera.height_std_m.item(),
        math.degrees(camera.pitch_std_rad.item()),
        math.degrees(camera.roll_std_rad.item()),
    ]


@pytest.mark.parametrize("sources", [(ranged,), (surveyed,), (ranged, horizon), (ranged, surveyed, horizon)])
def test_exact_readings_give_back_the_mount(camera, true, sources):
    """From the camera fixture's own mount, 0.12 m, 0.7 and 4.3 degrees off."""
    readings = [reading for source in sources for reading in source(true)]
    fit = fit_mount(readings, camera, priors=False)
    assert mount(fit.camera) == pytest.approx([TRUE_HEIGHT_M, TRUE_PITCH_DEG, TRUE_ROLL_DEG], abs=2e-4)
    assert fit.chi_squared < 1e-3
    assert fit.inflation == 1
    torch.testing.assert_close(fit.camera.K, camera.K)


def test_the_jacobian_is_autograds(camera, true):
    readings = ranged(true) + surveyed(true) + horizon(true)
    sights = mount_fit._look(readings, camera)
    state = torch.tensor([1.5, 0.1, -0.2, 0.7], dtype=torch.float64)
    by_autograd = torch.autograd.functional.jacobian(lambda s: mount_fit._misses(s, readings, sights)[0], state)
    torch.testing.assert_close(mount_fit._misses(state, readings, sights)[1], by_autograd, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("sources", [(ranged,), (ranged, surveyed, horizon)])
def test_errors_are_as_large_as_the_sigmas_say(camera, true, sources):
    scores, chi = [], []
    for seed in range(40):
        generator = torch.Generator().manual_seed(seed)
        readings = [reading for source in sources for reading in source(true, generator)]
        fit = fit_mount(readings, camera, priors=False)
        truth = (TRUE_HEIGHT_M, TRUE_PITCH_DEG, TRUE_ROLL_DEG)
        scores.append([(a - b) / s for a, b, s in zip(mount(fit.camera), truth, stds(fit.camera))])
        chi.append(fit.chi_squared / fit.degrees_of_freedom)
    scores = torch.tensor(scores)
    # 120 scores, not all independent: within 1 sigma 68 %, within 2 sigma 95 %
    assert 0.55 < (scores.abs() < 1).double().mean().item() < 0.81
    assert (scores.abs() < 2).double().mean().item() > 0.89
    assert sum(chi) / len(chi) == pytest.approx(1, abs=0.3)


def test_priors_count_by_their_sigmas(camera, true):
    """One range alone fixes a mixture of height and pitch; the priors share it out by their variances."""
    reading = ranged(true)[2]
    start = camera._replace(roll_rad=true.roll_rad)
    fit = fit_mount([reading], start)
    moved = [a - b for a, b in zip(mount(fit.camera), mount(start))]
    assert abs(moved[1]) > 10 * abs(
        moved[0]
    )  # 0.02 m of height are worth 0.1 degrees at this range, pitch is free to 0.3
    assert fit.residuals.abs().max() < 2
    assert stds(fit.camera)[0] < stds(camera)[0]
    assert stds(fit.camera)[2] == pytest.approx(stds(camera)[2], rel=1e-3)  # in the middle column, roll does nothing


def test_what_is_held_keeps_its_value_and_its_sigma_counts(camera, true):
    near = [reading for reading in ranged(true) if reading.range_m < 10]
    start = camera._replace(height_m=true.height_m)
    fit = fit_mount(near, start, hold=["height"], priors=False)
    assert mount(fit.camera) == pytest.approx([TRUE_HEIGHT_M, TRUE_PITCH_DEG, TRUE_ROLL_DEG], abs=2e-4)
    assert fit.camera.height_std_m.item() == camera.height_std_m.item()
    certain = fit_mount(near, start._replace(height_std_m=0 * start.height_std_m), hold=["height"], priors=False)
    wrong = fit_mount(near, start._replace(height_m=start.height_m + 0.02), hold=["height"], priors=False)
    shift = wrong.camera.pitch_rad - fit.camera.pitch_rad  # of a height that is wrong by its sigma
    expected = torch.hypot(certain.camera.pitch_std_rad, shift)
    torch.testing.assert_close(fit.camera.pitch_std_rad, expected, rtol=0.02, atol=0)


def test_a_focal_length_that_is_not_known_exactly_counts(camera, true):
    certain = fit_mount(ranged(true), camera, priors=False)
    doubted = fit_mount(ranged(true), camera._replace(focal_std_px=camera.focal_std_px + 10.0), priors=False)
    wrong = camera._replace(K=camera.K.clone())
    wrong.K[:, [0, 1], [0, 1]] *= 1 + 10.0 / camera.K[:, 1, 1]
    shifted = fit_mount(ranged(true), wrong, priors=False)
    for name in ("height", "pitch"):
        moved = getattr(shifted.camera, f"{name}_{'m' if name == 'height' else 'rad'}")
        moved = moved - getattr(certain.camera, f"{name}_{'m' if name == 'height' else 'rad'}")
        std = f"{name}_std_{'m' if name == 'height' else 'rad'}"
        assert moved.abs() > getattr(certain.camera, std) / 2
        expected = torch.hypot(getattr(certain.camera, std), moved)
        torch.testing.assert_close(getattr(doubted.camera, std), expected, rtol=0.05, atol=0)


@pytest.mark.parametrize("guess_m", [0.3, 5.0])
def test_a_height_that_was_guessed_badly_is_found(camera, true, guess_m):
    readings = [reading for reading in ranged(true) if reading.range_m > guess_m / 2]
    fit = fit_mount(readings, camera._replace(height_m=torch.full_like(camera.height_m, guess_m)), priors=False)
    assert mount(fit.camera) == pytest.approx([TRUE_HEIGHT_M, TRUE_PITCH_DEG, TRUE_ROLL_DEG], abs=2e-4)


def test_a_slip_of_the_pen_is_no_mount(camera, true):
    readings = ranged(true)
    slipped = [*readings[:3], readings[3]._replace(range_m=readings[3].range_m / 10), *readings[4:]]
    assert slipped[3].range_m < TRUE_HEIGHT_M
    known = camera._replace(height_m=true.height_m, height_std_m=0 * camera.height_std_m + 0.02)
    with pytest.raises(ValueError, match=r"line 5: range_m is 0\.9.*, expected more than 1\.56: the camera is 1\.62 m"):
        fit_mount(slipped, known)


def test_readings_worse_than_they_claim_inflate_the_sigmas(camera, true):
    readings = ranged(true, torch.Generator().manual_seed(1))
    boast = [reading._replace(pixel_std_px=0.1, range_std_m=0.003) for reading in readings]  # a tenth
    honest, boasting = (fit_mount(rows, camera, priors=False) for rows in (readings, boast))
    assert honest.inflation == 1
    assert boasting.probability < 0.01
    assert boasting.inflation == pytest.approx(math.sqrt(boasting.chi_squared / boasting.degrees_of_freedom))
    scatter = math.sqrt(honest.chi_squared / honest.degrees_of_freedom)
    assert stds(boasting.camera) == pytest.approx([std * scatter for std in stds(honest.camera)], rel=1e-3)


def test_height_and_pitch_errors_go_together(camera, true):
    near = [reading for reading in ranged(true) if reading.range_m < 12]
    assert abs(fit_mount(near, camera, priors=False).correlation) > 0.9


@pytest.mark.parametrize(
    ("choose", "hold", "words"),
    [
        (lambda true: [ranged(true)[2]] * 4, ["roll"], "cannot tell height and pitch apart: add ranges at other"),
        (lambda true: [ranged(true)[2]] * 4, ["height", "pitch"], "do not say the roll: add readings near the left"),
        (lambda true: horizon(true), [], "do not say the height: add ranges"),
        (lambda true: ranged(true), ["height", "pitch", "roll"], "all held fixed"),
    ],
)
def test_what_cannot_be_found_is_said(camera, true, choose, hold, words):
    readings = choose(true)
    if hold == ["height", "pitch"]:  # in the middle column
        readings = [reading._replace(u_px=322.0) for reading in readings]
    with pytest.raises(ValueError, match=words):
        fit_mount(readings, camera, hold, priors=False)


def test_pixels_and_ranges_that_cannot_be_are_named(camera, true):
    good = ranged(true)
    with pytest.raises(ValueError, match=r"line 9: pixel \(700, 100\) is outside the camera's 640 x 480 picture"):
        fit_mount([*good, MountReading(9, "", "horizon", 700, 100)], camera)
    with pytest.raises(ValueError, match=r"line 9: range_m is 0.5, expected more than .* the camera is"):
        fit_mount([*good, MountReading(9, "", "range", 300, 400, 0.5)], camera)
