"""From sensor_msgs/CameraInfo and a mount to a camera."""

import math
from dataclasses import dataclass
from typing import Any

import torch

from usvnet.geometry.camera import check_pinhole, crop_camera, make_camera, scale_camera
from usvnet.geometry.lens_models import LENS_MODELS, plumb_bob
from usvnet.types import Camera


@dataclass(frozen=True)
class Mount:
    """What CameraInfo does not say: how the camera stands over the water, and how well all of it is known.

    Attributes:
        height_m: optical centre above mean water; must be given.
        pitch_deg: optical axis below the horizontal.
        roll_deg: clockwise seen from behind.
        height_std_m: standard deviation of the height.
        pitch_std_deg: of the pitch.
        roll_std_deg: of the roll.
        wave_std_m: of the water at a boat about mean water.
        focal_std_px: of the focal length.
    """

    height_m: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    height_std_m: float = 0.0
    pitch_std_deg: float = 0.0
    roll_std_deg: float = 0.0
    wave_std_m: float = 0.0
    focal_std_px: float = 0.0


def camera_from_info(info: Any, mount: Mount, rectified: bool = False) -> Camera:
    """The camera (a batch of 1) of the images that a CameraInfo belongs to.

    Binning and the region of interest are followed as CameraInfo defines them: K is that of the full picture.

    Args:
        info: sensor_msgs/CameraInfo.
        mount: how it stands.
        rectified: the images are those of image_rect: P is their pinhole, and they have no distortion.

    Raises:
        ValueError: a camera that is not calibrated, a lens that is neither plumb bob nor like one, or a faulty mount.
    """
    size_px = (float(info.width), float(info.height))
    if rectified:
        K = torch.tensor([float(value) for value in info.p], dtype=torch.float64).reshape(3, 4)[:, :3]
        lens = [0.0] * 5
    else:
        K = torch.tensor([float(value) for value in info.k], dtype=torch.float64).reshape(3, 3)
        lens = _lens(info, K, size_px)
    if not K.any():
        raise ValueError(f"CameraInfo: {'p' if rectified else 'k'} is zero, expected a calibrated camera")
    check_pinhole(K, f"CameraInfo: {'p' if rectified else 'k'}")
    camera = make_camera(
        K,
        size_px,
        lens,
        height_m=mount.height_m,
        pitch_rad=math.radians(mount.pitch_deg),
        roll_rad=math.radians(mount.roll_deg),
        focal_std_px=mount.focal_std_px,
        height_std_m=mount.height_std_m,
        pitch_std_rad=math.radians(mount.pitch_std_deg),
        roll_std_rad=math.radians(mount.roll_std_deg),
        wave_std_m=mount.wave_std_m,
    )
    roi = info.roi
    if roi.width and roi.height:
        camera = crop_camera(camera, float(roi.x_offset), float(roi.y_offset), (float(roi.width), float(roi.height)))
    binning = (max(info.binning_x, 1), max(info.binning_y, 1))
    if binning != (1, 1):
        width, height = camera.size_px[0].tolist()
        camera = scale_camera(camera, (width // binning[0], height // binning[1]))
    return camera


def _lens(info: Any, K: torch.Tensor, size_px: tuple[float, float]) -> list[float]:
    model = info.distortion_model or LENS_MODELS[0]
    if model not in LENS_MODELS:
        known = " or ".join(LENS_MODELS)
        raise ValueError(
            f"CameraInfo: distortion_model is {model!r}, expected {known}: take the rectified images (rectified: true)"
        )
    coefficients = [float(value) for value in info.d]
    return plumb_bob(coefficients, K, size_px, "CameraInfo: d") if coefficients and K.any() else [0.0] * 5
