"""The lens and the shutter: what the real camera makes of a pinhole picture.

Mitsuba renders a pinhole with square pixels and its principal point in the middle. Lens distortion, another principal
point, fx other than fy, a rolling shutter and motion blur only turn rays about the optical centre, so all of them are
one exact warp of that picture, and the labels go through the same Camera.
"""

import functools
import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from usvnet.geometry.camera import project
from usvnet.geometry.lens import centre_px, determinant_2x2, distortion_jacobian, focal_px, undistort
from usvnet.simulator.frame_spec import ShutterSpec
from usvnet.simulator.pose import camera_from_world
from usvnet.simulator.shutter import rotations, turn_of
from usvnet.types import Camera

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]

MARGIN_PX = 4
"""The warp's interpolation looks a pixel beyond every ray, the mask's half a pixel."""
MAX_MAGNIFICATION = 1.15
"""Where a lens magnifies, the pinhole picture is rendered up to so much larger."""
MAX_EXPOSURES = 16
PROJECTIONS = 12
"""Steps to the row of a rolling shutter in which a point is seen; each one brings at least a digit."""


@dataclass(frozen=True)
class PinholeView:
    """The picture that is rendered: square pixels, principal point in the middle."""

    width: int
    height: int
    focal_px: float


class Optics:
    """The warp from the pinhole picture to the real one, and pixels of points."""

    def __init__(self, camera: Camera, shutter: ShutterSpec):
        """Prepare the warp.

        Args:
            camera: a batch of 1, as it stands in the middle of the exposure.
            shutter: how it moves.

        Raises:
            ValueError: the lens distortion cannot be undone at some pixel.
        """
        self.camera = camera._replace(**{name: getattr(camera, name).double() for name in camera._fields})
        self.shutter = shutter
        self.width, self.height = (int(size) for size in camera.size_px[0])
        self.turn_rad_s = turn_of(shutter)
        self.view = pinhole_view(self.camera, self.shutter)
        self.identity = _is_pinhole(self.camera) and not self.turn_rad_s.any()

    def pinhole_of(self, pixels_px: Doubles, time_s: Doubles) -> Doubles:
        """Where (N, 2) the pinhole picture shows what real pixels (N, 2) see at moments (N,)."""
        return self._pinhole_of_rays(_undistorted(pixels_px, self.camera), time_s)

    def project(self, points_m: Doubles) -> Doubles:
        """Real pixels (N, 2) of points (N, 3), camera frame in mid-exposure; NaN where there is none.

        With a rolling shutter, a point is seen in the row that is being read when the point is in it; the label is
        where it is in the middle of that row's own exposure.
        """
        pixels = self._project_at(points_m, np.zeros(len(points_m)))
        if self.shutter.readout_s and self.turn_rad_s.any():
            for _ in range(PROJECTIONS):
                pixels = self._project_at(points_m, self.row_time_s(np.nan_to_num(pixels[:, 1])))
        return pixels

    def row_time_s(self, v_px: Doubles) -> Doubles:
        """Middle of the exposure of rows ``v_px`` (N,); rows outside the picture would be read at its ends."""
        share = np.clip(v_px / max(self.height - 1, 1), -0.5, 1.5) - 0.5
        return self.shutter.readout_s * share

    def apply(self, radiance: Floats) -> Floats:
        """The real picture (H, W, C) of the pinhole's radiance (h, w, C), with motion blur."""
        if self.identity:
            return radiance
        tensor = torch.from_numpy(np.ascontiguousarray(radiance)).permute(2, 0, 1)[None]
        offsets = self._exposure_times()
        total = torch.zeros(1, radiance.shape[2], self.height, self.width)
        for offset in offsets:
            at = torch.from_numpy(self._table(offset))[None]
            size = torch.tensor([self.view.width, self.view.height], dtype=at.dtype)
            grid = ((2 * at + 1) / size - 1).float()
            # bilinear keeps every centroid; cubic kernels move them by 0.04 px, and cv2.remap rounds to 1/32 px
            total += torch.nn.functional.grid_sample(
                tensor, grid, mode="bilinear", padding_mode="border", align_corners=False
            )
        return (total / len(offsets)).clamp_min(0)[0].permute(1, 2, 0).contiguous().numpy()

    def apply_labels(self, mask: NDArray[np.int32], scale: int) -> NDArray[np.int32]:
        """A mask (scale h, scale w) as the real picture shows it (scale H, scale W), in mid-exposure: the nearest.

        It stays as fine as it comes: between the sub-pixels of an even scale, a pixel's centre has no nearest.
        """
        if self.identity:
            return mask
        at = cv2.resize(self._table(0.0), None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
        place = np.floor((at + 0.5) * scale).astype(np.int64)
        rows = np.clip(place[..., 1], 0, mask.shape[0] - 1)
        columns = np.clip(place[..., 0], 0, mask.shape[1] - 1)
        return mask[rows, columns]

    def _project_at(self, points_m: Doubles, time_s: Doubles) -> Doubles:
        turned = np.einsum("nij,ni->nj", self._rotations(time_s), points_m)
        pixels: Doubles = project(torch.from_numpy(turned)[None], self.camera)[0].numpy()
        return pixels

    def _pinhole_of_rays(self, xy: Doubles, time_s: Doubles) -> Doubles:
        rays = np.concatenate([xy, np.ones_like(xy[:, :1])], 1)
        if self.turn_rad_s.any():
            rays = np.einsum("nij,nj->ni", self._rotations(time_s), rays)
        middle = np.array([self.view.width - 1, self.view.height - 1]) / 2
        places: Doubles = rays[:, :2] / rays[:, 2:] * self.view.focal_px + middle
        return places

    def _rotations(self, time_s: Doubles) -> Doubles:
        """Rotations (N, 3, 3) from the camera frame at moments (N,) to that of mid-exposure (Rodrigues)."""
        return rotations(self.turn_rad_s, time_s)

    def _exposure_times(self) -> list[float]:
        """Moments within one row's exposure, so close that nothing moves more than a pixel between them."""
        drift_px = float(np.linalg.norm(self.turn_rad_s)) * self.shutter.exposure_s * self.view.focal_px
        count = min(max(math.ceil(drift_px), 1), MAX_EXPOSURES)
        return [self.shutter.exposure_s * ((k + 0.5) / count - 0.5) for k in range(count)]

    def _table(self, offset_s: float) -> Doubles:
        """Places (H, W, 2) in the pinhole of what pixels see ``offset_s`` from the middle of their exposure."""
        xy = _pixel_rays(_lens_key(self.camera)).reshape(self.height, self.width, 2)
        middle = np.array([self.view.width - 1, self.view.height - 1]) / 2
        if not self.turn_rad_s.any():
            return xy * self.view.focal_px + middle
        times = self.row_time_s(np.arange(self.height, dtype=np.float64)) + offset_s
        R = self._rotations(times)[:, None]  # one for each row, not for each pixel
        x, y = xy[..., 0], xy[..., 1]
        across, down, ahead = (x * R[..., i, 0] + y * R[..., i, 1] + R[..., i, 2] for i in range(3))
        scale = self.view.focal_px / ahead
        return np.stack([across * scale + middle[0], down * scale + middle[1]], -1)


def pinhole_view(camera: Camera, shutter: ShutterSpec) -> PinholeView:
    """The smallest pinhole view that shows every ray of a camera's picture, whenever it is taken."""
    width, height = (int(size) for size in camera.size_px[0])
    turn_rad_s = turn_of(shutter)
    focal = float(focal_px(camera).mean())
    if _is_pinhole(camera) and not turn_rad_s.any():
        return PinholeView(width, height, focal)
    border = _border(width, height)
    xy = _undistorted(border, camera)
    slopes = distortion_jacobian(torch.from_numpy(xy)[None], camera.distortion.double())
    magnification = float(determinant_2x2(slopes).sqrt().max())
    focal *= min(max(magnification, 1.0), MAX_MAGNIFICATION)
    middle_s = shutter.readout_s * (border[:, 1] / max(height - 1, 1) - 0.5)
    rays = np.concatenate([xy, np.ones_like(xy[:, :1])], 1)
    reach = np.zeros(2)
    for offset_s in (-shutter.exposure_s / 2, shutter.exposure_s / 2):
        turned = np.einsum("nij,nj->ni", rotations(turn_rad_s, middle_s + offset_s), rays)
        if turned[:, 2].min() <= 0:
            raise ValueError("the camera turns too far in one exposure for a pinhole to show all of it")
        reach = np.maximum(reach, np.abs(turned[:, :2] / turned[:, 2:]).max(0))
    half = np.ceil(reach * focal).astype(int) + MARGIN_PX
    return PinholeView(int(2 * half[0]), int(2 * half[1]), focal)


def view_limits(camera: Camera, shutter: ShutterSpec) -> tuple[float, float]:
    """The steepest depression below the horizontal and the largest azimuth to either side that the pinhole shows."""
    view = pinhole_view(camera, shutter)
    xy = (_border(view.width, view.height) - [(view.width - 1) / 2, (view.height - 1) / 2]) / view.focal_px
    rays = np.concatenate([xy, np.ones_like(xy[:, :1])], 1) @ camera_from_world(camera)
    steepest = np.arctan2(-rays[:, 2], np.hypot(rays[:, 0], rays[:, 1])).max()
    below = rays[:, 2] < 0  # rays into the sky see no water
    aside = np.abs(np.arctan2(rays[below, 0], rays[below, 1])).max() if below.any() else 0.0
    return float(steepest), float(aside)


def _border(width: int, height: int) -> Doubles:
    """The outer edges of a picture's pixels, one point a pixel."""
    u, v = np.arange(-0.5, width, 1.0), np.arange(-0.5, height, 1.0)
    sides = [np.stack(np.broadcast_arrays(u, edge), -1) for edge in (-0.5, height - 0.5)]
    sides += [np.stack(np.broadcast_arrays(edge, v), -1) for edge in (-0.5, width - 0.5)]
    return np.concatenate(sides)


def _is_pinhole(camera: Camera) -> bool:
    K, size = camera.K[0], camera.size_px[0]
    centred = bool((centre_px(camera)[0, 0] == (size - 1) / 2).all())
    return centred and bool(K[0, 0] == K[1, 1]) and not bool(camera.distortion.any())


def _undistorted(pixels_px: Doubles, camera: Camera) -> Doubles:
    """Points (N, 2) on the plane z = 1 that pixels (N, 2) show.

    Raises:
        ValueError: the distortion has no inverse there.
    """
    found = undistort(torch.from_numpy(pixels_px)[None], camera)
    if not bool(found.valid.all()):
        u, v = pixels_px[int((~found.valid[0]).nonzero()[0, 0])]
        lens = camera.distortion[0].tolist()
        raise ValueError(f"the lens distortion {lens} cannot be undone at pixel ({u:.0f}, {v:.0f})")
    xy: Doubles = found.xy[0].numpy()
    return xy


LensKey = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


def _lens_key(camera: Camera) -> LensKey:
    K, distortion, size = (
        tuple(field[0].flatten().tolist()) for field in (camera.K, camera.distortion, camera.size_px)
    )
    return K, distortion, size


@functools.lru_cache(maxsize=8)
def _pixel_rays(key: LensKey) -> Doubles:
    """Points (H W, 2) on the plane z = 1 of every pixel; many frames share a lens."""
    K, distortion, (width, height) = key
    one = torch.ones(1, dtype=torch.float64)
    camera = Camera(
        torch.tensor(K, dtype=torch.float64).reshape(1, 3, 3),
        torch.tensor([distortion], dtype=torch.float64),
        torch.tensor([[width, height]], dtype=torch.float64),
        *[one] * 8,
    )
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    return _undistorted(np.stack([u, v], -1).reshape(-1, 2).astype(np.float64), camera)
