"""What stands on deck or hangs at the stern: cabins, masts, sensors, rails, cleats, engines. Sizes are in lengths."""

from dataclasses import dataclass

import numpy as np

from usvnet.simulator.hulls.shape import Doubles, Material, Part
from usvnet.simulator.meshes import ball, box, tube


@dataclass(frozen=True)
class Place:
    """A point in the hull frame, and how long the boat is."""

    at_m: Doubles
    length_m: float

    def raised(self, up: float) -> "Place":
        """The same place ``up`` lengths higher."""
        return self.moved(0, 0, up)

    def moved(self, x: float, y: float, z: float) -> "Place":
        """A place as many lengths away."""
        return Place(self.at_m + np.array([x, y, z]) * self.length_m, self.length_m)

    def box(
        self, size: tuple[float, float, float], material: Material, taper: tuple[float, float] = (1, 1), rake: float = 0
    ) -> Part:
        """A box whose bottom is centred here."""
        extent = np.array(size) * self.length_m
        centre = self.at_m + extent * [0, 0, 0.5]
        return Part(box(centre, extent, taper, rake * self.length_m), material)

    def ball(self, radii: tuple[float, float, float], material: Material) -> Part:
        """An ellipsoid centred here."""
        return Part(ball(self.at_m, np.array(radii) * self.length_m, 16, 9), material)

    def bar(self, points: list[list[float]], radius: float, material: Material = "metal", sides: int = 8) -> Part:
        """A round bar through points relative to here."""
        return Part(tube(self.at_m + np.array(points) * self.length_m, radius * self.length_m, sides), material)


def cabin(place: Place, size: tuple[float, float, float], taper: tuple[float, float] = (0.78, 0.84)) -> list[Part]:
    """A wheelhouse with a raked front, a band of windows between pillars, and a roof."""
    length, width, height = size
    rake = -0.12 * length

    def slice_of(low: float, high: float, wider: float, material: Material) -> Part:
        bottom, top = ((1 + (t - 1) * low, 1 + (t - 1) * high) for t in taper)
        part_taper = (bottom[1] / bottom[0], top[1] / top[0])
        extent = (length * bottom[0] * wider, width * top[0] * wider, height * (high - low))
        return place.moved(rake * low, 0, height * low).box(extent, material, part_taper, rake * (high - low))

    parts = [slice_of(0, 1, 1, "cabin"), slice_of(0.5, 0.84, 1.012, "glass")]
    for x in (-0.16, 0.12):
        pillar = place.moved(x * length + rake * 0.45, 0, 0.45 * height)
        across = width * (1 + (taper[1] - 1) * 0.45) * 1.03
        parts.append(pillar.box((0.05 * length, across, 0.45 * height), "cabin", (1, 0.93), rake * 0.45))
    roof = place.moved(rake, 0, height)
    parts.append(roof.box((length * taper[0] * 1.08, width * taper[1] * 1.1, 0.01), "cabin"))
    return parts


def equipment_box(place: Place, size: tuple[float, float, float]) -> list[Part]:
    """A low housing for electronics with a lid and a handle."""
    length, width, height = size
    lid = place.raised(height * 0.8)
    return [
        place.box(size, "dark", (0.96, 0.94)),
        lid.box((length * 1.0, width * 0.99, height * 0.25), "cabin", (0.97, 0.95)),
        lid.moved(0, 0, height * 0.24).box((length * 0.12, width * 0.3, 0.006), "dark"),
    ]


def hatch(place: Place, width: float) -> list[Part]:
    """A low hatch on the foredeck."""
    return [
        place.box((0.11, width, 0.018), "cabin", (0.94, 0.94)),
        place.raised(0.018).box((0.05, 0.012, 0.006), "dark"),
    ]


def cargo(place: Place, width: float, rng: np.random.Generator) -> list[Part]:
    """A load on the after deck: a coloured case, a reel, or nothing."""
    kind = rng.random()
    if kind < 0.4:
        return [place.box((0.16, width, 0.045), "accent", (0.96, 0.96))]
    if kind < 0.8:
        radius = 0.04
        drum = [[0, -0.4 * width, radius], [0, 0.4 * width, radius]]
        flanges = [[[0, y * width, radius], [0, (y + 0.08) * width, radius]] for y in (-0.5, 0.42)]
        return [place.bar(drum, 0.5 * radius, "accent", 12), *(place.bar(f, radius, "dark", 14) for f in flanges)]
    return []


def solar_panel(place: Place, size: tuple[float, float]) -> list[Part]:
    """A flat panel of dark cells in a light frame."""
    length, width = size
    return [
        place.box((length, width, 0.010), "metal"),
        place.raised(0.0075).box((length * 0.94, width * 0.94, 0.005), "panel"),
    ]


def mast(place: Place, height: float, arm: float, rng: np.random.Generator) -> list[Part]:
    """A pole with a cross-tree: a lamp or a dome on top, receivers and a camera on the arms, maybe a radar."""
    cross = 0.7 * height
    parts = [
        place.bar([[0, 0, 0], [0, 0, 0.5 * height], [0, 0, height]], 0.0075, "metal", 10),
        place.bar([[0, -arm, cross], [0, 0, cross], [0, arm, cross]], 0.0045),
    ]
    for side in (1, -1):
        parts.append(place.moved(0, side * arm, cross + 0.012).ball((0.018, 0.018, 0.011), "cabin"))
    parts.append(place.moved(0.02, -0.55 * arm, cross - 0.03).box((0.036, 0.03, 0.026), "dark"))
    if rng.random() < 0.6:
        parts.append(place.raised(height).ball((0.027, 0.027, 0.022), "accent"))
    else:
        parts.append(place.raised(height).ball((0.034, 0.034, 0.034), "cabin"))
    if rng.random() < 0.5:
        parts += radar(place.moved(0.03, 0, 0.42 * height), rng)
    return parts


def radar(place: Place, rng: np.random.Generator) -> list[Part]:
    """A closed dome or an open bar that turns."""
    shelf = place.moved(-0.012, 0, -0.012).box((0.05, 0.03, 0.012), "metal")
    if rng.random() < 0.6:
        return [shelf, place.raised(0.012).ball((0.036, 0.036, 0.018), "cabin")]
    angle = rng.uniform(0, np.pi)
    x, y = 0.065 * np.cos(angle), 0.065 * np.sin(angle)
    return [shelf, place.box((0.03, 0.03, 0.022), "cabin"), place.bar([[-x, -y, 0.03], [x, y, 0.03]], 0.008, "cabin")]


def lidar(place: Place) -> list[Part]:
    """A stubby cylinder on a foot."""
    body = place.bar([[0, 0, 0.01], [0, 0, 0.034]], 0.017, "dark", 14)
    return [
        place.box((0.03, 0.03, 0.012), "metal"),
        body,
        place.bar([[0, 0, 0.034], [0, 0, 0.042]], 0.017, "metal", 14),
    ]


def whip(place: Place, height: float) -> list[Part]:
    """A thin antenna that leans aft."""
    foot = place.bar([[0, 0, 0], [-0.002, 0, 0.04]], 0.006, "dark")
    return [foot, place.bar([[0, 0, 0.03], [-0.010, 0, 0.5 * height], [-0.024, 0, height]], 0.0026, "cabin", 6)]


def bow_rail(port_edge_m: Doubles, height_m: float, length_m: float) -> list[Part]:
    """A pulpit: a rail above points (n, 3) of the port deck edge and their mirror images, on stanchions."""
    around = np.concatenate([port_edge_m, port_edge_m[::-1] * [1, -1, 1]])
    radius, up = 0.0035 * length_m, np.array([0, 0, height_m])
    parts = [Part(tube(around + up, radius, 6), "metal")]
    for foot in around[::3]:
        parts.append(Part(tube(np.stack([foot, foot + up]), radius, 6), "metal"))
    return parts


def cleats(port_m: Doubles, length_m: float) -> list[Part]:
    """A cleat at a point (3,) of the port deck and one at its mirror image."""
    bow = [[-0.02, 0, 0], [-0.02, 0, 0.018], [0.02, 0, 0.018], [0.02, 0, 0]]
    return [Place(port_m * [1, side, 1], length_m).bar(bow, 0.0035, sides=6) for side in (1, -1)]


def thrusters(stern_m: Doubles, apart_m: float, length_m: float) -> list[Part]:
    """Two electric thrusters on brackets, half out of the water."""
    parts = []
    for side in (1, -1):
        place = Place(stern_m + side * np.array([0, apart_m, 0]), length_m)
        parts.append(place.moved(-0.02, 0, -0.01).box((0.03, 0.03, 0.09), "dark"))
        parts.append(place.bar([[0.0, 0, -0.03], [-0.075, 0, -0.03]], 0.02, "dark", 12))
    return parts


def outboard(transom_top_m: Doubles, length_m: float, height: float) -> list[Part]:
    """A petrol or electric outboard ``height`` lengths tall, clamped over the transom."""
    place = Place(transom_top_m, length_m)
    h = height
    return [
        place.moved(-0.16 * h, 0, -0.05 * h).box((0.34 * h, 0.2 * h, 0.16 * h), "metal"),
        place.moved(-0.38 * h, 0, 0.05 * h).box((0.55 * h, 0.36 * h, 0.4 * h), "dark", (0.86, 0.72), -0.02 * h),
        place.moved(-0.38 * h, 0, 0.12 * h).box((0.56 * h, 0.365 * h, 0.05 * h), "accent", (0.98, 0.96)),
        place.moved(-0.36 * h, 0, -1.3 * h).box((0.2 * h, 0.1 * h, 1.36 * h), "dark", (1.2, 1.6)),
        place.bar([[-0.15 * h, 0, -1.2 * h], [-0.65 * h, 0, -1.2 * h]], 0.07 * h, "dark", 10),
    ]


def arch(place: Place, width: float, height: float, radius: float = 0.009) -> list[Part]:
    """A sensor arch across the boat, leaning aft, with a shelf on top."""
    points = [[0, -width / 2, 0], [-0.03, -width / 2, 0.85 * height], [-0.035, -0.4 * width, height]]
    points += [[x, -y, z] for x, y, z in points[::-1]]
    shelf = place.moved(-0.035, 0, height).box((0.07, 0.5 * width, 0.01), "metal")
    return [place.bar(points, radius), shelf]
