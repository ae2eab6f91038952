"""The horizon found in drawn pictures whose attitude is known, and refused where there is none."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from usvnet.data.horizon_detector import Sight, find_horizon
from usvnet.data.pictures import Picture, read_picture
from usvnet.geometry.camera import make_camera, with_attitude
from usvnet.geometry.camera_files import load_camera
from usvnet.geometry.rays import level_rays
from usvnet.geometry.water import horizon_dip_rad
from usvnet.types import Camera

SIZE_PX = (320, 240)
SKY, WATER, LAND = (190.0, 200, 215), (90.0, 105, 110), (50.0, 60, 40)
PITCH_DEG, ROLL_DEG = 4.0, 2.0


def mounted(distortion: tuple[float, ...] = (-0.25, 0.08, 0.001, -0.001)) -> Camera:
    return make_camera(
        [[300.0, 0, 161], [0, 300, 118], [0, 0, 1]],
        SIZE_PX,
        distortion,
        height_m=2.0,
        pitch_rad=math.radians(PITCH_DEG),
        roll_rad=math.radians(ROLL_DEG),
        height_std_m=0.02,
        pitch_std_rad=math.radians(1),
        roll_std_rad=math.radians(1),
        dtype=torch.float64,
    )


def drawn(camera: Camera, seed: int = 0, noise: float = 2.0, shore_m: float = math.inf, fog_px: float = 0.7) -> Picture:
    """Sky over water, with waves as noise; with a wooded shore, or an edge that fog spreads over ``fog_px`` rows."""
    rng = np.random.default_rng(seed)
    width, height = SIZE_PX
    v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    rays = level_rays(torch.stack([u, v], -1).reshape(1, -1, 2).double(), camera)[0]
    depression = torch.asin(rays[:, 1]).reshape(height, width).numpy()
    focal = camera.K[0, 1, 1].item()

    def below(angle_rad: float) -> np.ndarray:
        step = (depression - angle_rad) * focal / fog_px
        return 1 / (1 + np.exp(-3.4 * step.clip(-50, 50)))[..., None]

    dip, height_m = horizon_dip_rad(camera.height_m).item(), camera.height_m.item()
    water = below(dip)
    picture = np.array(SKY) * (1 - water) + np.array(WATER) * water
    if math.isfinite(shore_m):
        foot = height_m / shore_m
        azimuth = torch.atan2(rays[:, 0], rays[:, 2]).reshape(height, width).numpy()
        trees = np.interp(azimuth, np.linspace(-1, 1, 90), rng.uniform(2, 9, 90))
        land = (depression < foot) & (depression > foot - trees / shore_m)
        picture[land] = np.array(LAND) + rng.normal(0, 12, (int(land.sum()), 1))
    return (picture + rng.normal(0, noise, picture.shape)).clip(0, 255).astype(np.uint8)


def errors_deg(sight: Sight, true: Camera) -> tuple[float, float]:
    assert sight.attitude is not None, sight.reason
    return (
        math.degrees(sight.attitude.pitch_rad.item() - true.pitch_rad.item()),
        math.degrees(sight.attitude.roll_rad.item() - true.roll_rad.item()),
    )


@pytest.mark.parametrize("distortion", [(0.0, 0, 0, 0), (-0.25, 0.08, 0.001, -0.001), (0.1, 0, 0, 0)])
@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0.0, 0.0), (2.5, -2.0), (-2.5, 2.5)])
def test_a_horizon_off_from_the_mount_is_found(distortion, pitch_deg, roll_deg):
    mount = mounted(distortion)
    true = with_attitude(mount, math.radians(PITCH_DEG + pitch_deg), math.radians(ROLL_DEG + roll_deg))
    pitch, roll = errors_deg(find_horizon(drawn(true), mount), true)
    assert abs(pitch) < 0.04  # 0.2 px
    assert abs(roll) < 0.04


@pytest.mark.parametrize("noise", [1.0, 12.0])
def test_its_sigmas_cover_its_errors(noise):
    mount = mounted()
    for seed in range(6):
        rng = np.random.default_rng(seed)
        true = with_attitude(mount, *np.radians(np.array([PITCH_DEG, ROLL_DEG]) + rng.uniform(-2, 2, 2)))
        sight = find_horizon(drawn(true, seed, noise), mount)
        pitch, roll = errors_deg(sight, true)
        assert abs(pitch) < 3 * math.degrees(sight.attitude.pitch_std_rad.item()) < 0.4
        assert abs(roll) < 3 * math.degrees(sight.attitude.roll_std_rad.item()) < 0.4


def test_a_boat_and_a_mast_in_the_way_do_not_move_it():
    mount = mounted()
    picture = drawn(mount)
    clear = find_horizon(picture, mount)
    picture[60:200, 100:170] = (30, 20, 160)
    picture[:, 250:253] = 0
    hidden = find_horizon(picture, mount)
    assert errors_deg(hidden, mount) == pytest.approx(errors_deg(clear, mount), abs=0.03)


def test_the_prior_says_where_to_search_and_nothing_else():
    true = mounted()
    picture = drawn(true)
    other = with_attitude(true, math.radians(PITCH_DEG + 1), math.radians(ROLL_DEG - 1))
    assert errors_deg(find_horizon(picture, other), true) == pytest.approx(
        errors_deg(find_horizon(picture, true), true), abs=0.01
    )


@pytest.mark.parametrize("shore_m", [40.0, 100.0, 300.0])
def test_a_shore_is_not_the_horizon(shore_m):
    for seed in range(3):
        sight = find_horizon(drawn(mounted(), seed, shore_m=shore_m), mounted())
        assert sight.attitude is None
        assert sight.reason in ("shore", "crooked", "faint")


def test_fog_and_haze_are_refused():
    for fog_px, reasons in ((120, {"faint", "crooked"}), (9, {"hazy", "crooked", "faint"})):
        sight = find_horizon(drawn(mounted(), fog_px=fog_px), mounted())
        assert sight.attitude is None
        assert sight.reason in reasons
    grey = np.full((SIZE_PX[1], SIZE_PX[0], 3), 128, np.uint8)
    assert find_horizon(grey, mounted()).reason == "faint"


def test_a_softer_edge_has_a_larger_sigma():
    sharp, soft = (find_horizon(drawn(mounted(), fog_px=px), mounted()).attitude for px in (0.7, 4.5))
    assert soft.pitch_std_rad.item() > 1.5 * sharp.pitch_std_rad.item()


def test_a_camera_that_looks_at_its_feet_sees_none():
    low = with_attitude(mounted(), math.radians(50), 0.0)
    assert find_horizon(drawn(low), low).reason in ("outside", "faint")


@pytest.mark.parametrize(
    ("reason", "images"),
    [
        ("", ["train/0024.jpg", "train/0067.jpg", "val/0036.jpg", "train/0348.jpg"]),
        ("land", ["train/0062.jpg", "train/0216.jpg", "train/0732.jpg", "test/0918.jpg"]),
        ("fog", ["train/0004.jpg", "val/0005.jpg"]),
    ],
)
def test_rendered_pictures(sixscenes: Path, reason: str, images: list[str]):
    """Open sea, shores that look like a horizon, and fog of the six scenes, under a mount that sways."""
    with (sixscenes / "frames.csv").open(newline="") as stream:
        rows = {row["image"]: row for row in csv.DictReader(stream)}
    for image in images:
        row = rows[image]
        camera = load_camera(sixscenes / "cameras" / f"{row['camera']}.yaml")
        sway = {"pitch_std_rad": torch.tensor([math.radians(0.6)]), "roll_std_rad": torch.tensor([math.radians(0.8)])}
        sight = find_horizon(read_picture(sixscenes / "images" / image), camera._replace(**sway))
        if reason:
            assert sight.attitude is None, image
        else:
            angles = (math.radians(float(row[f"true_{name}_deg"])) for name in ("pitch", "roll"))
            pitch, roll = errors_deg(sight, with_attitude(camera, *angles))
            assert abs(pitch) < 0.1, image
            assert abs(roll) < 0.1, image
