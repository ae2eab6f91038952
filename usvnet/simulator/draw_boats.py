"""The boats of a dataset, and where they stand in a frame: in view, of a fitting size, out of each other's way."""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from usvnet.geometry.camera import project
from usvnet.geometry.hull_files import load_hull
from usvnet.geometry.rays import level_rotation
from usvnet.simulator.fleet_settings import HullSettings
from usvnet.simulator.frame_spec import BoatSpec, HullSpec
from usvnet.simulator.settings import BoatSettings
from usvnet.types import Camera

Doubles = NDArray[np.float64]

OUTLINE = np.array([[x, y, z] for x in (-0.6, 0.52) for y in (-0.28, 0.28) for z in (-0.05, 0.54)])
"""Corners (8, 3) of a box around any boat with a hull of one metre: outboards, masts and all."""
MARGIN_PX = 4.0
"""Between a whole boat and the edge of the picture: waves lift it, the camera's own waves do not."""
CUT_SHARE = (0.3, 0.8)
"""How much of the width of a truncated boat lies in the picture."""
CANDIDATES = 48
"""Places tried at once."""


@dataclass(frozen=True)
class OwnedHull:
    """One hull of the dataset."""

    spec: HullSpec
    entry: str
    share: float
    fixed_paint: bool


def make_hulls(settings: dict[str, HullSettings]) -> list[OwnedHull]:
    """Draw the hulls of every entry.

    Raises:
        ValueError: a file of keypoints cannot be read, or two hulls have the same name.
    """
    hulls: dict[str, OwnedHull] = {}
    for entry, hull in settings.items():
        rng = np.random.default_rng([hull.seed, *entry.encode()])
        for i in range(hull.count):
            name = entry if hull.count == 1 else f"{entry}-{i}"
            if name in hulls:
                raise ValueError(f"hulls: two are called {name}")
            spec = _draw_hull(name, hull, (i + rng.uniform()) / hull.count, int(rng.integers(2**31)))
            hulls[name] = OwnedHull(spec, entry, hull.share / hull.count, hull.paint == "fixed")
    return list(hulls.values())


def _draw_hull(name: str, hull: HullSettings, place: float, seed: int) -> HullSpec:
    if hull.length_m is not None:
        return HullSpec(name, hull.family, hull.length_m.low + place * (hull.length_m.high - hull.length_m.low), seed)
    assert hull.keypoints_file is not None
    points = load_hull(hull.keypoints_file).points_m[0].double().numpy()
    keypoints = tuple((float(x), float(y), float(z)) for x, y, z in points)
    return HullSpec(name, "mesh", float(np.ptp(points[:, 0])), seed, hull.mesh_file, keypoints)


def choose_hull(
    hulls: list[OwnedHull], length_px: tuple[float, float], px_per_m: float, rng: np.random.Generator
) -> OwnedHull | None:
    """One of the hulls that appear between ``length_px`` long where a metre has ``px_per_m``; None if there is none."""
    low, high = length_px
    shares = np.array([hull.share * (low <= hull.spec.length_m * px_per_m <= high) for hull in hulls])
    if not shares.sum() > 0:
        return None
    return hulls[int(rng.choice(len(hulls), p=shares / shares.sum()))]


def pixels_of(points_m: Doubles, camera: Camera) -> Doubles:
    """Pixels (..., 2) of points (..., 3) of the world frame; NaN where there is none."""
    height_m = camera.height_m.item()
    level = np.stack([points_m[..., 0], height_m - points_m[..., 2], points_m[..., 1]], -1).reshape(1, -1, 3)
    rotation = level_rotation(camera.pitch_rad, camera.roll_rad)
    pixels: Doubles = project(torch.from_numpy(level) @ rotation, camera)[0].numpy()
    return pixels.reshape(*points_m.shape[:-1], 2)


@dataclass(frozen=True)
class Place:
    """A round patch of water that is taken."""

    x_m: float
    y_m: float
    radius_m: float

    def leaves(self, x_m: Doubles, y_m: Doubles, radius_m: float, gap_m: float) -> NDArray[np.bool_]:
        """Whether patches around (N,) points stay at least ``gap_m`` off."""
        return np.hypot(x_m - self.x_m, y_m - self.y_m) >= self.radius_m + radius_m + gap_m


def place_boat(
    hull: HullSpec,
    distance_m: float,
    truncated: bool,
    camera: Camera,
    half_width_rad: float,
    taken: list[Place],
    rng: np.random.Generator,
) -> BoatSpec | None:
    """A boat that lies still at a free place of the picture, or None where none was found.

    Args:
        hull: what to place.
        distance_m: from below the camera to its middle.
        truncated: cut by the left or right edge of the picture, or whole inside it.
        camera: the true one.
        half_width_rad: half the camera's horizontal field of view.
        taken: where other boats are; at least the longer boat's length stays free in between.
        rng: where the choices come from.
    """
    length_m = hull.length_m
    yaw_rad = float(rng.uniform(-math.pi, math.pi))
    if truncated:
        edge = _edges(distance_m, camera, half_width_rad)[int(rng.integers(2))]
        bearings = edge + rng.uniform(-0.5, 0.5, CANDIDATES) * length_m / distance_m
    else:
        bearings = rng.uniform(-1, 1, CANDIDATES) * half_width_rad
    x, y = distance_m * np.sin(bearings), distance_m * np.cos(bearings)
    turn = np.array([[math.cos(yaw_rad), -math.sin(yaw_rad), 0], [math.sin(yaw_rad), math.cos(yaw_rad), 0], [0, 0, 1]])
    outlines = (OUTLINE * length_m) @ turn.T + np.stack([x, y, np.zeros_like(x)], -1)[:, None]
    fits = _fits(pixels_of(outlines, camera), camera, truncated)
    for other in taken:
        fits &= other.leaves(x, y, length_m / 2, max(length_m, 2 * other.radius_m))
    if not fits.any():
        return None
    i = int(np.argmax(fits))
    return BoatSpec(hull, 0, float(x[i]), float(y[i]), yaw_rad, 0.0, 0.0, 0.0, 0.0)


def _fits(pixels: Doubles, camera: Camera, truncated: bool) -> NDArray[np.bool_]:
    """Whether outlines (N, 8, 2) are whole inside the picture, or cut at one side as they should be."""
    width, height = camera.size_px[0].tolist()
    u, v = pixels[..., 0], pixels[..., 1]
    with np.errstate(invalid="ignore"):
        fits = np.isfinite(u).all(-1) & (v.min(-1) >= MARGIN_PX) & (v.max(-1) <= height - 1 - MARGIN_PX)
        left, right = u.min(-1), u.max(-1)
        if not truncated:
            return fits & (left >= MARGIN_PX) & (right <= width - 1 - MARGIN_PX)
        seen = (np.minimum(right, width - 0.5) - np.maximum(left, -0.5)) / (right - left)
        return fits & (seen >= CUT_SHARE[0]) & (seen <= CUT_SHARE[1])


def _edges(distance_m: float, camera: Camera, half_width_rad: float) -> tuple[float, float]:
    """Azimuths at which water ``distance_m`` away crosses the left and the right edge of the picture."""
    azimuths = np.linspace(-1, 1, 64) * min(1.6 * half_width_rad, 1.4)
    points = np.stack([distance_m * np.sin(azimuths), distance_m * np.cos(azimuths), np.zeros_like(azimuths)], -1)
    u = pixels_of(points, camera)[:, 0]
    known = np.isfinite(u)
    left, right = np.interp([-0.5, camera.size_px[0, 0].item() - 0.5], u[known], azimuths[known])
    return float(left), float(right)


def set_afloat(boat: BoatSpec, hull: OwnedHull, settings: BoatSettings, rng: np.random.Generator) -> BoatSpec:
    """The boat with its paint, its speed and its own motion in the waves."""
    paint_seed, moving = int(rng.integers(2**31)), rng.uniform() < settings.moving_share
    speed_mps = settings.speed_mps.draw(rng)
    return replace(
        boat,
        paint_seed=hull.spec.seed if hull.fixed_paint else paint_seed,
        roll_rad=float(rng.normal(0, math.radians(settings.roll_std_deg))),
        pitch_rad=float(rng.normal(0, math.radians(settings.pitch_std_deg))),
        heave_m=float(rng.normal(0, settings.heave_std_m)),
        speed_mps=speed_mps if moving else 0.0,
    )
