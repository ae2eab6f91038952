import math
from collections import Counter
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import torch

from usvnet.geometry.camera import project
from usvnet.simulator.draw_boats import OUTLINE
from usvnet.simulator.frame_spec import BoatSpec, FrameSpec
from usvnet.simulator.scenario import Scenario
from usvnet.simulator.settings import SimulatorSettings, load_settings

CONFIGS = Path(__file__).resolve().parents[2] / "configs" / "simulator"
DRAWS = 2000


def settings_of(name: str) -> SimulatorSettings:
    return load_settings(CONFIGS / f"{name}.yaml")


def draw(settings: SimulatorSettings, count: int | None = None) -> list[FrameSpec]:
    scenario = Scenario(settings)
    return [scenario.frame(number) for number in range(count or scenario.total)]


@pytest.fixture(scope="module")
def diverse() -> list[FrameSpec]:
    return draw(settings_of("diverse"), DRAWS)


@pytest.fixture(scope="module")
def paper() -> list[FrameSpec]:
    return draw(settings_of("paper"))


@pytest.fixture(scope="module")
def shift() -> list[FrameSpec]:
    return draw(settings_of("shift"))


def distance_m(boat: BoatSpec) -> float:
    return math.hypot(boat.x_m, boat.y_m)


def same(a: FrameSpec, b: FrameSpec) -> bool:
    cameras = all(torch.equal(one, other) for one, other in zip(a.camera, b.camera))
    return cameras and replace(a, camera=b.camera) == b


def outline_px(frame: FrameSpec, boat: BoatSpec) -> np.ndarray:
    """Pixels (8, 2) of a box around the boat, by the camera's own projection and the conventions of usvnet.types."""
    c, s = math.cos(boat.yaw_rad), math.sin(boat.yaw_rad)
    forward, port, up = (OUTLINE * boat.hull.length_m).T
    x, y, z = boat.x_m + c * forward - s * port, boat.y_m + s * forward + c * port, up
    level = np.stack([x, frame.camera.height_m.item() - z, y])
    pitch, roll = frame.camera.pitch_rad.item(), frame.camera.roll_rad.item()
    tilt = np.array([[1, 0, 0], [0, math.cos(pitch), math.sin(pitch)], [0, -math.sin(pitch), math.cos(pitch)]])
    turn = np.array([[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]])
    seen = (tilt @ turn).T @ level
    return project(torch.from_numpy(seen.T).unsqueeze(0), frame.camera)[0].numpy()


def test_a_number_is_a_frame(diverse):
    scenario = Scenario(settings_of("diverse"))
    for number in (1700, 3, 0):  # alone and in any order
        assert same(scenario.frame(number), diverse[number])
    assert not same(replace(diverse[4], number=3), diverse[3])
    other = Scenario(replace(settings_of("diverse"), seed=99))
    assert not same(other.frame(3), diverse[3])


def test_splits_have_their_frames(paper):
    assert Counter(frame.split for frame in paper) == {"train": 712, "val": 284, "test": 76}
    assert [frame.number for frame in paper] == list(range(1072))
    with pytest.raises(IndexError, match="frame 1072 of 1072"):
        Scenario(settings_of("paper")).frame(1072)


def test_scenes_and_lasers_are_as_many_as_asked_in_every_split(paper, diverse):
    for split, share in (("train", 0.3), ("val", 0.9), ("test", 1.0)):
        frames = [frame for frame in paper if frame.split == split]
        counts = Counter(frame.scene for frame in frames)
        assert set(counts) == {"I", "II", "III", "IV", "V", "VI"}
        assert all(abs(count - len(frames) / 6) <= 3 for count in counts.values())
        assert np.mean([frame.has_laser for frame in frames]) == pytest.approx(share, abs=0.06)
    shares = {scene: count / DRAWS for scene, count in Counter(frame.scene for frame in diverse).items()}
    expected = {"sun": 3 / 8.5, "overcast": 2 / 8.5, "dim": 2 / 8.5, "fog": 1.5 / 8.5}
    assert shares == pytest.approx(expected, abs=0.01)


def test_boats_per_frame_are_as_asked(diverse):
    counts = Counter(len(frame.boats) for frame in diverse)
    shares = [counts[i] / DRAWS for i in range(4)]
    assert shares == pytest.approx([0.08, 0.72, 0.15, 0.05], abs=0.03)
    assert not any(frame.has_laser for frame in diverse if not frame.boats)
    moving = [boat.speed_mps > 0 for frame in diverse for boat in frame.boats]
    assert np.mean(moving) == pytest.approx(0.5, abs=0.04)


def test_distances_are_as_asked(diverse, paper):
    first = [distance_m(frame.boats[0]) for frame in diverse if frame.boats]
    doublings = (np.log(first) - math.log(3)) / (math.log(100) - math.log(3))
    histogram = np.histogram(doublings, bins=5, range=(0, 1))[0] / len(first)
    assert histogram == pytest.approx(np.full(5, 0.2), abs=0.035)
    for frame in paper:
        low, high = (4.5, 7) if frame.scene in ("I", "III", "V") else (8.5, 15)
        assert low <= distance_m(frame.boats[0]) <= high


def test_boats_appear_in_a_fitting_size(diverse):
    for frame in diverse:
        for boat in frame.boats:
            slant_m = math.hypot(distance_m(boat), frame.camera.height_m.item())
            assert 14 - 1e-6 <= boat.hull.length_m * frame.camera.K[0, 0, 0].item() / slant_m <= 480 + 1e-6


@pytest.mark.parametrize("name", ["paper", "diverse", "shift", "mine"])
@pytest.mark.parametrize("truncated", [False, True])
def test_boats_are_whole_in_the_picture_or_cut_by_its_side(name, truncated):
    settings = settings_of(name)
    boats = replace(settings.boats, truncated_share=float(truncated))
    for frame in draw(replace(settings, boats=boats), 60):
        width, height = frame.camera.size_px[0].tolist()
        for boat in frame.boats:
            u, v = outline_px(frame, boat).T
            assert v.min() >= 0
            assert v.max() <= height - 1
            if truncated:
                assert (u.min() < -0.5 < u.max()) or (u.min() < width - 0.5 < u.max())
            else:
                assert u.min() >= 0
                assert u.max() <= width - 1


def test_the_share_of_truncated_boats_is_as_asked(diverse):
    edges = [
        (outline_px(frame, boat)[:, 0], frame.camera.size_px[0, 0].item()) for frame in diverse for boat in frame.boats
    ]
    cut = [u.min() < -0.5 or u.max() > width - 0.5 for u, width in edges]
    assert np.mean(cut) == pytest.approx(0.08, abs=0.02)


def test_nothing_overlaps(diverse, shift):
    for frame in [*diverse, *shift]:
        for a, b in combinations(frame.boats, 2):
            lengths = (a.hull.length_m, b.hull.length_m)
            assert math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) >= sum(lengths) / 2 + max(lengths) - 1e-9
        for thing in frame.clutter:
            for boat in frame.boats:
                gap_m = math.hypot(thing.x_m - boat.x_m, thing.y_m - boat.y_m)
                assert gap_m >= 1.5 * boat.hull.length_m + thing.size_m - 1e-9
        for one, other in combinations(frame.clutter, 2):
            assert math.hypot(one.x_m - other.x_m, one.y_m - other.y_m) >= one.size_m + other.size_m
        if frame.shore.kind != "none":
            assert all(frame.shore.distance_m > distance_m(boat) + boat.hull.length_m for boat in frame.boats)


def test_light_water_and_air_stay_in_their_ranges(diverse):
    settings = settings_of("diverse")
    for frame in diverse:
        scene = settings.scenes[frame.scene]
        assert frame.sky.kind in {sky.kind for sky in scene.skies}
        assert scene.exposure.key.low <= frame.sensor.exposure_key <= scene.exposure.key.high
        assert frame.sea.slope_std <= scene.sea.slope_std.high
        if frame.scene == "fog" and frame.boats:
            assert 3 <= frame.air.visibility_m / distance_m(frame.boats[0]) <= 8.5
    calm = [frame.sea.slope_std <= 0.02 for frame in diverse if frame.scene != "fog"]
    assert np.mean(calm) == pytest.approx(0.12, abs=0.03)
    rain = [frame.air.rain_mm_h > 0 for frame in diverse if frame.scene == "overcast"]
    assert np.mean(rain) == pytest.approx(0.3, abs=0.07)


def test_glint_is_ahead_and_low_as_often_as_asked(paper):
    sunny = [frame.sky for frame in paper if frame.scene in ("I", "II")]
    half, bottom = math.atan(320 / 880), math.radians(6) + math.atan(320 / 880)
    glinting = [abs(sky.sun_azimuth_rad) < 1.1 * half and sky.sun_elevation_rad < bottom for sky in sunny]
    assert np.mean(glinting) == pytest.approx(0.6, abs=0.1)


def test_the_camera_strays_as_its_file_says_and_the_imu_knows(diverse):
    nominal = Scenario(settings_of("diverse")).cameras()
    strays, errors = [], []
    for frame in diverse:
        camera = nominal[frame.camera_name]
        strays.append(((frame.camera.pitch_rad - camera.pitch_rad) / camera.pitch_std_rad).item())
        error_deg = frame.measured_pitch_deg - math.degrees(frame.camera.pitch_rad.item())
        errors.append(error_deg / frame.attitude_std_deg)
        assert camera.pitch_rad.dtype == torch.float32
        assert frame.camera.K.dtype == torch.float64
    assert np.std(strays) == pytest.approx(1, abs=0.06)
    assert np.std(errors) == pytest.approx(1, abs=0.06)


def test_without_an_imu_the_mount_is_what_is_known():
    settings = settings_of("diverse")
    cameras = {name: replace(camera, imu_std_deg=None) for name, camera in settings.cameras.items()}
    scenario = Scenario(replace(settings, cameras=cameras))
    for frame in (scenario.frame(number) for number in range(20)):
        camera = scenario.cameras()[frame.camera_name]
        assert frame.measured_pitch_deg == pytest.approx(math.degrees(camera.pitch_rad.item()))
        assert frame.attitude_std_deg is None


def test_only_the_camera_that_turns_has_a_shutter(diverse, paper):
    assert all(frame.shutter.exposure_s == 0 and frame.shutter.pitch_rate_rad_s == 0 for frame in paper)
    assert {frame.shutter.readout_s for frame in diverse if frame.camera_name == "rolling"} == {0.025}
    rates = [frame.shutter.yaw_rate_rad_s for frame in diverse if frame.camera_name == "rolling"]
    assert np.std(rates) == pytest.approx(math.radians(8), rel=0.2)


def test_paper_is_one_boat_before_one_camera_that_never_moves(paper):
    assert {boat.hull for frame in paper for boat in frame.boats} == set(
        Scenario(settings_of("paper")).hulls().values()
    )
    assert len({(boat.hull, boat.paint_seed) for frame in paper for boat in frame.boats}) == 1
    assert all(len(frame.boats) == 1 for frame in paper)
    for frame in paper:
        assert frame.camera.K[0].tolist() == [[880, 0, 319.5], [0, 880, 319.5], [0, 0, 1]]
        assert frame.camera.height_m.item() == 1.5
        assert frame.camera.pitch_rad.item() == pytest.approx(math.radians(6))
        assert math.radians(frame.measured_pitch_deg) == pytest.approx(frame.camera.pitch_rad.item(), abs=1e-12)


def test_diverse_is_diverse(diverse):
    boats = [boat for frame in diverse for boat in frame.boats]
    assert {boat.hull.family for boat in boats} == {"mono", "survey", "patrol", "catamaran", "rib"}
    assert len({boat.hull.name for boat in boats}) == 84
    assert len({boat.paint_seed for boat in boats}) == len(boats)
    cameras = Scenario(settings_of("diverse")).cameras()
    assert {frame.camera_name for frame in diverse} == set(cameras)
    hfov_deg = [math.degrees(2 * math.atan(320 / camera.K[0, 0, 0].item())) for camera in cameras.values()]
    assert min(hfov_deg) < 42
    assert max(hfov_deg) > 65
    assert any(not frame.boats and frame.clutter for frame in diverse)


def test_shift_shows_what_diverse_never_does(diverse, shift):
    tags: dict[str, list[FrameSpec]] = {}
    for frame in shift:
        tags.setdefault(frame.scene, []).append(frame)
    assert {frame.split for frame in shift} == {"test"}
    assert set(tags) == {"shift-hull", "shift-sky", "shift-water", "shift-distance", "shift-all"}
    families = {boat.hull.family for frame in diverse for boat in frame.boats}
    colours = {tuple(colour) for scene in settings_of("diverse").scenes.values() for colour in scene.sea.colours_rgb}
    for tag, frames in tags.items():
        boats = [boat for frame in frames for boat in frame.boats]
        hulls = {boat.hull.family for boat in boats}
        assert not hulls & families if tag in ("shift-hull", "shift-all") else hulls <= families
        far = [distance_m(boat) > 100 for boat in boats]
        assert all(far) if tag in ("shift-distance", "shift-all") else not any(far)
        low = [f.sky.kind == "clear" and math.degrees(f.sky.sun_elevation_rad) < 12 for f in frames]
        assert all(low) if tag in ("shift-sky", "shift-all") else not any(low)
        steep = [f.sea.slope_std > 0.10 and f.sea.swell_slope_std > 0.02 for f in frames]
        assert all(steep) if tag in ("shift-water", "shift-all") else not any(steep)
    assert all(math.degrees(f.sky.sun_elevation_rad) >= 12 for f in diverse if f.sky.kind == "clear")
    assert all(f.sea.slope_std <= 0.10 and f.sea.swell_slope_std <= 0.02 for f in diverse)
    assert not colours & {tuple(colour) for colour in settings_of("shift").scenes["shift-water"].sea.colours_rgb}


def test_shift_keeps_the_cameras_and_the_other_hulls_of_diverse():
    diverse, shift = Scenario(settings_of("diverse")), Scenario(settings_of("shift"))
    assert diverse.cameras().keys() == shift.cameras().keys()
    for name, camera in diverse.cameras().items():
        assert all(torch.equal(one, other) for one, other in zip(camera, shift.cameras()[name]))
    assert {name: hull for name, hull in shift.hulls().items() if hull.family != "barge"} == diverse.hulls()


def test_what_cannot_be_placed_says_so():
    settings = settings_of("paper")
    near = {
        name: replace(scene, distance_m=replace(scene.distance_m, low=2, high=2))
        for name, scene in settings.scenes.items()
    }
    with pytest.raises(ValueError, match=r"scenes: .*: distance_m: no camera sees the water 2\.0 m away"):
        Scenario(replace(settings, scenes=near)).frame(0)
    boats = replace(settings.boats, length_px=replace(settings.boats.length_px, low=400, high=500))
    with pytest.raises(ValueError, match=r"scenes: .*: found no room for 1 boats"):
        Scenario(replace(settings, boats=boats)).frame(0)
