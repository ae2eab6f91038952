"""What stands at the far end of the water: a bank with trees, a town or a harbour, and hills behind."""

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.buildings import church, flats, house, shed
from usvnet.simulator.frame_spec import ShoreSpec
from usvnet.simulator.harbour import build_harbour
from usvnet.simulator.land import Land, bank_mesh, hills_mesh, make_land, rock
from usvnet.simulator.meshes import Mesh, make_mesh, merge
from usvnet.simulator.noise import noise_tile, sample_tile
from usvnet.simulator.trees import BIRCH, PINE_BARK, crowned_tree, distant_tree, plant, reed_clump, spruce

TREE_TRIANGLES = 50_000
MOST_TREES = 100
DISTANT_TRIANGLES = 22_000
MOST_DISTANT_TREES = 330
GREENS = np.array([[0.060, 0.098, 0.030], [0.078, 0.112, 0.034], [0.092, 0.128, 0.044], [0.050, 0.078, 0.034]])
AUTUMN = np.array([[0.20, 0.105, 0.022], [0.16, 0.060, 0.020], [0.17, 0.13, 0.030]])


def nothing() -> Mesh:
    """One small triangle far below the water, for a renderer that wants a shape where there is none."""
    return make_mesh([[0, 0, -900], [1, 0, -900], [0, 1, -900]], [[0, 1, 2]], (0.1, 0.1, 0.1), 1.0)


def build_shore(spec: ShoreSpec, half_azimuth_rad: float, eye_m: float) -> Mesh:
    """The shore across the view, in the world frame; at most 120 000 triangles.

    Args:
        spec: what stands there and how far away its waterline is.
        half_azimuth_rad: how far to each side of straight ahead it reaches.
        eye_m: height of the camera, which decides how high the hills must be to stand above the horizon.

    Raises:
        ValueError: the kind is unknown, or a distance, the azimuth or the eye's height is not positive.
    """
    if spec.kind not in ("none", "trees", "town", "mixed", "harbour"):
        raise ValueError(f"shore is {spec.kind}, expected none, trees, town, mixed or harbour")
    if spec.kind == "none":
        return nothing()
    if not (spec.distance_m > 0 and 0 < half_azimuth_rad <= np.pi and eye_m > 0):
        raise ValueError(
            f"a shore wants positive numbers, got distance {spec.distance_m} m, half azimuth {half_azimuth_rad} rad, "
            f"eye {eye_m} m"
        )
    rng = np.random.default_rng([spec.seed, 2])
    quay = rng.uniform(-0.25, 0.25) if spec.kind == "harbour" else None
    land = make_land(spec.distance_m, half_azimuth_rad, quay, rng)
    parts = [bank_mesh(land), hills_mesh(land, eye_m, rng)]
    if spec.kind == "harbour":
        parts += build_harbour(land, rng)
        parts.append(woods(land, rng, thin=0.25, first_m=70.0))
    if spec.kind in ("town", "mixed"):
        parts += town(land, rng, crowded=1.0 if spec.kind == "town" else 0.45)
        parts.append(woods(land, rng, thin=0.3 if spec.kind == "town" else 0.7, first_m=4.0))
    if spec.kind == "trees":
        parts.append(woods(land, rng, thin=1.0, first_m=1.0))
    if spec.kind in ("trees", "mixed"):
        parts += waters_edge(land, rng)
    return merge(parts)


def town(land: Land, rng: np.random.Generator, crowded: float) -> list[Mesh]:
    """Rows of buildings along the shore, the tall ones mostly behind; ``crowded`` is the share of the lots in use."""
    length = 2 * land.half_azimuth_rad * land.distance_m
    small, large = [house(rng) for _ in range(7)], [flats(rng) for _ in range(3)]
    special = [church(rng), shed(rng)]
    parts = []
    lots = int(np.clip(length / 17, 3, 34))
    used = rng.random(lots) < crowded
    used[rng.integers(lots)] = True
    edge = 3.5 * land.bank_m
    for lot in np.flatnonzero(used):
        azimuth = ((lot + rng.uniform(0.4, 0.6)) / lots * 2 - 1) * land.half_azimuth_rad
        mesh = small[rng.integers(len(small))] if rng.random() < 0.85 else special[1]
        scale = max(1.0, length / lots / 40)  # far away, one stands for several
        parts.append(land.place(_grown(mesh, scale, rng), azimuth, edge + rng.uniform(8, 16), rng.uniform(-0.25, 0.25)))
        if rng.random() < 0.6:
            mesh = large[rng.integers(len(large))] if rng.random() < 0.35 else small[rng.integers(len(small))]
            azimuth += rng.uniform(-0.4, 0.4) / lots * land.half_azimuth_rad
            parts.append(
                land.place(_grown(mesh, scale, rng), azimuth, edge + rng.uniform(30, 60), rng.uniform(-0.4, 0.4))
            )
    if rng.random() < 0.5:
        aside = rng.uniform(-0.9, 0.9) * land.half_azimuth_rad
        parts.append(land.place(special[0], aside, edge + 80, rng.uniform(-0.6, 0.6)))
    return parts


def woods(land: Land, rng: np.random.Generator, thin: float, first_m: float) -> Mesh:
    """Trees in groups, grown ones in front and simple ones behind.

    Args:
        land: where they stand.
        rng: where they are drawn from.
        thin: share of the places where one may stand, 0 to 1.
        first_m: how far behind the bank's edge the first stand.
    """
    length = 2 * land.half_azimuth_rad * land.distance_m
    tall = float(rng.uniform(4, 8) if land.distance_m < 60 else rng.uniform(7, 14))
    places = float(np.clip(1.3 * length / (0.5 * tall), 8, 1200))
    groups, fill = noise_tile(256, 2.0, rng), rng.uniform(0.1, 0.9)

    def stand(wanted: int, back_m: float) -> tuple[NDArray, NDArray]:
        azimuth = rng.uniform(-1, 1, wanted) * land.half_azimuth_rad
        wood = sample_tile(groups, azimuth * 45, np.full(wanted, 3.0), smooth=False)
        kept = rng.random(wanted) < np.maximum(np.clip(4 * (wood - 0.35), 0, 1), fill) * thin
        kept[0] = True
        azimuth = azimuth[kept]
        behind = 2.2 * land.bank_m + first_m + back_m + tall * 3.5 * rng.random(len(azimuth)) ** 2
        return azimuth, behind

    azimuth, behind = stand(int(min(places, MOST_TREES)), 0.0)
    kinds = grow_kinds(int(np.clip(TREE_TRIANGLES * (0.5 + 0.5 * thin) / len(azimuth), 400, 4200)), rng)
    favourite = rng.dirichlet(np.full(len(kinds), 0.6))
    which = rng.choice(len(kinds), len(azimuth), p=favourite)
    heights = tall * rng.uniform(0.55, 1.15, len(azimuth))
    heights[which == len(kinds) - 1] *= 0.35  # bushes
    front = plant(kinds, which, land.point_m(azimuth, behind), heights, rng)
    azimuth, behind = stand(int(min(2.5 * places, MOST_DISTANT_TREES)), 4 * tall)
    few = int(np.clip(DISTANT_TRIANGLES / len(azimuth), 66, 400))
    simple = [distant_tree(rng, few, GREENS[rng.integers(len(GREENS))]) for _ in range(4)]
    which = rng.integers(0, len(simple), len(azimuth))
    back = plant(simple, which, land.point_m(azimuth, behind), tall * rng.uniform(0.6, 1.2, len(azimuth)), rng, 0.3)
    return merge([front, back])


def grow_kinds(triangles: int, rng: np.random.Generator) -> list[Mesh]:
    """One tree of each species, 1 m high; the last is a bush."""
    autumn = rng.random() < 0.15

    def green(number: int) -> NDArray:
        mix = AUTUMN if autumn and rng.random() < 0.6 else GREENS
        return mix[number % len(mix)] * rng.uniform(0.8, 1.25)

    return [
        crowned_tree(rng, triangles, green(0), "round"),
        crowned_tree(rng, triangles, green(1), "round"),
        crowned_tree(rng, triangles, green(1), "tall"),
        crowned_tree(rng, triangles, green(2), "loose", BIRCH),
        crowned_tree(rng, triangles, np.array([0.036, 0.060, 0.030]), "pine", PINE_BARK),
        spruce(rng, triangles, np.array([0.030, 0.054, 0.027])),
        crowned_tree(rng, triangles // 2, green(2), "bush"),
    ]


def waters_edge(land: Land, rng: np.random.Generator) -> list[Mesh]:
    """Reeds in the shallows and stones on the bank."""
    length = 2 * land.half_azimuth_rad * land.distance_m
    parts = []
    if rng.random() < 0.6:
        clumps = [reed_clump(rng, 100, np.array([0.11, 0.13, 0.05]) * rng.uniform(0.8, 1.2)) for _ in range(3)]
        count = int(np.clip(1.2 * length, 20, 130))
        middle = rng.uniform(-1, 1, max(count // 18, 2)) * land.half_azimuth_rad
        azimuth = middle[rng.integers(0, len(middle), count)] + rng.normal(0, 4.5, count) / land.distance_m
        azimuth = np.clip(azimuth, -land.half_azimuth_rad, land.half_azimuth_rad)
        feet = land.point_m(azimuth, rng.uniform(-1.2, 0.5, count))
        feet[:, 2] = np.clip(feet[:, 2], -0.1, 0.2)
        parts.append(plant(clumps, rng.integers(0, 3, count), feet, rng.uniform(1.0, 2.1, count), rng))
    count = int(np.clip(1.5 * length, 10, 100))
    stones = [rock(rng, np.array([0.20, 0.19, 0.17]) * rng.uniform(0.6, 1.3)) for _ in range(4)]
    feet = land.point_m(rng.uniform(-1, 1, count) * land.half_azimuth_rad, rng.uniform(-0.4, land.bank_m, count))
    feet[:, 2] -= 0.05
    sizes = rng.uniform(0.15, 0.9, count) ** 2 * 1.3 + 0.1
    parts.append(plant(stones, rng.integers(0, len(stones), count), feet, sizes, rng))
    return parts


def _grown(mesh: Mesh, scale: float, rng: np.random.Generator) -> Mesh:
    """A copy of a building, larger and in its own light."""
    tinted = mesh.painted(np.clip(mesh.colours * rng.uniform(0.85, 1.15, 3), 0, 0.85))
    return tinted.moved(np.eye(3) * scale * rng.uniform(0.95, 1.05), [0, 0, 0])
