"""Trees, bushes and reeds: a few that are grown leaf by leaf, and as many turned and scaled copies as a shore wants."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usvnet.simulator.meshes import Floats, Mesh, ball, make_mesh, merge, tube

BARK = (0.055, 0.042, 0.030)
BIRCH = (0.36, 0.35, 0.32)
PINE_BARK = (0.15, 0.075, 0.040)
LEAF_ROUGHNESS = 0.75
FINE_TRIANGLES = 1200
"""A tree of fewer triangles goes without branches."""
COVERAGE = 0.9
"""Area of a crown's leaves over the area of its lobes."""


def leaves(centres_m: NDArray, outward: NDArray, size_m: float, colours: NDArray, rng: np.random.Generator) -> Mesh:
    """One triangular spray of leaves at each centre (N, 3).

    Args:
        centres_m: (N, 3)
        outward: (N, 3) unit vectors that the sprays face, give or take.
        size_m: length of a spray, one or (N,).
        colours: (N, 3)
        rng: turns each spray.
    """
    count = len(centres_m)
    facing = outward + 0.5 * rng.standard_normal((count, 3))
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    along = rng.standard_normal((count, 3))
    along -= (along * facing).sum(1, keepdims=True) * facing
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-9
    across = np.cross(facing, along)
    size = (size_m * rng.uniform(0.55, 1.45, count))[:, None]
    skew = rng.uniform(-0.3, 0.3, (count, 1))
    back = centres_m - 0.45 * size * along
    corners = np.stack([back - 0.5 * size * across, back + 0.5 * size * across, centres_m], 1)
    corners[:, 2] += size * (0.55 * along + skew * across)
    faces = np.arange(3 * count).reshape(-1, 3)
    return make_mesh(corners.reshape(-1, 3), faces, np.repeat(colours, 3, 0), LEAF_ROUGHNESS)


def leaf_colours(base: ArrayLike, depth: NDArray, height: NDArray, rng: np.random.Generator) -> NDArray:
    """(N, 3): darker inside the crown (``depth`` 0 at its skin, 1 at its heart) and low down (``height`` 0 to 1)."""
    light = (1 - 0.6 * depth) * (0.62 + 0.45 * height) * rng.uniform(0.7, 1.3, len(depth))
    yellow = rng.uniform(-0.12, 0.16, len(depth))
    return np.asarray(base) * light[:, None] * (1 + yellow[:, None] * [1, 0.35, -0.5])


def crowned_tree(rng: np.random.Generator, triangles: int, base: ArrayLike, shape: str, bark: ArrayLike = BARK) -> Mesh:
    """A tree 1 m high whose crown is made of lobes: ``round``, ``tall``, ``loose``, ``pine`` or ``bush``."""
    lobes, low, wide, fat = {
        "round": (11, 0.36, 0.30, 0.19),
        "tall": (10, 0.22, 0.075, 0.115),
        "loose": (12, 0.40, 0.20, 0.125),
        "pine": (6, 0.68, 0.17, 0.125),
        "bush": (7, 0.05, 0.42, 0.36),
    }[shape]
    rise = np.linspace(low + 0.3 * fat, 1 - fat * 0.8, lobes)
    belly = np.sin(np.pi * np.clip((rise - low) / (1 - low) * 0.8 + 0.17, 0, 1))
    turn = 2.4 * np.arange(lobes) + rng.uniform(0, 0.8, lobes)
    reach = wide * belly * rng.uniform(0.55, 1.1, lobes)
    middles = np.stack([reach * np.cos(turn), reach * np.sin(turn), rise], -1)
    radii = fat * (0.65 + 0.45 * belly) * rng.uniform(0.8, 1.2, lobes)
    flat = np.array([1, 1, 0.55 if shape == "pine" else 0.85])

    coarse = triangles < FINE_TRIANGLES
    parts = []
    for middle, radius in zip(middles, radii):  # a dark heart keeps the sky from shining through
        heart = ball(middle, 0.72 * radius * flat, 6, 3 if coarse else 4)
        rough = heart.vertices_m + rng.standard_normal(heart.vertices_m.shape) * 0.07 * radius
        parts.append(make_mesh(rough, heart.faces, np.asarray(base) * 0.3, LEAF_ROUGHNESS))
    thick = 0.014 if shape in ("loose", "pine") else 0.021
    if shape != "bush":
        lean = rng.uniform(-0.03, 0.03, 2)
        stem = np.array([[0, 0, -0.03], [*lean * 0.5, low * 0.8], [*lean, 0.86]])
        parts.append(tube(stem, [1.5 * thick, thick, 0.3 * thick], 6, colour=bark, rough=0.9))
        for middle in middles[: 0 if coarse else 7]:
            start = np.array([*lean * 0.6, max(middle[2] - 0.6 * np.hypot(*middle[:2]) - 0.05, low * 0.6)])
            knee = 0.5 * (start + middle) - [0, 0, 0.02]
            parts.append(
                tube([start, knee, middle], [0.55 * thick, 0.4 * thick, 0.2 * thick], 4, colour=bark, rough=0.9)
            )
    used = sum(len(part.faces) for part in parts)
    count = max(triangles - used, 80)

    share = radii**2 / (radii**2).sum()
    lobe = rng.choice(lobes, count, p=share)
    out = rng.standard_normal((count, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    out[:, 2] = np.where(rng.random(count) < 0.6, np.abs(out[:, 2]), out[:, 2])  # leaves turn to the light
    skin = rng.uniform(0.4, 1.3, count) ** 0.5
    centres = middles[lobe] + out * (radii[lobe] * skin)[:, None] * flat
    centres[:, 2] = np.maximum(centres[:, 2], 0.02)
    area = 4 * np.pi * (radii**2).sum()
    size = float(np.sqrt(COVERAGE * area / count / 0.45)) * (0.85 if shape == "loose" else 1.0)
    # A lobe at the crown's rim sees more sky than the flank that it turns to its neighbours.
    inner = np.clip(1 - np.hypot(centres[:, 0], centres[:, 1]) / (wide + fat), 0, 1)
    depth = np.clip(1.3 * (1.14 - skin), 0, 1) + 0.35 * inner * (1 - centres[:, 2])
    colours = leaf_colours(base, np.clip(depth, 0, 1), 0.5 + 0.5 * out[:, 2], rng)
    return merge([*parts, leaves(centres, out, size, colours, rng)])


def spruce(rng: np.random.Generator, triangles: int, base: ArrayLike) -> Mesh:
    """A conifer 1 m high: whorls of drooping boughs around a straight stem."""
    boughs = max(triangles // 5, 90)
    height = 0.07 + 0.91 * np.linspace(0, 1, boughs) ** 0.85
    reach = 0.205 * (1 - height) ** 0.85 * rng.uniform(0.75, 1.15, boughs) + 0.012
    turn = 2.4 * np.arange(boughs) + rng.uniform(0, 0.5, boughs)
    out = np.stack([np.cos(turn), np.sin(turn), np.zeros(boughs)], -1)
    side = np.stack([-np.sin(turn), np.cos(turn), np.zeros(boughs)], -1)
    root = np.stack([np.zeros(boughs), np.zeros(boughs), height + 0.25 * reach], -1)
    step, up = reach[:, None], np.array([0, 0, 1.0])
    droop = rng.uniform(0.10, 0.40, (boughs, 1))
    tip = root + step * (out - (droop + 0.25) * up)
    knee = root + 0.62 * step * (out - 0.7 * droop * up)
    half = 0.34 * min(1.0, (150 / boughs) ** 0.4) * step * side
    corners = np.stack(
        [root, knee + half - 0.14 * step * up, tip, knee - half - 0.14 * step * up, knee + 0.05 * step * up], 1
    )
    first = 5 * np.arange(boughs)[:, None]
    faces = np.concatenate([first + corner for corner in ([0, 4, 1], [4, 2, 1], [0, 3, 4], [4, 3, 2])])
    shade = rng.uniform(0.65, 1.3, (boughs, 1, 1)) * np.array([0.35, 0.9, 1.25, 0.9, 1.0])[:, None]
    colours = (np.asarray(base) * shade * np.ones((1, 1, 3))).reshape(-1, 3)
    needles = make_mesh(corners.reshape(-1, 3), faces, colours, LEAF_ROUGHNESS)
    stem = tube([[0, 0, -0.03], [0, 0, 0.5], [0, 0, 0.99]], [0.018, 0.011, 0.002], 5, colour=BARK, rough=0.9)
    angle = np.linspace(0, 2 * np.pi, 9)
    cone = np.stack([0.09 * np.cos(angle), 0.09 * np.sin(angle), np.full(9, 0.1)], -1)
    heart = make_mesh(
        np.concatenate([cone, [[0, 0, 0.92]]]),
        [[i, i + 1, 9] for i in range(8)],
        np.asarray(base) * 0.25,
        LEAF_ROUGHNESS,
    )
    return merge([needles, stem, heart])


def reed_clump(rng: np.random.Generator, triangles: int, base: ArrayLike) -> Mesh:
    """A clump of reeds 1 m high and as wide: bent blades, some with a plume."""
    count = max(triangles // 3, 20)
    foot = np.concatenate([rng.normal(0, 0.28, (count, 2)), np.full((count, 1), -0.15)], 1)
    height = rng.uniform(0.45, 1.0, (count, 1))
    lean = rng.normal(0, 0.13, (count, 2)) + rng.normal(0, 0.05, 2)
    middle = foot + np.concatenate([0.4 * lean, 0.6 * height + 0.08], 1)
    tip = foot + np.concatenate([lean * 1.3, height + 0.1], 1)
    turn = rng.uniform(0, np.pi, count)
    side = 0.016 * np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], -1)
    corners = np.stack([foot - side, foot + side, middle + 1.2 * side, middle - 1.2 * side, tip], 1)
    first = 5 * np.arange(count)[:, None]
    faces = np.concatenate([first + corner for corner in ([0, 1, 2], [0, 2, 3], [3, 2, 4])])
    dry = rng.uniform(0, 1, (count, 1, 1)) ** 2
    blade = (np.asarray(base) * (1 - dry) + np.array([0.26, 0.20, 0.10]) * dry) * rng.uniform(0.7, 1.3, (count, 1, 1))
    colours = blade * np.array([0.35, 0.35, 1.0, 1.0, 1.15])[:, None]
    return make_mesh(corners.reshape(-1, 3), faces, colours.reshape(-1, 3), LEAF_ROUGHNESS)


def plant(
    kinds: Sequence[Mesh],
    which: NDArray,
    feet_m: NDArray,
    heights_m: NDArray,
    rng: np.random.Generator,
    tint: float = 0.2,
) -> Mesh:
    """Copies of meshes that are 1 m high, turned about their stems.

    Args:
        kinds: the meshes to copy.
        which: (N,) the mesh of each copy.
        feet_m: (N, 3) where it stands.
        heights_m: (N,)
        rng: turns, widens and tints each copy.
        tint: how much copies differ in brightness.

    Raises:
        ValueError: there is nothing to plant.
    """
    if not len(which):
        raise ValueError("there is nothing to plant")
    turn, wide = rng.uniform(0, 2 * np.pi, len(which)), rng.uniform(0.8, 1.25, len(which))
    shade = rng.uniform(1 - tint, 1 + tint, (len(which), 1)) * rng.uniform(0.92, 1.08, (len(which), 3))
    groups: list[tuple[Floats, NDArray, Floats]] = []
    start = 0
    for number, kind in enumerate(kinds):
        mine = np.flatnonzero(which == number)
        if not len(mine):
            continue
        across, height = (heights_m * wide)[mine].astype(np.float32), heights_m[mine].astype(np.float32)
        cos, sin = np.cos(turn[mine]).astype(np.float32) * across, np.sin(turn[mine]).astype(np.float32) * across
        x, y, z = kind.vertices_m.T[:, None]
        feet = feet_m[mine].astype(np.float32)
        points = np.stack(
            [
                x * cos[:, None] - y * sin[:, None] + feet[:, :1],
                x * sin[:, None] + y * cos[:, None] + feet[:, 1:2],
                z * height[:, None] + feet[:, 2:],
            ],
            -1,
        )
        colours = kind.colours * shade[mine, None].astype(np.float32)
        size = len(kind.vertices_m)
        offsets = start + size * np.arange(len(mine))[:, None, None]
        groups.append((points.reshape(-1, 3), (kind.faces[None] + offsets).reshape(-1, 3), colours.reshape(-1, 3)))
        start += size * len(mine)
    vertices, faces, colours = (np.concatenate([group[part] for group in groups]) for part in range(3))
    return make_mesh(vertices, faces, np.clip(colours, 0.004, 0.8), LEAF_ROUGHNESS)


def distant_tree(rng: np.random.Generator, triangles: int, base: ArrayLike) -> Mesh:
    """A crown of few triangles, 1 m high, for the back of a wood."""
    heart = ball([0, 0, 0.52], [0.23, 0.23, 0.40], 6, 4, colour=np.asarray(base) * 0.35, rough=LEAF_ROUGHNESS)
    count = max(triangles - len(heart.faces), 30)
    out = rng.standard_normal((count, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    bumps = 1 + 0.22 * np.sin(3.1 * out[:, :2] @ [1, 0.6] + rng.uniform(0, 6)) * np.cos(
        5 * out[:, 2] + rng.uniform(0, 6)
    )
    skin = rng.uniform(0.6, 1.05, count)
    centres = [0, 0, 0.54] + out * [0.29, 0.29, 0.44] * (bumps * skin)[:, None]
    colours = leaf_colours(base, np.clip(1.05 - skin, 0, 1), 0.5 + 0.5 * out[:, 2], rng)
    return merge([heart, leaves(centres, out, float(np.sqrt(2.2 / count / 0.45)), colours, rng)])
