"""Buoys, piles and marks that stand or float on the water."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import ClutterSpec
from usvnet.simulator.meshes import Mesh, ball, box, merge, tube
from usvnet.simulator.noise import noise_tile, sample_tile
from usvnet.simulator.shore import nothing

PAINTS = np.array(
    [
        [0.60, 0.045, 0.020],
        [0.020, 0.20, 0.060],
        [0.70, 0.46, 0.015],
        [0.72, 0.17, 0.010],
        [0.62, 0.62, 0.59],
        [0.03, 0.03, 0.033],
    ]
)
"""Red, green, yellow, orange, white, black."""
WEED = np.array([0.020, 0.026, 0.012])
STEEL = np.array([0.28, 0.29, 0.29])
WOODS = np.array([[0.16, 0.125, 0.090], [0.11, 0.082, 0.058], [0.21, 0.19, 0.165]])


def build_clutter(specs: Sequence[ClutterSpec], height_at: Callable[[NDArray, NDArray], NDArray]) -> Mesh:
    """All things on the water in one mesh, in the world frame.

    Args:
        specs: what floats where; with none, the mesh is one triangle far below the water.
        height_at: the water's height (N,) at x and y (N,), metres.

    Raises:
        ValueError: a kind is unknown or a size is not positive.
    """
    builders = {"buoy": buoy, "pile": pile, "marker": marker}
    for spec in specs:
        if spec.kind not in builders:
            raise ValueError(f"clutter is {spec.kind}, expected {', '.join(builders)}")
        if not spec.size_m > 0:
            raise ValueError(f"size_m of clutter is {spec.size_m}, expected more than 0")
    if not specs:
        return nothing()
    x, y = np.array([spec.x_m for spec in specs]), np.array([spec.y_m for spec in specs])
    levels = np.asarray(height_at(x, y), float)
    parts = []
    for spec, level in zip(specs, levels):
        rng = np.random.default_rng([spec.seed, 3])
        mesh = builders[spec.kind](spec.size_m, rng)
        afloat = spec.kind == "buoy"  # a pile stands on the ground, whatever the wave does
        parts.append(mesh.moved(tilted(rng, 0.12 if afloat else 0.035), [spec.x_m, spec.y_m, level if afloat else 0.0]))
    return merge(parts)


def tilted(rng: np.random.Generator, lean_rad: float) -> NDArray[np.float64]:
    """Rotation (3, 3): any heading, and a lean to any side of about ``lean_rad``."""
    heading, side, lean = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi), lean_rad * rng.standard_normal()
    c, s = np.cos(heading), np.sin(heading)
    axis = np.array([np.cos(side), np.sin(side), 0.0])
    across = np.array([[0, 0, axis[1]], [0, 0, -axis[0]], [-axis[1], axis[0], 0]])
    return (np.eye(3) + np.sin(lean) * across + (1 - np.cos(lean)) * across @ across) @ np.array(
        [[c, -s, 0], [s, c, 0], [0, 0, 1.0]]
    )


def weathered(mesh: Mesh, wet_m: float, rng: np.random.Generator) -> Mesh:
    """The mesh with stains and fading, and weed on what is below ``wet_m`` above its waterline."""
    grain = noise_tile(128, 1.4, rng, lowest=2)
    x, y, z = mesh.vertices_m.astype(float).T
    scale = 60 / max(float(np.ptp(z)), 1e-6)
    stain = sample_tile(grain, (x - y) * 4 * scale, z * scale + 20 * np.arctan2(y, x), smooth=False)
    colours = mesh.colours * (0.72 + 0.55 * stain[:, None]) + 0.015 * stain[:, None]
    weed = np.clip((wet_m * (0.6 + 0.8 * stain) - z) / (0.3 * wet_m), 0, 1)[:, None]
    roughness = mesh.roughness * (1 - 0.5 * weed[:, 0])
    colours = np.clip(colours * (1 - weed) + WEED * (0.5 + stain[:, None]) * weed, 0.003, 0.85)
    return Mesh(mesh.vertices_m, mesh.faces, colours.astype(np.float32), roughness.astype(np.float32))


def lathe(profile: Sequence[tuple[float, float]], colour: NDArray, sides: int = 24) -> Mesh:
    """A round body from (radius, height) pairs, bottom first."""
    radius, height = np.array(profile, float).T
    path = np.stack([np.zeros_like(height), np.zeros_like(height), height], -1)
    return tube(path, radius, sides, colour=colour, rough=0.35)


def striped(mesh: Mesh, colours: Sequence[NDArray], edges_m: Sequence[float]) -> Mesh:
    """Bands of paint around a body: one colour below the first edge, one between each, one above the last."""
    band = np.searchsorted(np.asarray(edges_m), mesh.vertices_m[:, 2] + 1e-6)
    return mesh.painted(np.asarray(colours)[band])


def buoy(size_m: float, rng: np.random.Generator) -> Mesh:
    """A mooring ball, a cone, a can or a spar that floats, with or without a topmark; ``size_m`` is its radius."""
    r = size_m
    shape = rng.choice(["ball", "cone", "can", "spar"], p=[0.4, 0.2, 0.25, 0.15])
    paint = PAINTS[{"cone": 1, "can": 0}.get(shape, int(rng.integers(len(PAINTS))))] * rng.uniform(0.8, 1.1)
    second = PAINTS[4 if paint[0] < 0.6 or paint[1] < 0.3 else 5]
    metal = {"colour": STEEL * rng.uniform(0.5, 1.2), "rough": 0.4}
    if shape == "ball":
        body = ball([0, 0, 0.35 * r], [r, r, 0.85 * r], 36, 26, colour=paint, rough=0.35)
        top = 1.2 * r
        body = striped(body, [paint, second, paint], [0.28 * r, 0.5 * r]) if rng.random() < 0.5 else body
        eye_x = 0.16 * r * np.cos(np.linspace(0, np.pi, 7))
        eye_z = top + 0.22 * r * np.sin(np.linspace(0, np.pi, 7))
        fittings = [tube(np.stack([eye_x, 0 * eye_x, eye_z], -1), 0.045 * r, 6, **metal)]
        fittings.append(tube([[0, 0, top - 0.06 * r], [0, 0, top + 0.03 * r]], 0.22 * r, 14, **metal))
    else:
        outlines = {
            "cone": [(0.9, -0.7), (1, -0.2), (1, 0.15), (0.86, 0.4), (0.55, 1.05), (0.3, 1.55), (0.14, 1.85)],
            "can": [(0.85, -0.7), (0.9, 0), (0.9, 0.35), (0.9, 0.75), (0.9, 1.15), (0.86, 1.5), (0.5, 1.56)],
            "spar": [(0.5, -1), (0.5, 0), (0.46, 0.6), (0.4, 1.2), (0.34, 1.9), (0.26, 2.7), (0.2, 3.4)],
        }
        fine = np.linspace(0, 6, 31)
        outline = np.array(outlines[shape]) * r
        body = lathe(
            [tuple(np.array([np.interp(fine, range(7), c) for c in outline.T])[:, i]) for i in range(31)], paint
        )
        top = outline[-1, 1]
        low, high = 0.42 * top, 0.68 * top
        body = striped(body, [paint, second, paint], [low, high]) if rng.random() < 0.45 else body
        collar = tube([[0, 0, -0.1 * r], [0, 0, 0.12 * r]], 1.08 * outline[1, 0], 24, colour=PAINTS[5], rough=0.8)
        fittings = (
            [collar] if rng.random() < 0.5 else [tube([[0, 0, top], [0, 0, top + 0.1 * r]], 0.12 * r, 8, **metal)]
        )
    if rng.random() < 0.55:
        fittings += topmark(top, r, paint, shape == "can", rng)
    return merge([weathered(body, 0.16 * r, rng), *fittings])


def topmark(foot_m: float, size_m: float, paint: NDArray, flat: bool, rng: np.random.Generator) -> list[Mesh]:
    """A staff with a can, a cone, a ball or a lamp at its top."""
    top = foot_m + size_m * rng.uniform(0.7, 1.4)
    parts = [tube([[0, 0, foot_m - 0.1 * size_m], [0, 0, top]], 0.05 * size_m, 8, colour=STEEL, rough=0.4)]
    kind = rng.choice(["mark", "ball", "lamp"])
    if kind == "lamp":
        parts.append(tube([[0, 0, top], [0, 0, top + 0.16 * size_m]], 0.13 * size_m, 10, colour=PAINTS[5], rough=0.5))
        parts.append(ball([0, 0, top + 0.24 * size_m], 0.12 * size_m, 10, 7, colour=PAINTS[4], rough=0.15))
    elif kind == "ball":
        parts.append(ball([0, 0, top], 0.24 * size_m, 14, 9, colour=paint, rough=0.4))
    else:
        radii = [0.22 * size_m, 0.22 * size_m] if flat else [0.28 * size_m, 0.02 * size_m]
        parts.append(tube([[0, 0, top - 0.1 * size_m], [0, 0, top + 0.4 * size_m]], radii, 14, colour=paint, rough=0.4))
    return parts


def pile(size_m: float, rng: np.random.Generator) -> Mesh:
    """One wooden pile or three leaning together: grey above, dark and weedy at the foot, six times ``size_m`` high."""
    wood = WOODS[rng.integers(len(WOODS))] * rng.uniform(0.8, 1.2)
    thick, tall = 0.225 * size_m, 6 * size_m * rng.uniform(0.85, 1.1)
    feet = [(0.0, 0.0)]
    if rng.random() < 0.3:
        feet = [(2.6 * thick * np.cos(a), 2.6 * thick * np.sin(a)) for a in (0.3, 2.4, 4.5)]
    depth = 1.0 + 2 * size_m
    z = np.linspace(0, 1, 40) ** 0.85 * (tall + depth) - depth
    parts = []
    for x, y in feet:
        lean = np.clip(z / tall, -1, 1)[:, None]
        path = np.concatenate([np.array([[x, y]]) * (1 - 0.62 * np.maximum(lean, 0)), z[:, None]], 1)
        bark = thick * (1 - 0.12 * np.maximum(lean[:, 0], 0)) * rng.uniform(0.97, 1.03, len(z))
        parts.append(weathered(tube(path, bark, 14, colour=wood, rough=0.9), 0.35 + 0.3 * size_m, rng))
    if len(feet) > 1:
        rope = tube([[0, 0, 0.78 * tall], [0, 0, 0.83 * tall]], 2.35 * thick, 14, colour=STEEL * 0.35, rough=0.8)
        parts.append(rope)
    elif rng.random() < 0.5:
        capped = rng.random() < 0.5
        cap = [1.12 * thick, 0.15 * thick if capped else 1.1 * thick]
        colour = PAINTS[rng.choice([4, 5, 0])] * 0.8
        parts.append(tube([[0, 0, tall], [0, 0, tall + thick]], cap, 14, colour=colour, rough=0.5))
    return merge(parts)


def marker(size_m: float, rng: np.random.Generator) -> Mesh:
    """A pole with a sign, or a lattice tower with bands of paint and a lamp; about nine times ``size_m`` high."""
    tall = 9 * size_m * rng.uniform(0.8, 1.1)
    paint = PAINTS[rng.integers(4)]
    if rng.random() < 0.5:
        pole = tube(
            np.stack([np.zeros(24), np.zeros(24), np.linspace(-1.5, tall, 24)], -1),
            0.16 * size_m, 12, colour=STEEL * rng.uniform(0.4, 1.2), rough=0.5,
        )  # fmt: skip
        wide = 1.6 * size_m * rng.uniform(0.8, 1.2)
        board = [box([0, -0.2 * size_m, 0.86 * tall], [wide, 0.05 * size_m, wide], colour=PAINTS[4], rough=0.5)]
        board.append(
            box([0, -0.23 * size_m, 0.86 * tall], [0.78 * wide, 0.05 * size_m, 0.78 * wide], colour=paint, rough=0.5)
        )
        board.append(
            box([0, -0.26 * size_m, 0.86 * tall], [0.6 * wide, 0.05 * size_m, 0.14 * wide], colour=PAINTS[4], rough=0.5)
        )
        turn = tilted(rng, 0.0)
        return merge([weathered(pole, 0.3 + 0.3 * size_m, rng), *[part.moved(turn, [0, 0, 0]) for part in board]])
    half, levels = 0.7 * size_m, np.linspace(-0.15, 0.85, 7) * tall
    narrow = np.interp(levels, [levels[0], levels[-1]], [1.0, 0.45]) * half
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    legs = np.concatenate([narrow[:, None, None] * corners, np.broadcast_to(levels[:, None, None], (7, 4, 1))], -1)
    bars = [tube(legs[:, corner], 0.07 * size_m, 6, colour=paint, rough=0.5) for corner in range(4)]
    for level in range(6):
        for corner in range(4):
            beside = (corner + 1) % 4
            bars.append(
                tube([legs[level, corner], legs[level + 1, beside]], 0.035 * size_m, 4, colour=paint, rough=0.5)
            )
            bars.append(
                tube([legs[level + 1, corner], legs[level + 1, beside]], 0.035 * size_m, 4, colour=paint, rough=0.5)
            )
    tower = striped(merge(bars), [paint, PAINTS[4], paint], [0.36 * tall, 0.6 * tall])
    deck = box([0, 0, 0.86 * tall], [1.1 * half, 1.1 * half, 0.06 * tall], colour=STEEL * 0.5, rough=0.6)
    cabin = tube([[0, 0, 0.88 * tall], [0, 0, tall]], 0.4 * half, 12, colour=paint, rough=0.4)
    lamp = ball([0, 0, tall + 0.15 * half], 0.25 * half, 12, 8, colour=PAINTS[4], rough=0.15)
    return merge([weathered(tower, 0.3 + 0.3 * size_m, rng), deck, cabin, lamp])
