"""A quay and what stands on it: wall, fenders, dolphins, cranes, containers and a breakwater of stones."""

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.buildings import SHEETS, shed
from usvnet.simulator.land import PAVED_M, Land, rock
from usvnet.simulator.meshes import Mesh, box, make_mesh, merge, sheet, tube
from usvnet.simulator.trees import plant

CRANES = np.array([[0.62, 0.36, 0.03], [0.10, 0.22, 0.42], [0.50, 0.09, 0.05], [0.45, 0.46, 0.46]])
CONTAINERS = np.array(
    [
        [0.42, 0.08, 0.05],
        [0.05, 0.14, 0.30],
        [0.07, 0.22, 0.13],
        [0.52, 0.30, 0.05],
        [0.45, 0.45, 0.43],
        [0.22, 0.10, 0.07],
    ]
)
RUBBER = (0.012, 0.012, 0.013)
STEEL = (0.10, 0.075, 0.060)


def build_harbour(land: Land, rng: np.random.Generator) -> list[Mesh]:
    """Everything that is man-made on a straight quay, in the world frame."""
    length = 2 * land.half_azimuth_rad * land.distance_m
    parts = [quay_wall(land, rng), *wall_fittings(land, min(length, 260.0), rng), breakwater(land, rng)]
    halls = [shed(rng) for _ in range(4)]
    count = int(np.clip(length / 38, 2, 10))
    for slot in range(count):
        azimuth = ((slot + rng.uniform(0.25, 0.75)) / count * 2 - 1) * land.half_azimuth_rad
        parts.append(land.place(halls[rng.integers(len(halls))], azimuth, rng.uniform(30, 55), rng.uniform(-0.1, 0.1)))
    for _ in range(int(rng.integers(2, 6))):
        azimuth = rng.uniform(-0.95, 0.95) * land.half_azimuth_rad
        parts.append(land.place(container_stack(rng), azimuth, rng.uniform(10, 20), rng.uniform(-0.1, 0.1)))
    for _ in range(int(rng.integers(1, 4))):
        azimuth = rng.uniform(-0.85, 0.85) * land.half_azimuth_rad
        parts.append(land.place(crane(rng), azimuth, rng.uniform(7, 9), rng.uniform(-0.6, 0.6)))
    return parts


def quay_wall(land: Land, rng: np.random.Generator) -> Mesh:
    """The upright wall: weed at its foot, stained concrete or stone above, a pale coping, and the pavement behind."""
    azimuth = np.linspace(-1, 1, 400) * land.half_azimuth_rad
    top = land.bank_m
    heights = np.array([-1.5, 0.0, 0.12, 0.35, 0.5, 0.5 * top + 0.2, top - 0.3, top - 0.3, top, top, top])
    behind = np.array([0, 0, 0, 0, 0, 0, 0, -0.12, -0.12, 8, PAVED_M])
    reach = land.waterline_m(azimuth)[None] + behind[:, None]
    points = np.stack(
        [reach * np.sin(azimuth), reach * np.cos(azimuth), np.broadcast_to(heights[:, None], reach.shape)], -1
    )
    weed, stone = np.array([0.018, 0.026, 0.014]), np.array([0.24, 0.225, 0.20]) * rng.uniform(0.6, 1.25)
    rows = np.array([weed, weed, weed * 1.3, 0.5 * stone, 0.8 * stone, stone, stone, 1.2 * stone, 1.35 * stone])
    rows = np.concatenate([rows, np.array([[0.20, 0.195, 0.18], [0.13, 0.13, 0.12]])])
    along = reach * azimuth
    stain = 0.55 + 0.9 * land.noise(along * 3.1, 40.0 + 1.5 * heights[:, None])
    joint = np.where((along % 6.0) < 2 * land.half_azimuth_rad * land.distance_m / 400, 0.6, 1.0)
    colours = rows[:, None] * (stain * joint)[..., None]
    mesh = sheet(points, rough=0.85, flip=True)
    return mesh.painted(np.clip(colours, 0.004, 0.8).reshape(-1, 3))


def wall_fittings(land: Land, length_m: float, rng: np.random.Generator) -> list[Mesh]:
    """Fenders, ladders, bollards and moored posts along the middle of the quay."""
    reach = length_m / 2 / land.distance_m
    top = land.bank_m
    tyre = tube([[0, 0.05, 0], [0, -0.28, 0]], 0.48, 12, colour=RUBBER, rough=0.9)
    hub = tube([[0, 0.0, 0], [0, -0.30, 0]], 0.2, 8, colour=(0.06, 0.058, 0.055), rough=0.9)
    fender = merge([tyre, hub]).moved(np.eye(3), [0, -0.1, 0.62 * top - top])
    bollard = merge(
        [
            tube([[0, 0, 0.0], [0, 0, 0.5]], [0.2, 0.16], 8, colour=(0.05, 0.05, 0.055), rough=0.6),
            tube([[0, 0, 0.45], [0, 0, 0.6]], 0.27, 8, colour=(0.05, 0.05, 0.055), rough=0.6),
        ]
    )
    rungs = [box([0, -0.2, -0.3 * k - 0.2], [0.45, 0.05, 0.05], colour=STEEL) for k in range(int(top / 0.3))]
    rails = [box([x, -0.2, -top / 2], [0.05, 0.05, top + 0.6], colour=STEEL) for x in (-0.24, 0.24)]
    ladder = merge([*rungs, *rails])
    foot = tube([[0, 0, -1.5], [0, 0, 0.35]], 0.17, 9, colour=(0.018, 0.020, 0.014), rough=0.5)
    wood = tube([[0, 0, 0.35], [0, 0, top + 1.3]], [0.17, 0.15], 9, colour=(0.15, 0.12, 0.09), rough=0.9)
    cap = tube([[0, 0, top + 1.28], [0, 0, top + 1.36]], 0.18, 9, colour=(0.55, 0.55, 0.52), rough=0.6)
    post = merge([foot, wood, cap])

    parts = []
    gap = rng.uniform(3.5, 8)
    for number, azimuth in enumerate(np.arange(-reach, reach, gap / land.distance_m)[:70]):
        parts.append(land.place(fender, azimuth, 0.0))
        if number % 3 == 1:
            parts.append(land.place(bollard, azimuth, 0.6))
        if number % 5 == 2:
            parts.append(land.place(ladder, azimuth + 1.5 / land.distance_m, 0.0))
        if rng.random() < 0.3:
            aground = land.place(post, azimuth, -rng.uniform(1.5, 5.0), rng.uniform(0, 6))
            parts.append(aground.moved(np.eye(3), [0, 0, -top]))
    return parts


def breakwater(land: Land, rng: np.random.Generator) -> Mesh:
    """Stones heaped against one end of the quay."""
    colour = np.array([0.21, 0.20, 0.185]) * rng.uniform(0.6, 1.2)
    kinds = [rock(rng, colour) for _ in range(5)]
    end = rng.choice([-1.0, 1.0])
    span = rng.uniform(0.2, 0.5)
    count = int(np.clip(2 * span * land.half_azimuth_rad * land.distance_m * 3.0, 60, 420))
    azimuth = end * land.half_azimuth_rad * (1 - span * rng.uniform(0, 1, count) ** 1.2)
    behind = rng.uniform(-4.5, 0.5, count)
    slope = np.clip((behind + 4.0) / 4.0, -0.1, 1.0)
    feet = land.point_m(azimuth, behind)
    feet[:, 2] = slope * land.bank_m * 1.05 - 0.35
    sizes = rng.uniform(0.7, 1.7, count) * max(1.0, 2 * span * land.half_azimuth_rad * land.distance_m / 140)
    stones = plant(kinds, rng.integers(0, len(kinds), count), feet, sizes, rng)
    wet = stones.vertices_m[:, 2:] < 0.25
    return stones.painted(np.where(wet, stones.colours * [0.35, 0.38, 0.30], stones.colours), 0.9)


def container_stack(rng: np.random.Generator) -> Mesh:
    """Shipping containers, up to three high, with ribbed sides."""
    parts = []
    for column in range(int(rng.integers(1, 5))):
        for level in range(int(rng.integers(1, 4))):
            colour = CONTAINERS[rng.integers(len(CONTAINERS))] * rng.uniform(0.7, 1.2)
            x, z = 6.3 * column + rng.uniform(-0.1, 0.1), 2.6 * level + 1.3
            parts.append(box([x, 0, z], [6.06, 2.44, 2.58], colour=colour, rough=0.6))
            ribs = np.linspace(-2.8, 2.8, 12) + x
            parts.append(_upright_strips(ribs, -1.25, z, 0.2, 2.3, colour * 0.72))
    return merge(parts)


def crane(rng: np.random.Generator) -> Mesh:
    """A portal crane: four legs, a house with its cab, and a lattice jib."""
    colour = CRANES[rng.integers(len(CRANES))] * rng.uniform(0.75, 1.1)
    tall, gauge = rng.uniform(8, 12), rng.uniform(2.6, 3.6)
    look = {"colour": colour, "rough": 0.5}
    parts = []
    for x in (-gauge, gauge):
        for y in (-gauge, gauge):
            parts.append(tube([[x, y, 0], [0.55 * x, 0.55 * y, tall]], [0.38, 0.3], 4, **look))
        parts.append(tube([[x * 0.8, -gauge * 0.8, 0.45 * tall], [x * 0.8, gauge * 0.8, 0.45 * tall]], 0.2, 4, **look))
    parts.append(
        tube([[-gauge * 0.8, -gauge * 0.8, 0.45 * tall], [gauge * 0.8, -gauge * 0.8, 0.45 * tall]], 0.2, 4, **look)
    )
    parts.append(box([0, 0, tall + 0.3], [0.62 * 2 * gauge, 0.62 * 2 * gauge, 0.6], **look))
    parts.append(box([-0.8, 0, tall + 2.2], [5.0, 3.0, 3.2], colour=SHEETS[rng.integers(len(SHEETS))], rough=0.5))
    parts.append(box([2.1, -1.0, tall + 2.4], [1.5, 1.5, 2.0], colour=(0.03, 0.04, 0.05), rough=0.1))
    jib, rise = rng.uniform(16, 26), rng.uniform(0.35, 1.05)
    foot = np.array([1.6, 0, tall + 1.5])
    tip = foot + jib * np.array([np.cos(rise), 0, np.sin(rise)])
    across = np.array([-np.sin(rise), 0, np.cos(rise)])
    steps = np.linspace(0, 1, 11)[:, None]
    chords = []
    for y, lift in ((-0.55, 0.0), (0.55, 0.0), (0.0, 0.9)):
        narrow = 1 - 0.75 * steps
        line = foot + steps * (tip - foot) + narrow * ([0, y, 0] + lift * across)
        chords.append(line)
        parts.append(tube(line[[0, 5, 10]], 0.11, 4, **look))
    for k in range(10):
        parts.append(tube([chords[0][k], chords[2][k + 1]], 0.06, 3, **look))
        parts.append(tube([chords[1][k], chords[2][k + 1]], 0.06, 3, **look))
    mast = np.array([-1.5, 0, tall + 8.5])
    parts.append(tube(np.array([[-1.2, 0, tall + 3.5], mast]), [0.3, 0.15], 4, **look))
    parts.append(tube([mast, tip], 0.04, 3, colour=(0.03, 0.03, 0.03), rough=0.5))
    hook = tip - [0, 0, rng.uniform(0.3, 0.7) * (tip[2] - 3)]
    parts.append(tube([tip, hook], 0.04, 3, colour=(0.03, 0.03, 0.03), rough=0.5))
    parts.append(box(hook, [0.5, 0.4, 0.9], **look))
    turn = rng.uniform(-1.2, 1.2) + rng.choice([0.0, np.pi])
    c, s = np.cos(turn), np.sin(turn)
    return merge(parts).moved([[c, -s, 0], [s, c, 0], [0, 0, 1]], [0, 0, 0])


def _upright_strips(x_m: NDArray, y_m: float, z_m: float, width_m: float, height_m: float, colour: NDArray) -> Mesh:
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * [width_m, height_m]
    x, z = x_m[:, None] + square[:, 0], np.broadcast_to(z_m + square[:, 1], (len(x_m), 4))
    points = np.stack([x, np.full_like(x, y_m), z], -1).reshape(-1, 3)
    first = 4 * np.arange(len(x_m))[:, None]
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    return make_mesh(points, faces, colour, 0.6)
