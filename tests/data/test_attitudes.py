"""Where a picture's pitch and roll come from: mount, tables, imu.csv, the horizon, or several of them."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from usvnet.data.attitudes import AttitudeConfig, see_horizons
from usvnet.data.check import check_dataset
from usvnet.data.datamodule import BoatDataModule
from usvnet.data.reader import read_dataset
from usvnet.geometry.camera import with_attitude
from usvnet.geometry.camera_files import load_camera, save_camera
from usvnet.geometry.rays import level_rays
from usvnet.geometry.water import horizon_dip_rad
from usvnet.types import Camera

TRUE_DEG = (7.4, 1.5)
"""Pitch and roll of the sea that is drawn: the mount of the tiny dataset says 6.9 and 2.3."""


@pytest.fixture
def tiny(tiny: Path) -> Path:
    """The tiny dataset with a mount whose attitude is known to 0.6 degrees."""
    path = tiny / "cameras" / "front.yaml"
    std = torch.tensor([math.radians(0.6)])
    save_camera(load_camera(path)._replace(pitch_std_rad=std, roll_std_rad=std), path)
    return tiny


def attitude(camera: Camera) -> list[float]:
    fields = (camera.pitch_rad, camera.roll_rad, camera.pitch_std_rad, camera.roll_std_rad)
    return [math.degrees(field.item()) for field in fields]


def first(root: Path, **settings: object) -> list[float]:
    return attitude(BoatDataModule(str(root), 64, attitude=AttitudeConfig(**settings)).frames("test")[0].camera)


def draw_sea(root: Path) -> None:
    """Paint the test picture as sky over open water, seen at TRUE_DEG."""
    camera = with_attitude(load_camera(root / "cameras" / "front.yaml"), *np.radians(TRUE_DEG))
    camera = Camera(*(field.double() for field in camera))
    width, height = camera.size_px[0].int().tolist()
    v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    rays = level_rays(torch.stack([u, v], -1).reshape(1, -1, 2).double(), camera)[0]
    below = (torch.asin(rays[:, 1]) - horizon_dip_rad(camera.height_m)) * camera.K[0, 1, 1]
    water = torch.sigmoid(5 * below).reshape(height, width, 1).numpy()
    picture = 200 * (1 - water) + 90 * water + np.random.default_rng(0).normal(0, 1, (height, width, 3))
    cv2.imwrite(str(root / "images" / "test" / "0006.png"), picture.astype(np.uint8))


class TestFiles:
    def test_tables_come_before_the_mount(self, tiny: Path):
        mount = first(tiny)
        (tiny / "frames.csv").write_text("image,pitch_deg,pitch_std_deg\ntest/0006.png,5.5,0.1\n")
        assert first(tiny) == pytest.approx([5.5, mount[1], 0.1, mount[3]], rel=1e-5)
        assert first(tiny, source="mount") == mount

    def test_imu_is_interpolated_at_the_picture_s_time(self, tiny: Path):
        (tiny / "frames.csv").write_text("image,time_s\ntest/0006.png,100.05\n")
        (tiny / "imu.csv").write_text("time_s,pitch_deg,roll_deg\n102,5,1\n102.1,6,3\n102.2,8,3\n")
        mount = first(tiny, source="mount")
        assert first(tiny, time_offset_s=2.0) == pytest.approx([5.5, 2.0, mount[2], mount[3]], rel=1e-5)
        assert first(tiny, time_offset_s=2.1)[:2] == pytest.approx([7.0, 3.0], rel=1e-5)

    def test_imu_s_own_sigmas_are_taken(self, tiny: Path):
        (tiny / "frames.csv").write_text("image,time_s\ntest/0006.png,1\n")
        (tiny / "imu.csv").write_text("time_s,pitch_deg,roll_deg,pitch_std_deg,roll_std_deg\n1,5,1,0.2,0.3\n")
        assert first(tiny) == pytest.approx([5, 1, 0.2, 0.3], rel=1e-5)

    def test_imu_fills_what_the_table_leaves_open(self, tiny: Path):
        (tiny / "frames.csv").write_text("image,time_s,pitch_deg\ntest/0006.png,1,5.5\n")
        (tiny / "imu.csv").write_text("time_s,pitch_deg,roll_deg,pitch_std_deg,roll_std_deg\n1,5,1,0.2,0.3\n")
        assert first(tiny) == pytest.approx([5.5, 1, first(tiny, source="mount")[2], 0.3], rel=1e-5)

    def test_in_a_gap_the_mount_stands_and_it_is_said(self, tiny: Path, capsys):
        (tiny / "frames.csv").write_text("image,time_s\ntest/0006.png,1.5\nval/0004.png,2\n")
        (tiny / "imu.csv").write_text("time_s,pitch_deg,roll_deg\n1,5,1\n2,6,3\n")
        assert first(tiny) == first(tiny, source="mount")
        assert "1 of 2 pictures lie outside it or in a gap of more than 0.2 s" in capsys.readouterr().err
        assert first(tiny, max_gap_s=1.0)[:2] == pytest.approx([5.5, 2.0], rel=1e-5)

    def test_what_a_table_says_of_a_picture_comes_before_imu(self, tiny: Path):
        (tiny / "frames.csv").write_text("image,time_s,pitch_deg,roll_deg\ntest/0006.png,1,3,4\n")
        (tiny / "imu.csv").write_text("time_s,pitch_deg,roll_deg\n1,5,1\n")
        assert first(tiny)[:2] == pytest.approx([3, 4], rel=1e-5)

    def test_an_imu_without_times_of_pictures_is_refused(self, tiny: Path):
        (tiny / "imu.csv").write_text("time_s,pitch_deg,roll_deg\n1,5,1\n")
        with pytest.raises(ValueError, match=r"imu\.csv: no picture has a time, expected a column time_s in .*frames"):
            read_dataset(tiny, "test")

    def test_check_data_names_a_faulty_row_of_imu(self, tiny: Path):
        (tiny / "frames.csv").write_text("image,time_s\ntest/0006.png,1\n")
        (tiny / "imu.csv").write_text("time_s,pitch_deg,roll_deg\n1,high,1\n")
        assert any("imu.csv:2: pitch_deg is 'high'" in fault for fault in check_dataset(tiny)[1])

    @pytest.mark.parametrize(
        ("settings", "words"),
        [({"max_gap_s": 0.0}, "max_gap_s: got 0.0"), ({"time_offset_s": math.nan}, "time_offset_s: got nan")],
    )
    def test_a_setting_out_of_range_is_named(self, settings: dict, words: str):
        with pytest.raises(ValueError, match=words):
            AttitudeConfig(**settings)


class TestHorizon:
    def test_it_replaces_the_mount_with_its_own_sigma(self, tiny: Path):
        draw_sea(tiny)
        pitch, roll, pitch_std, roll_std = first(tiny, source="horizon")
        assert pitch == pytest.approx(TRUE_DEG[0], abs=3 * pitch_std)
        assert roll == pytest.approx(TRUE_DEG[1], abs=3 * roll_std)
        assert 0 < pitch_std < 0.4
        assert first(tiny) == first(tiny, source="mount")  # by default nobody looks

    def test_combined_lies_between_and_is_surer_than_either(self, tiny: Path):
        draw_sea(tiny)
        mount, horizon, both = (first(tiny, source=source) for source in ("mount", "horizon", "combined"))
        for angle in (0, 1):
            low, high = sorted((mount[angle], horizon[angle]))
            assert low < both[angle] < high
            assert both[angle + 2] < min(mount[angle + 2], horizon[angle + 2])

    def test_where_none_is_seen_files_stand_and_it_is_counted(self, tiny: Path, capsys):
        for source in ("horizon", "combined"):
            assert first(tiny, source=source) == first(tiny)  # a picture of noise
        assert "horizon in 1 pictures: faint 1" in capsys.readouterr().err

    def test_a_contradiction_leaves_the_less_certain(self, tiny: Path, capsys):
        draw_sea(tiny)
        frame = read_dataset(tiny, "test")[0]
        std = torch.tensor([math.radians(0.001)])
        boast = frame.camera._replace(pitch_std_rad=std, roll_std_rad=std, pitch_rad=frame.camera.pitch_rad + 0.008)
        frame = type(frame)(**{**frame.__dict__, "camera": boast})
        seen = see_horizons([frame], AttitudeConfig(source="combined"))[0].camera
        assert "contradicted 1" in capsys.readouterr().err
        assert seen.pitch_std_rad.item() > 10 * std.item()
