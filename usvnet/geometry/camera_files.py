"""Camera files: ROS ``camera_info`` YAML and OpenCV ``FileStorage`` YAML, each with our ``mount:`` block.

Both keep K under ``camera_matrix`` and the lens under ``distortion_coefficients`` (plumb bob, or a rational polynomial
that resembles one: :mod:`usvnet.geometry.lens_models`); they differ in header, tags and the keys that only one of them
knows. ``mount:`` says how the camera stands over the water::

    mount: {height_m: 1.5, pitch_deg: 6.0, roll_deg: 0.0, height_std_m: 0.01, pitch_std_deg: 0.3, roll_std_deg: 0.3,
            wave_std_m: 0.02}

Standard deviations may be left out (then 0), and ``focal_std_px`` may stand beside ``mount``; ``wave_std_m`` is that of
the water at a boat about mean water. Files hold degrees, a :class:`~usvnet.types.Camera` radians.
"""

import json
import math
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor

from usvnet.files import atomic_write
from usvnet.geometry.camera import check_pinhole, make_camera
from usvnet.geometry.lens_models import LENS_MODELS, plumb_bob
from usvnet.geometry.yaml_files import (
    Mapping,
    as_mapping,
    as_number,
    as_numbers,
    decimal_text,
    read_mapping,
    read_std,
    refuse_unknown,
    require,
    short,
)
from usvnet.types import Camera

MOUNT_KEYS = ("height_m", "pitch_deg", "roll_deg", "height_std_m", "pitch_std_deg", "roll_std_deg", "wave_std_m")


def load_camera(path: Path | str) -> Camera:
    """Read a camera file, ROS or OpenCV style, as one float32 camera (a batch of 1).

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file and key that is missing, unknown or not as expected.
    """
    path = Path(path)
    content = read_mapping(path)
    model = content.get("distortion_model", LENS_MODELS[0])
    if model not in LENS_MODELS:
        raise ValueError(f"{path}: distortion_model: expected {' or '.join(LENS_MODELS)}, got {short(model)}")
    if content.get("fisheye_model"):  # OpenCV's calibration program names its other lens so
        raise ValueError(f"{path}: fisheye_model: expected a lens of {' or '.join(LENS_MODELS)}, got a fisheye")
    numbers = _matrix(content, "camera_matrix", path)
    if len(numbers) != 9:
        raise ValueError(f"{path}: camera_matrix: expected 9 numbers, got {len(numbers)}")
    K = torch.tensor(numbers, dtype=torch.float64).reshape(3, 3)
    check_pinhole(K.float(), f"{path}: camera_matrix")
    size_px = [_read_size(content, key, path) for key in ("image_width", "image_height")]
    lens = _matrix(content, "distortion_coefficients", path)
    mount = _read_mount(content, path)
    return make_camera(
        K,
        size_px,
        plumb_bob(lens, K, size_px, f"{path}: distortion_coefficients"),
        height_m=mount["height_m"],
        pitch_rad=math.radians(mount["pitch_deg"]),
        roll_rad=math.radians(mount["roll_deg"]),
        focal_std_px=read_std(content, "focal_std_px", f"{path}"),
        height_std_m=mount["height_std_m"],
        pitch_std_rad=math.radians(mount["pitch_std_deg"]),
        roll_std_rad=math.radians(mount["roll_std_deg"]),
        wave_std_m=mount["wave_std_m"],
    )


def save_camera(
    camera: Camera, path: Path | str, style: Literal["ros", "opencv"] = "ros", name: str = "camera"
) -> None:
    """Write one camera (a batch of 1) so that :func:`load_camera` gives it back bit by bit (as float32).

    Raises:
        ValueError: a batch of another size, or an unknown style.
    """
    if len(camera.K) != 1:
        raise ValueError(f"{path}: a camera file holds one camera, got a batch of {len(camera.K)}")
    if style not in ("ros", "opencv"):
        raise ValueError(f"{path}: style: expected ros or opencv, got {style!r}")
    text = _ros_text(camera, name) if style == "ros" else _opencv_text(camera, name)
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _matrix(content: Mapping, key: str, path: Path) -> list[float]:
    matrix = as_mapping(require(content, key, f"{path}"), f"{path}: {key}")
    return as_numbers(require(matrix, "data", f"{path}: {key}"), f"{path}: {key}: data")


def _read_size(content: Mapping, key: str, path: Path) -> float:
    size = as_number(require(content, key, f"{path}"), f"{path}: {key}")
    if size < 1 or size != int(size):
        raise ValueError(f"{path}: {key}: expected a whole number of pixels, got {size:g}")
    return size


def _read_mount(content: Mapping, path: Path) -> dict[str, float]:
    where = f"{path}: mount"
    mount = as_mapping(require(content, "mount", f"{path}"), where)
    refuse_unknown(mount, MOUNT_KEYS, where)
    values = {key: as_number(require(mount, key, where), f"{where}: {key}") for key in MOUNT_KEYS[:3]}
    if values["height_m"] <= 0:
        raise ValueError(f"{where}: height_m: expected metres above the water, got {values['height_m']:g}")
    for key in ("pitch_deg", "roll_deg"):
        if abs(values[key]) > 180:
            raise ValueError(f"{where}: {key}: expected an angle within 180 degrees, got {values[key]:g}")
    return values | {key: read_std(mount, key, where) for key in MOUNT_KEYS[3:]}


def _mount_texts(camera: Camera) -> dict[str, str]:
    return {
        "height_m": decimal_text(camera.height_m[0]),
        "pitch_deg": decimal_text(camera.pitch_rad[0], degrees=True),
        "roll_deg": decimal_text(camera.roll_rad[0], degrees=True),
        "height_std_m": decimal_text(camera.height_std_m[0]),
        "pitch_std_deg": decimal_text(camera.pitch_std_rad[0], degrees=True),
        "roll_std_deg": decimal_text(camera.roll_std_rad[0], degrees=True),
        "wave_std_m": decimal_text(camera.wave_std_m[0]),
    }


def _ros_text(camera: Camera, name: str) -> str:
    width, height = (int(size) for size in camera.size_px[0])
    K = camera.K[0]
    identity = torch.eye(3, dtype=K.dtype)
    projection = torch.cat([K.cpu(), torch.zeros(3, 1, dtype=K.dtype)], 1)
    mount = ", ".join(f"{key}: {text}" for key, text in _mount_texts(camera).items())
    return "\n".join(
        [
            f"image_width: {width}",
            f"image_height: {height}",
            f"camera_name: {json.dumps(name)}",
            f"camera_matrix: {{rows: 3, cols: 3, data: [{_decimals(K)}]}}",
            "distortion_model: plumb_bob",
            f"distortion_coefficients: {{rows: 1, cols: 5, data: [{_decimals(camera.distortion)}]}}",
            f"rectification_matrix: {{rows: 3, cols: 3, data: [{_decimals(identity)}]}}",
            f"projection_matrix: {{rows: 3, cols: 4, data: [{_decimals(projection)}]}}",
            f"focal_std_px: {decimal_text(camera.focal_std_px[0])}",
            f"mount: {{{mount}}}",
            "",
        ]
    )


def _opencv_text(camera: Camera, name: str) -> str:
    width, height = (int(size) for size in camera.size_px[0])
    lines = ["%YAML:1.0", "---", f"camera_name: {json.dumps(name)}", f"image_width: {width}", f"image_height: {height}"]
    for key, rows, matrix in (("camera_matrix", 3, camera.K), ("distortion_coefficients", 5, camera.distortion)):
        lines += [f"{key}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {matrix.numel() // rows}", "   dt: d"]
        lines += [f"   data: [ {_decimals(matrix)} ]"]
    lines += [f"focal_std_px: {decimal_text(camera.focal_std_px[0])}", "mount:"]
    lines += [f"   {key}: {text}" for key, text in _mount_texts(camera).items()]
    return "\n".join([*lines, ""])


def _decimals(values: Tensor) -> str:
    return ", ".join(decimal_text(value) for value in values.flatten())
