"""Cameras: making them, moving them with their picture, and projecting through them.

A picture is only ever moved together with its camera: K' = A K for the pixel map A, so that a point of the world
lands on the moved pixel and every range stays what it was.
"""

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from usvnet.geometry.lens import centre_px, determinant_2x2, distort, distortion_jacobian, focal_px
from usvnet.types import Camera

Numbers = Tensor | np.ndarray | Sequence[float]

MIN_DEPTH_M = 1e-6
"""Points nearer to the camera's plane than this, or behind it, have no pixel."""


def make_camera(
    K: Numbers | Sequence[Sequence[float]],
    size_px: Numbers,
    distortion: Numbers | None = None,
    *,
    height_m: float,
    pitch_rad: float = 0.0,
    roll_rad: float = 0.0,
    focal_std_px: float = 0.0,
    height_std_m: float = 0.0,
    pitch_std_rad: float = 0.0,
    roll_std_rad: float = 0.0,
    wave_std_m: float = 0.0,
    dtype: torch.dtype = torch.float32,
) -> Camera:
    """One camera (a batch of 1) from plain numbers, arrays or tensors.

    Args:
        K: (3, 3) pinhole matrix without skew, pixels.
        size_px: width and height of the picture.
        distortion: k1, k2, p1, p2 [, k3]; none is a perfect lens.
        height_m: optical centre above mean water.
        pitch_rad: optical axis below the horizontal.
        roll_rad: clockwise seen from behind.
        focal_std_px: standard deviation of the focal length.
        height_std_m: standard deviation of the height.
        pitch_std_rad: standard deviation of the pitch.
        roll_std_rad: standard deviation of the roll.
        wave_std_m: standard deviation of the water at a boat about mean water.
        dtype: of every tensor.

    Raises:
        ValueError: the value that cannot be a camera's, with what was got and what was expected.
    """
    matrix = torch.as_tensor(K, dtype=torch.float64)
    check_pinhole(matrix, "K")
    size = torch.as_tensor(size_px, dtype=torch.float64)
    if size.shape != (2,) or not bool((torch.isfinite(size) & (size > 0)).all()):
        raise ValueError(f"size_px: expected a width and a height above 0, got {size.tolist()}")

    lens = torch.zeros(5, dtype=torch.float64)
    if distortion is not None:
        coefficients = torch.as_tensor(distortion, dtype=torch.float64).flatten()
        if coefficients.numel() not in (4, 5):
            raise ValueError(f"distortion: expected 4 or 5 coefficients, got {coefficients.numel()}")
        if not bool(torch.isfinite(coefficients).all()):
            raise ValueError(f"distortion: expected finite numbers, got {coefficients.tolist()}")
        lens[: coefficients.numel()] = coefficients

    if not (math.isfinite(height_m) and height_m > 0):
        raise ValueError(f"height_m: expected metres above the water, got {height_m:g}")
    for name, angle in (("pitch_rad", pitch_rad), ("roll_rad", roll_rad)):
        if not abs(angle) <= math.pi:
            raise ValueError(f"{name}: expected an angle within one half turn, got {angle:g}")
    stds = {
        "focal_std_px": focal_std_px,
        "height_std_m": height_std_m,
        "pitch_std_rad": pitch_std_rad,
        "roll_std_rad": roll_std_rad,
        "wave_std_m": wave_std_m,
    }
    for name, std in stds.items():
        if not (math.isfinite(std) and std >= 0):
            raise ValueError(f"{name}: expected a standard deviation of at least 0, got {std:g}")

    def batch(value: Tensor | float) -> Tensor:
        return torch.as_tensor(value, dtype=dtype).unsqueeze(0)

    return Camera(
        K=batch(matrix),
        distortion=batch(lens),
        size_px=batch(size),
        height_m=batch(height_m),
        pitch_rad=batch(pitch_rad),
        roll_rad=batch(roll_rad),
        focal_std_px=batch(focal_std_px),
        height_std_m=batch(height_std_m),
        pitch_std_rad=batch(pitch_std_rad),
        roll_std_rad=batch(roll_std_rad),
        wave_std_m=batch(wave_std_m),
    )


def check_pinhole(K: Tensor, where: str) -> None:
    """Insist on a pinhole matrix (3, 3) without skew.

    Raises:
        ValueError: what was got and what was expected, after ``where``.
    """
    if K.shape != (3, 3):
        raise ValueError(f"{where}: expected a 3 x 3 matrix, got shape {tuple(K.shape)}")
    if not bool(torch.isfinite(K).all()):
        raise ValueError(f"{where}: expected finite numbers, got {K.tolist()}")
    if not (K[0, 0] > 0 and K[1, 1] > 0):
        raise ValueError(f"{where}: expected a focal length above 0 px, got fx = {K[0, 0]:g}, fy = {K[1, 1]:g}")
    if K[0, 1] != 0 or K[1, 0] != 0 or K[2].tolist() != [0, 0, 1]:
        raise ValueError(f"{where}: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {K.tolist()}")


def stack_cameras(cameras: Sequence[Camera]) -> Camera:
    """Join batches of cameras into one."""
    return Camera(*(torch.cat(field) for field in zip(*cameras)))


def select_camera(camera: Camera, index: int) -> Camera:
    """Take camera ``index`` of a batch, as a batch of 1."""
    if not -len(camera.K) <= index < len(camera.K):
        raise IndexError(f"camera {index} of a batch of {len(camera.K)}")
    return Camera(*(field[index].unsqueeze(0) for field in camera))


def camera_to(camera: Camera, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> Camera:
    """Move every tensor of a camera to a device and dtype."""
    return Camera(*(field.to(device=device, dtype=dtype) for field in camera))


def with_attitude(
    camera: Camera,
    pitch_rad: Tensor | float,
    roll_rad: Tensor | float,
    pitch_std_rad: Tensor | float | None = None,
    roll_std_rad: Tensor | float | None = None,
) -> Camera:
    """Replace the mount's attitude by a measured one, such as an IMU's; plain numbers or (B,).

    The standard deviations stay the mount's where none are given.
    """
    new = {"pitch_rad": pitch_rad, "roll_rad": roll_rad, "pitch_std_rad": pitch_std_rad, "roll_std_rad": roll_std_rad}
    like = camera.pitch_rad
    return camera._replace(
        **{
            name: torch.as_tensor(value, dtype=like.dtype, device=like.device).expand_as(like)
            for name, value in new.items()
            if value is not None
        }
    )


def transform_camera(camera: Camera, A: Tensor, size_px: Numbers) -> Camera:
    """Move cameras with their pictures by a pixel map.

    Args:
        camera: B cameras.
        A: (3, 3) or (B, 3, 3) map from old to new pixels: positive scales and a shift, no rotation or mirror
            (:func:`turn_camera` turns, :func:`flip_camera` mirrors).
        size_px: width and height of the new pictures, (2,) or (B, 2).

    Raises:
        ValueError: A turns, shears or mirrors.
    """
    A = A.to(camera.K)
    scales = A.diagonal(dim1=-2, dim2=-1)
    if not torch.equal(A[..., :2], scales.diag_embed()[..., :2]) or not bool((scales > 0).all()):
        raise ValueError(f"A: expected positive scales and a shift, got {A.tolist()}")
    size = torch.as_tensor(size_px, dtype=camera.K.dtype, device=camera.K.device)
    return camera._replace(
        K=A @ camera.K, size_px=size.expand_as(camera.size_px), focal_std_px=A[..., 1, 1] * camera.focal_std_px
    )


def scale_matrix(size_px: Numbers, target_px: Numbers) -> Tensor:
    """Pixel map (..., 3, 3) of stretching a picture of ``size_px`` (..., 2) to ``target_px`` (..., 2), edge to edge."""
    size, target = _sizes(size_px, target_px)
    return _affine(target / size, torch.zeros_like(size))


def letterbox_matrix(size_px: Numbers, target_px: Numbers) -> Tensor:
    """Pixel map (..., 3, 3) of fitting a picture of ``size_px`` (..., 2) whole into ``target_px``, in its middle.

    u' = s (u + 0.5) - 0.5 + pad with one scale s and a pad of whole pixels (what is left over goes right and below),
    so a picture that is only padded keeps its pixels as they are.
    """
    size, target = _sizes(size_px, target_px)
    scale = (target / size).amin(-1, keepdim=True).expand_as(size)
    return _affine(scale, torch.floor((target - scale * size) / 2 + 1e-3))  # rounding must not cost a whole pixel


def scale_camera(camera: Camera, target_px: Numbers) -> Camera:
    """Stretch the picture to ``target_px``."""
    return transform_camera(camera, scale_matrix(camera.size_px, target_px), target_px)


def crop_camera(camera: Camera, left_px: float, top_px: float, size_px: Numbers) -> Camera:
    """Cut ``size_px`` out of the picture, with pixel (left, top) as its first; outside the picture is padding."""
    A = torch.eye(3, dtype=camera.K.dtype, device=camera.K.device)
    A[0, 2], A[1, 2] = -left_px, -top_px
    return transform_camera(camera, A, size_px)


def letterbox_camera(camera: Camera, target_px: Numbers) -> Camera:
    """Fit the picture into ``target_px`` (see :func:`letterbox_matrix`)."""
    return transform_camera(camera, letterbox_matrix(camera.size_px, target_px), target_px)


def flip_camera(camera: Camera) -> Camera:
    """Mirror the picture left to right: u' = W - 1 - u, and the world with it."""
    K = camera.K.clone()
    K[..., 0, 2] = camera.size_px[..., 0] - 1 - K[..., 0, 2]
    distortion = camera.distortion.clone()
    distortion[..., 3] = -distortion[..., 3]
    return camera._replace(K=K, distortion=distortion, roll_rad=-camera.roll_rad)


def turn_camera(camera: Camera, angle_rad: Tensor | float) -> Camera:
    """Turn cameras about their optical axis, clockwise seen from behind, by a number or (B,).

    Their pictures turn the other way, see :func:`usvnet.data.transforms.turn_matrix`.

    Exact for every plumb-bob lens: radial distortion does not know directions, and the tangential part is
    2 (q . x) x + q |x|^2 with q = (p2, p1), so it is enough to turn q like any other vector of the picture.
    """
    angle = torch.as_tensor(angle_rad, dtype=camera.roll_rad.dtype, device=camera.roll_rad.device)
    c, s = torch.cos(angle), torch.sin(angle)
    k1, k2, p1, p2, k3 = camera.distortion.unbind(-1)
    distortion = torch.stack([k1, k2, c * p1 - s * p2, c * p2 + s * p1, k3], -1)
    return camera._replace(distortion=distortion, roll_rad=camera.roll_rad + angle)


def project(points_camera_m: Tensor, camera: Camera) -> Tensor:
    """Pixels (B, P, 2) of points (B, P, 3) in the camera frame, lens distortion included.

    NaN, with a zero gradient, for a point that has no pixel: behind the camera, or so far out that the lens model
    folds over and would show it inside the picture.
    """
    z = points_camera_m[..., 2:]
    ahead = z > MIN_DEPTH_M
    xy = torch.where(ahead, points_camera_m[..., :2], 0.0) / torch.where(ahead, z, 1.0)
    seen = ahead & (determinant_2x2(distortion_jacobian(xy, camera.distortion)) > 0).unsqueeze(-1)
    distorted = distort(torch.where(seen, xy, 0.0), camera.distortion)
    return torch.where(seen, distorted * focal_px(camera) + centre_px(camera), float("nan"))


def _sizes(size_px: Numbers, target_px: Numbers) -> tuple[Tensor, Tensor]:
    size = torch.as_tensor(size_px)
    size = size if size.is_floating_point() else size.to(torch.get_default_dtype())
    target = torch.as_tensor(target_px, dtype=size.dtype, device=size.device)
    return size, target.expand_as(size)


def _affine(scale: Tensor, pad_px: Tensor) -> Tensor:
    """Map (..., 3, 3) u' = s (u + 0.5) - 0.5 + pad."""
    A = torch.diag_embed(torch.cat([scale, torch.ones_like(scale[..., :1])], -1))
    A[..., :2, 2] = scale / 2 - 0.5 + pad_px
    return A
