"""The ground at the far end of the water: where the waterline runs, how high the bank is, hills behind it."""

import functools
import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usvnet.simulator.meshes import Floats, Mesh, make_mesh, merge, sheet
from usvnet.simulator.noise import noise_tile, sample_tile

PAVED_M = 60.0
"""Width of the pavement behind a quay's wall."""
COLUMNS = 320
"""Vertices of the bank along the shore."""
STEEPEST_RAD = 1.15
"""How far a straight quay is followed to the side."""
SOILS = np.array([[0.26, 0.24, 0.21], [0.14, 0.105, 0.065], [0.30, 0.26, 0.18]])
"""Stones, earth, sand."""


@dataclass(frozen=True)
class Land:
    """A bank behind a waterline. ``behind_m`` is how far inland of the waterline a point is, seen from the camera."""

    distance_m: float
    bank_m: float
    """Height of the bank's edge."""
    half_azimuth_rad: float
    quay_azimuth_rad: float | None
    """Where a straight quay is square to the line of sight; None for a winding natural bank."""
    relief: Floats
    """(512, 512) noise tile."""
    soil: NDArray[np.float64]
    """(3,) colour of the bare bank."""
    grass: NDArray[np.float64]
    """(3,) colour of what grows on it."""

    def waterline_m(self, azimuth_rad: NDArray) -> NDArray[np.float64]:
        """Horizontal distance of the waterline, any shape."""
        if self.quay_azimuth_rad is not None:
            return self.distance_m / np.cos(np.clip(azimuth_rad - self.quay_azimuth_rad, -STEEPEST_RAD, STEEPEST_RAD))
        winding = self.noise(np.asarray(azimuth_rad) * 75, 7.0) - 0.5
        return self.distance_m * (1 + 0.16 * winding.astype(float))

    def height_m(self, azimuth_rad: NDArray, behind_m: NDArray) -> NDArray[np.float64]:
        """Height of the ground above mean water."""
        bank = self.bank_m
        if self.quay_azimuth_rad is not None:
            return np.interp(behind_m, [0, PAVED_M, 400], [bank, bank, bank + 2]) + 0 * azimuth_rad
        steps = np.array([-1.2, 0, 0.7 * bank, 1.8 * bank, 3.5 * bank, 3.5 * bank + 30, 3.5 * bank + 300])
        level = np.interp(behind_m, steps, bank * np.array([0, 0, 0.45, 0.9, 1.0, 1.2, 2.0]) - [0.6, 0, 0, 0, 0, 0, 0])
        x, y = azimuth_rad * self.distance_m * self.fineness, behind_m * self.fineness
        rough = self.noise(x * 1.1, y * 1.3) + 0.6 * self.noise(x * 4.3, y * 5.1) - 0.8
        return level + 0.5 * bank * rough * np.clip(np.asarray(behind_m) / bank + 0.25, 0, 1)

    def point_m(self, azimuth_rad: NDArray, behind_m: NDArray) -> NDArray[np.float64]:
        """Points (N, 3) on the ground for azimuths and distances inland (N,)."""
        reach = self.waterline_m(azimuth_rad) + behind_m
        height = self.height_m(azimuth_rad, behind_m)
        return np.stack([reach * np.sin(azimuth_rad), reach * np.cos(azimuth_rad), height], -1)

    def place(self, mesh: Mesh, azimuth_rad: float, behind_m: float, turn_rad: float = 0.0) -> Mesh:
        """A mesh put on the ground so that its -y side looks at the camera, give or take a turn."""
        angle = turn_rad - azimuth_rad
        c, s = np.cos(angle), np.sin(angle)
        point = self.point_m(np.array([azimuth_rad]), np.array([behind_m]))[0]
        return mesh.moved([[c, -s, 0], [s, c, 0], [0, 0, 1]], point)

    @property
    def fineness(self) -> float:
        """How much finer the ground's pattern is drawn on a near shore."""
        return max(1.0, 60 / self.distance_m)

    def noise(self, x: NDArray, y: ArrayLike) -> Floats:
        """The relief tile at texels x and y, any shapes that go together."""
        x, y = np.broadcast_arrays(x, y)
        return sample_tile(self.relief, np.asarray(x, float), np.asarray(y, float), smooth=False)


def make_land(
    distance_m: float, half_azimuth_rad: float, quay_azimuth_rad: float | None, rng: np.random.Generator
) -> Land:
    """A bank of a natural or, with a quay, of a man-made height."""
    bank = rng.uniform(1.2, 2.8) if quay_azimuth_rad is not None else rng.uniform(0.3, 1.3)
    if distance_m > 150 and quay_azimuth_rad is None:
        bank = rng.uniform(0.8, 3.0)
    grass = np.array([0.085, 0.12, 0.038]) * rng.uniform(0.7, 1.2) * rng.uniform(0.9, 1.15, 3)
    return Land(
        distance_m,
        float(bank),
        half_azimuth_rad,
        quay_azimuth_rad,
        noise_tile(512, 1.6, rng, lowest=2),
        SOILS[rng.integers(len(SOILS))] * rng.uniform(0.8, 1.1),
        grass,
    )


def bank_mesh(land: Land) -> Mesh:
    """The bank from below the water to 300 m inland: bare and wet at its foot, overgrown above."""
    inland_m = np.array([2, 5, 10, 20, 40, 100, 300])
    behind = np.concatenate([np.linspace(-1.2, 3.5 * land.bank_m, 18), 3.5 * land.bank_m + inland_m])
    if land.quay_azimuth_rad is not None:
        behind = PAVED_M - 0.5 + inland_m
    azimuth, inland = np.meshgrid(np.linspace(-1, 1, COLUMNS) * land.half_azimuth_rad, behind)
    points = land.point_m(azimuth.ravel(), inland.ravel()).reshape(*azimuth.shape, 3)
    x, y = azimuth * land.distance_m * land.fineness, inland * land.fineness
    patches, grain = land.noise(x * 1.7, y * 2.3 + 100), land.noise(x * 9.1, y * 11.3 + 200)
    green = np.clip((points[..., 2] / land.bank_m - 0.35 + 1.2 * (patches - 0.5)) / 0.2, 0, 1)[..., None]
    wet = np.where(points[..., 2] < 0.08 + 0.05 * land.bank_m, 0.45, 1.0)[..., None]
    colours = (land.soil * (1 - green) + land.grass * green) * (0.45 + 1.1 * grain[..., None]) * wet
    mesh = sheet(points, rough=0.9, flip=True)
    return mesh.painted(np.clip(colours, 0.004, 0.8).reshape(-1, 3))


def hills_mesh(land: Land, eye_m: float, rng: np.random.Generator) -> Mesh:
    """One or two wooded ridges that close the view; their crests stand above the horizon of the camera."""
    azimuth = np.linspace(-1, 1, 600) * land.half_azimuth_rad
    rolling = noise_tile(256, 3.2, rng, lowest=3)
    ridges = []
    for number in range(int(rng.integers(1, 3))):
        reach = max(6 * land.distance_m, 900.0) * (1 + 0.8 * number)
        shape = sample_tile(rolling, azimuth * rng.uniform(40, 110), np.full_like(azimuth, 9.0 + 50 * number)) - 0.25
        trees = land.noise(azimuth * 2600, 31.0 + 50 * number) + 0.5 * land.noise(azimuth * 9000, 77.0)
        crest = eye_m + reach * (0.006 + (0.02 + 0.03 * number) * np.clip(shape, 0, 1)) + 7 * (trees - 0.4)
        levels = np.stack([np.full_like(crest, -5), 0.6 * crest, crest])
        x, y = reach * np.sin(azimuth), reach * np.cos(azimuth)
        points = np.stack([np.broadcast_to(x, levels.shape), np.broadcast_to(y, levels.shape), levels], -1)
        colour = np.array([0.040, 0.058, 0.034]) * rng.uniform(0.8, 1.2)
        shade = 0.6 + 0.8 * np.stack([trees, np.roll(trees, 7), trees])[..., None] / 1.5
        ridges.append(sheet(points, rough=0.9, flip=True).painted((colour * shade).reshape(-1, 3)))
    return merge(ridges)


def rock(rng: np.random.Generator, colour: ArrayLike) -> Mesh:
    """A stone about 1 m across that sits on z = 0, cut by random planes."""
    grid, faces = spiral(26)
    cuts = rng.standard_normal((9, 3))
    cuts /= np.linalg.norm(cuts, axis=1, keepdims=True)
    reach = np.min(rng.uniform(0.55, 0.85, 9)[:, None] / np.maximum(cuts @ grid.T, 0.2), axis=0)
    points = grid * np.minimum(reach, 1.0)[:, None] * [0.62, 0.5, 0.45] + [0, 0, 0.25]
    shade = rng.uniform(0.8, 1.15, (len(grid), 1)) * (0.75 + 0.35 * points[:, 2:])
    return make_mesh(points, faces, np.asarray(colour) * shade, 0.9)


@functools.cache
def spiral(count: int) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """Points (count, 3) of a golden spiral on the unit sphere and the triangles of their convex hull."""
    turn, polar = 2.4 * np.arange(count), np.arccos(1 - 2 * (np.arange(count) + 0.5) / count)
    points = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], -1)
    a, b, c = np.array(list(itertools.combinations(range(count), 3))).T
    normal = np.cross(points[b] - points[a], points[c] - points[a])
    side = np.einsum("fk,fvk->fv", normal, points[None] - points[a][:, None])
    corners = np.stack([a, b, c], -1)
    outward, inward = (side < 1e-9).all(1), (side > -1e-9).all(1)
    return points, np.concatenate([corners[outward], corners[inward][:, ::-1]]).astype(np.uint32)
