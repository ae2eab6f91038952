"""The cameras of a dataset as their files say, and how each truly stood when it took a frame."""

import math
from dataclasses import dataclass

import numpy as np
import torch

from usvnet.geometry.camera import camera_to, make_camera
from usvnet.geometry.camera_files import load_camera
from usvnet.geometry.lens import undistort
from usvnet.geometry.rays import level_rotation
from usvnet.simulator.fleet_settings import CameraSettings, LensSettings, MountSettings
from usvnet.simulator.frame_spec import ShutterSpec
from usvnet.simulator.typed_yaml import Range
from usvnet.types import Camera

BORDER = 9
"""Points along each side of the picture where the lens is tried."""


@dataclass(frozen=True)
class MountedCamera:
    """One camera of the dataset."""

    name: str
    settings: CameraSettings
    nominal: Camera
    """As its file says: a batch of 1, float32."""
    focal_scale: float
    """The true focal length over the file's."""
    share: float
    top_rad: float
    bottom_rad: float
    """How far below the horizontal the middles of the picture's upper and lower edge look."""
    half_width_rad: float
    """Half the horizontal field of view."""

    @property
    def near_m(self) -> float:
        """The nearest water in the picture, along the water."""
        return self.nominal.height_m.item() / math.tan(min(self.bottom_rad, 1.5)) if self.bottom_rad > 0 else math.inf

    @property
    def far_m(self) -> float:
        """The farthest water in the picture, along the water."""
        return self.nominal.height_m.item() / math.tan(self.top_rad) if self.top_rad > 0 else math.inf


def make_cameras(settings: dict[str, CameraSettings]) -> list[MountedCamera]:
    """Draw the cameras of every entry.

    Raises:
        ValueError: a camera file cannot be read, a lens folds over inside its picture, or two have the same name.
    """
    cameras: dict[str, MountedCamera] = {}
    for entry, camera in settings.items():
        for i in range(camera.count):
            name = entry if camera.count == 1 else f"{entry}-{i}"
            if name in cameras:
                raise ValueError(f"cameras: two are called {name}")
            cameras[name] = _make_camera(name, camera, np.random.default_rng([camera.seed, i, *entry.encode()]))
    return list(cameras.values())


def _make_camera(name: str, settings: CameraSettings, rng: np.random.Generator) -> MountedCamera:
    nominal = _draw_nominal(settings, rng) if settings.file is None else load_camera(settings.file)
    focal_px = nominal.K[0, 1, 1].item()
    scale = 1 + float(rng.normal(0, nominal.focal_std_px.item())) / focal_px
    exact = camera_to(nominal, dtype=torch.float64)
    width, height = exact.size_px[0].tolist()
    across, down = torch.linspace(-0.5, width - 0.5, BORDER), torch.linspace(-0.5, height - 0.5, BORDER)
    top, bottom = (torch.stack([across, torch.full_like(across, v)], -1) for v in (-0.5, height - 0.5))
    left, right = (torch.stack([torch.full_like(down, u), down], -1) for u in (-0.5, width - 0.5))
    border = undistort(torch.cat([top, bottom, left, right]).double().unsqueeze(0), exact)
    if not bool(border.valid.all()):
        raise ValueError(f"cameras: {name}: distortion: the lens model folds over inside the picture")
    rays = torch.nn.functional.pad(border.xy[0], (0, 1), value=1.0)
    level = rays @ level_rotation(exact.pitch_rad, exact.roll_rad)[0].T
    below = torch.atan2(level[:, 1], level[:, 2])[[BORDER // 2, BORDER + BORDER // 2]].tolist()
    half = torch.atan(border.xy[0, [2 * BORDER + BORDER // 2, 3 * BORDER + BORDER // 2], 0]).abs().max().item()
    return MountedCamera(name, settings, nominal, scale, settings.share / settings.count, below[0], below[1], half)


def _draw_nominal(settings: CameraSettings, rng: np.random.Generator) -> Camera:
    assert settings.size_px is not None
    assert settings.mount is not None
    width, height = settings.size_px
    if settings.focal_px is not None:
        focal = settings.focal_px.draw(rng)
    else:
        assert settings.hfov_deg is not None
        focal = width / 2 / math.tan(math.radians(settings.hfov_deg.draw(rng)) / 2)
    offset = settings.principal_offset_px or Range(0, 0)
    cx, cy = (width - 1) / 2 + offset.draw(rng), (height - 1) / 2 + offset.draw(rng)
    lens: LensSettings = settings.distortion or LensSettings()
    mount: MountSettings = settings.mount
    return make_camera(
        np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1]]),
        [width, height],
        [coefficient.draw(rng) for coefficient in (lens.k1, lens.k2, lens.p1, lens.p2, lens.k3)],
        height_m=mount.height_m.draw(rng),
        pitch_rad=math.radians(mount.pitch_deg.draw(rng)),
        roll_rad=math.radians(mount.roll_deg.draw(rng)),
        focal_std_px=settings.focal_std_px or 0.0,
        height_std_m=mount.height_std_m,
        pitch_std_rad=math.radians(mount.pitch_std_deg),
        roll_std_rad=math.radians(mount.roll_std_deg),
    )


def true_camera(camera: MountedCamera, rng: np.random.Generator) -> Camera:
    """How the camera truly stood in one frame: a batch of 1, float64, its mount's deviations drawn."""
    nominal = camera_to(camera.nominal, dtype=torch.float64)
    K = nominal.K.clone()
    K[0, [0, 1], [0, 1]] *= camera.focal_scale
    height_m = nominal.height_m + nominal.height_std_m * rng.normal()
    return nominal._replace(
        K=K,
        height_m=torch.maximum(height_m, nominal.height_m / 2),
        pitch_rad=nominal.pitch_rad + nominal.pitch_std_rad * rng.normal(),
        roll_rad=nominal.roll_rad + nominal.roll_std_rad * rng.normal(),
    )


def measure_attitude(
    camera: MountedCamera, true: Camera, rng: np.random.Generator
) -> tuple[float, float, float | None]:
    """Pitch, roll and their standard deviation in degrees, as the IMU says.

    Without one the angles are the mount's and there is no deviation: the camera file has them, each with its own.
    """
    std_deg = camera.settings.imu_std_deg
    if std_deg is None:
        return math.degrees(camera.nominal.pitch_rad.item()), math.degrees(camera.nominal.roll_rad.item()), None
    pitch_deg, roll_deg = (math.degrees(angle.item()) for angle in (true.pitch_rad, true.roll_rad))
    return pitch_deg + float(rng.normal(0, std_deg)), roll_deg + float(rng.normal(0, std_deg)), std_deg


def draw_shutter(camera: MountedCamera, exposure_s: float, rng: np.random.Generator) -> ShutterSpec:
    """How the camera turned while it took the frame."""
    std_rad_s = math.radians(camera.settings.turn_rate_std_deg_s)
    rates = [float(rate) for rate in rng.normal(0, std_rad_s, 3)]
    if std_rad_s == 0:
        return ShutterSpec()  # a still camera shows no exposure and no readout
    return ShutterSpec(exposure_s, camera.settings.readout_s, *rates)
