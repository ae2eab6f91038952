"""Houses, blocks of flats, churches and sheds: walls with rows of windows under a roof."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usvnet.simulator.meshes import Mesh, box, make_mesh, merge, tube

PLASTERS = np.array(
    [
        [0.62, 0.59, 0.52],
        [0.55, 0.42, 0.26],
        [0.50, 0.33, 0.24],
        [0.38, 0.44, 0.46],
        [0.66, 0.65, 0.62],
        [0.42, 0.40, 0.36],
    ]
)
BRICKS = np.array([[0.26, 0.095, 0.060], [0.20, 0.105, 0.075], [0.31, 0.165, 0.095]])
TILES = np.array([[0.27, 0.080, 0.045], [0.20, 0.072, 0.045], [0.085, 0.085, 0.092], [0.12, 0.095, 0.080]])
SHEETS = np.array([[0.33, 0.36, 0.38], [0.12, 0.20, 0.27], [0.30, 0.10, 0.075], [0.20, 0.26, 0.20], [0.46, 0.45, 0.42]])
FRAMES = np.array([[0.65, 0.65, 0.62], [0.16, 0.11, 0.08], [0.30, 0.31, 0.31]])
GLASS_ROUGHNESS, WALL_ROUGHNESS = 0.08, 0.9


@dataclass(frozen=True)
class Facade:
    """How a building's walls are pierced."""

    storey_m: float
    bay_m: float
    window_m: tuple[float, float]
    """Width and height of a window."""


def windows(width_m: float, height_m: float, facade: Facade, frame: ArrayLike, rng: np.random.Generator) -> Mesh:
    """Rows of windows, framed, on a wall of the plane y = 0 around x = 0 that looks along -y."""
    across, up = max(int(width_m / facade.bay_m), 1), max(int(height_m / facade.storey_m), 1)
    x = (np.arange(across) + 0.5) / across * width_m - width_m / 2
    z = (np.arange(up) + 0.52) * height_m / up
    x, z = (grid.ravel() for grid in np.meshgrid(x, z))
    wide = min(facade.window_m[0], 0.75 * width_m / across) / 2
    high = min(facade.window_m[1], 0.75 * height_m / up) / 2
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners, colours = [], []
    for proud, border in ((0.03, 0.10), (0.05, 0.0)):
        points = np.stack(
            np.broadcast_arrays(
                x[:, None] + square[:, 0] * (wide + border),
                np.float64(-proud),
                z[:, None] + square[:, 1] * (high + border),
            ),
            -1,
        )
        corners.append(points.reshape(-1, 3))
        if border:
            colours.append(np.broadcast_to(frame, points.shape))
        else:
            pane = np.array([0.030, 0.036, 0.042]) * rng.uniform(0.5, 1.5, (len(x), 1))
            curtain = rng.random((len(x), 1)) < 0.2
            pane = np.where(curtain, [[0.26, 0.25, 0.22]] * rng.uniform(0.5, 1.2, (len(x), 1)), pane)
            colours.append(np.repeat(pane[:, None], 4, 1))
    first = 4 * np.arange(2 * len(x))[:, None]
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    colour = np.concatenate([each.reshape(-1, 3) for each in colours])
    mesh = make_mesh(np.concatenate(corners), faces, colour, 0.5)
    mesh.roughness[len(mesh.roughness) // 2 :] = GLASS_ROUGHNESS
    return mesh


def walls(size_m: NDArray, colour: ArrayLike, rough: float = WALL_ROUGHNESS) -> Mesh:
    """The body (width, depth, height) of a house on z = 0, with a footing of 2 m for sloping ground."""
    width, depth, height = size_m
    return box([0, 0, height / 2 - 1], [width, depth, height + 2], colour=colour, rough=rough)


def quarter_turns(turns: int) -> NDArray[np.float64]:
    """Rotation (3, 3) about z by so many right angles."""
    c, s = [(1, 0), (0, 1), (-1, 0), (0, -1)][turns % 4]
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def pierced(size_m: ArrayLike, facade: Facade, frame: ArrayLike, rng: np.random.Generator) -> list[Mesh]:
    """Windows on the front (-y) and both sides of a house (width, depth, height) that stands on z = 0."""
    width, depth, height = np.asarray(size_m, float)
    front = windows(width, height, facade, frame, rng).moved(np.eye(3), [0, -depth / 2, 0])
    side = windows(depth, height, facade, frame, rng)
    right = side.moved(quarter_turns(1), [width / 2, 0, 0])
    return [front, right, side.moved(quarter_turns(3), [-width / 2, 0, 0])]


def gable_roof(size_m: ArrayLike, rise_m: float, hip: float, tiles: ArrayLike, wall: ArrayLike) -> Mesh:
    """A roof with its ridge along x over a house (width, depth, height); ``hip`` 0 is a gable, 1 a full hip."""
    width, depth, height = np.asarray(size_m, float)
    eave = 0.35
    w, d, low = width / 2 + eave, depth / 2 + eave, height - eave * rise_m / (depth / 2)
    ridge = max(w - hip * d, 0.02)
    corners = [
        [-w, -d, low],
        [w, -d, low],
        [w, d, low],
        [-w, d, low],
        [-ridge, 0, height + rise_m],
        [ridge, 0, height + rise_m],
    ]
    slopes = [[0, 1, 5], [0, 5, 4], [2, 3, 4], [2, 4, 5]]
    ends = [[1, 2, 5], [3, 0, 4]]
    under = [[0, 2, 1], [0, 3, 2]]
    points = np.asarray(corners)
    tiled = make_mesh(points, slopes + under + (ends if hip > 0.2 else []), tiles, 0.8)
    if hip > 0.2:
        return tiled
    inner = points * [(width / 2) / w, 1, 1]
    return merge([tiled, make_mesh(inner, ends, wall, WALL_ROUGHNESS)])


def chimney(x_m: float, y_m: float, foot_m: float, rng: np.random.Generator) -> list[Mesh]:
    """A brick chimney with a pot."""
    high = rng.uniform(1.6, 2.6)
    brick = BRICKS[rng.integers(len(BRICKS))]
    pot = tube([[x_m, y_m, foot_m + high], [x_m, y_m, foot_m + high + 0.35]], 0.13, 6, colour=BRICKS[2], rough=0.9)
    return [box([x_m, y_m, foot_m + high / 2], [0.7, 0.6, high], colour=brick, rough=0.9), pot]


def house(rng: np.random.Generator) -> Mesh:
    """One to three storeys under a tiled roof with chimneys; the front looks along -y, the ground is z = 0."""
    storeys = int(rng.integers(1, 4))
    width, depth = rng.uniform(7, 14), rng.uniform(7, 10)
    size = np.array([width, depth, 2.9 * storeys + 0.5])
    wall = (PLASTERS if rng.random() < 0.65 else BRICKS)[rng.integers(3)] * rng.uniform(0.85, 1.15, 3)
    tiles = TILES[rng.integers(len(TILES))] * rng.uniform(0.8, 1.2)
    rise = depth / 2 * rng.uniform(0.55, 1.0)
    frame = FRAMES[rng.integers(len(FRAMES))]
    facade = Facade(2.9, rng.uniform(1.9, 2.8), (rng.uniform(0.8, 1.2), rng.uniform(1.1, 1.5)))
    parts = [walls(size, wall)]
    parts += [
        gable_roof(size, rise, float(rng.choice([0.0, 0.0, 0.9])), tiles, wall),
        *pierced(size, facade, frame, rng),
    ]
    parts += chimney(rng.uniform(-0.35, 0.35) * width, 0.6, size[2] + 0.6 * rise, rng)
    parts.append(
        box(
            [rng.uniform(-0.3, 0.3) * width, -depth / 2, 1.05],
            [1.1, 0.16, 2.1],
            colour=TILES[rng.integers(4)],
            rough=0.6,
        )
    )
    mesh = merge(parts)
    return mesh.moved(quarter_turns(1), [0, 0, 0]) if rng.random() < 0.3 else mesh


def flats(rng: np.random.Generator) -> Mesh:
    """Four to eight storeys under a flat roof, with balconies."""
    storeys = int(rng.integers(4, 9))
    width, depth = rng.uniform(14, 30), rng.uniform(11, 15)
    size = np.array([width, depth, 2.9 * storeys])
    wall = PLASTERS[rng.integers(len(PLASTERS))] * rng.uniform(0.75, 1.1)
    facade = Facade(2.9, rng.uniform(2.6, 3.6), (rng.uniform(1.2, 2.0), rng.uniform(1.2, 1.6)))
    parts = [walls(size, wall)]
    parts += pierced(size, facade, FRAMES[rng.integers(len(FRAMES))], rng)
    parts.append(box([0, 0, size[2] + 0.3], [width + 0.2, depth + 0.2, 0.6], colour=wall * 0.75, rough=0.9))
    parts.append(box([rng.uniform(-0.3, 0.3) * width, 0, size[2] + 1.4], [4, 4, 2.6], colour=wall * 0.9, rough=0.9))
    columns = np.arange(0.1, 0.95, rng.uniform(0.22, 0.45)) * width - width / 2
    rail = SHEETS[rng.integers(len(SHEETS))]
    for x in columns:
        for storey in range(1, storeys):
            z = 2.9 * storey + 0.2
            parts.append(box([x + 1.4, -depth / 2 - 0.6, z], [2.8, 1.2, 0.18], colour=wall * 0.8, rough=0.9))
            parts.append(box([x + 1.4, -depth / 2 - 1.17, z + 0.55], [2.8, 0.06, 0.9], colour=rail, rough=0.5))
    return merge(parts)


def church(rng: np.random.Generator) -> Mesh:
    """A nave and a tower with a pointed roof."""
    wall = PLASTERS[rng.integers(len(PLASTERS))] * rng.uniform(0.75, 1.0)
    tiles = TILES[rng.integers(len(TILES))]
    nave, side = np.array([16.0, 9.0, 7.0]), rng.choice([-1.0, 1.0])
    tall = rng.uniform(16, 26)
    tower = np.array([5.0, 5.0, tall])
    facade = Facade(7.0, 3.2, (0.9, 3.2))
    spire = rng.uniform(5, 14)
    parts = [
        walls(nave, wall),
        gable_roof(nave, 5.5, 0, tiles, wall),
    ]
    parts += pierced(nave, facade, wall * 0.7, rng)
    at = [side * 10, 0, 0]
    body = [walls(tower, wall)]
    body += pierced(tower, Facade(6.0, 4.0, (0.8, 2.2)), wall * 0.7, rng)
    body.append(box([0, 0, tall + spire / 2], [5.4, 5.4, spire], (0.03, 0.03), colour=tiles, rough=0.7))
    return merge(parts + [part.moved(np.eye(3), at) for part in body])


def shed(rng: np.random.Generator) -> Mesh:
    """A low hall of sheet metal with gates."""
    size = np.array([rng.uniform(16, 34), rng.uniform(10, 16), rng.uniform(4.5, 8)])
    sheet = SHEETS[rng.integers(len(SHEETS))] * rng.uniform(0.8, 1.2)
    roof = SHEETS[rng.integers(len(SHEETS))] * 0.8
    parts = [walls(size, sheet, 0.6)]
    parts.append(gable_roof(size, rng.uniform(1.2, 2.4), 0, roof, sheet))
    gates, gate = int(size[0] // 8), SHEETS[rng.integers(len(SHEETS))] * rng.uniform(0.35, 0.8)
    for x in (np.arange(gates) + 0.5) / gates * size[0] - size[0] / 2:
        tall = 0.62 * size[2]
        parts.append(box([x, -size[1] / 2, tall / 2], [4.2, 0.14, tall], colour=gate, rough=0.6))
    strip = windows(size[0], 1.4, Facade(1.4, 2.4, (1.9, 0.8)), FRAMES[2], rng)
    parts.append(strip.moved(np.eye(3), [0, -size[1] / 2, size[2] - 1.6]))
    return merge(parts)
