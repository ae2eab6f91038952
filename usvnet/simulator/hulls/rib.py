"""Rigid inflatables: a tube around a V-shaped hull, a console, an arch with sensors, an outboard."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from usvnet.simulator.frame_spec import HullSpec
from usvnet.simulator.hulls import outfit
from usvnet.simulator.hulls.loft import SIGN_COLUMNS, SIGN_ROWS, Loft, loft_sections, rising_curve
from usvnet.simulator.hulls.outfit import Place
from usvnet.simulator.hulls.shape import Doubles, Part, Shape, Sign, seven_keypoints
from usvnet.simulator.meshes import tube

EDGE = np.pi / 4
"""Where on the tube's round the deck edge is, up from its outermost line."""
SHOULDER = 0.8
TRANSOM = 0.04
"""The transom is ahead of the ends of the tubes."""


@dataclass(frozen=True)
class Tube:
    """The centre of the inflated tube, metres: straight along the sides, half of a superellipse around the bow."""

    length: float
    half_width: float
    bend_x: float
    """Where the tube begins to bend inwards."""
    fullness: float
    """Exponent of the superellipse: below 1 is fuller than an ellipse."""
    height: float
    sheer: float
    radius: float

    def half(self, x: Doubles) -> Doubles:
        """Distance of the port tube's centre from the middle."""
        q = np.clip((x - self.bend_x) / (self.front - self.bend_x), 0, 1)
        return self.half_width * (1 - q**2) ** (self.fullness / 2)

    def centre_height(self, x: ArrayLike) -> Doubles:
        """Height of the tube's centre."""
        q = np.clip((np.asarray(x, float) + 0.2 * self.length) / (self.front + 0.2 * self.length), 0, 1)
        return self.height + self.sheer * q**2

    @property
    def front(self) -> float:
        """Where the tube's centre is at the bow (x), whose foremost point is at half the length."""
        return self.length / 2 - self.radius

    def path(self) -> Doubles:
        """The centre (P, 3) of the port half, from the stern to the bow."""
        turn = np.linspace(0, np.pi / 2, 40)[1:]
        x = np.concatenate(
            [np.linspace(-self.length / 2, self.bend_x, 30), self.bend_x + (self.front - self.bend_x) * np.sin(turn)]
        )
        return np.stack([x, self.half(x), self.centre_height(x)], -1)

    def surface(self, x: ArrayLike, angle: ArrayLike, lift: float = 1.0) -> Doubles:
        """Points (..., 3) of the port side at ``angle`` up from the outermost line, ``lift`` radii from the centre."""
        x, angle = np.broadcast_arrays(np.asarray(x, float), np.asarray(angle, float))
        step = 1e-4 * self.length
        slope = (self.half(x + step) - self.half(x - step)) / (2 * step)
        outward = np.stack([-slope, np.ones_like(x), np.zeros_like(x)], -1) / np.hypot(slope, 1)[..., None]
        centre = np.stack([x, self.half(x), self.centre_height(x)], -1)
        round_it = np.cos(angle)[..., None] * outward + np.sin(angle)[..., None] * [0, 0, 1]
        return centre + lift * self.radius * round_it


def build_rib(spec: HullSpec) -> Shape:
    """The family ``rib``; its deck edge is on the tube, 45 degrees up from the outermost line."""
    rng = np.random.default_rng([spec.seed, *spec.family.encode()])
    length = spec.length_m
    radius = rng.uniform(0.048, 0.066) * length
    beam = rng.uniform(0.36, 0.46) * length
    tubes = Tube(
        length=length,
        half_width=beam / 2 - radius,
        bend_x=rng.uniform(0.08, 0.2) * length,
        fullness=rng.uniform(0.75, 1.05),
        height=radius * rng.uniform(1.1, 1.4),
        sheer=rng.uniform(0.02, 0.06) * length,
        radius=radius,
    )
    draught = rng.uniform(0.045, 0.07) * length
    loft = _hull_under(tubes, draught, rng)
    stem, stern = _stem(loft, tubes), loft.stern_curve()
    bow = stem[-1]
    corner = tubes.surface(-length / 2, EDGE)
    freeboard = tubes.height + radius
    shell = loft.shell()
    parts = [Part(shell.mesh, "belly", shell.up), Part(loft.deck(0.5 * radius, 0.0), "deck"), *_tubes(tubes)]
    parts += _fittings(loft, tubes, rng)
    return Shape(
        parts=tuple(parts),
        signs=_signs(tubes),
        keypoints_m=seven_keypoints(bow, tubes.surface((SHOULDER - 0.5) * length, EDGE), stem, corner, stern),
        stem_curve_m=stem,
        stern_curve_m=stern,
        waterline_outline_m=loft.outline(),
        length_m=length,
        beam_m=beam,
        freeboard_m=freeboard,
        draught_m=draught,
    )


def _hull_under(tubes: Tube, draught: float, rng: np.random.Generator) -> Loft:
    """The V-shaped hull, whose gunwale runs inside the tubes."""
    t = 1 - (1 - np.linspace(0, 1, 130)) ** 1.35
    x = (TRANSOM - 0.5) * tubes.length + t * (tubes.front - (TRANSOM - 0.5) * tubes.length)
    top = tubes.centre_height(x)
    forefoot = rng.uniform(0.5, 0.66)
    rise = np.clip((t - forefoot) / (1 - forefoot), 0, 1) ** rng.uniform(1.8, 2.8)
    keel = -draught + (top[-1] + draught) * rise
    return loft_sections(x, 0.97 * tubes.half(x), top, keel, rng.uniform(0.35, 0.5), 0.9, 24)


def _stem(loft: Loft, tubes: Tube) -> Doubles:
    """Up the keel and then over the front of the tube, whichever is further forward."""
    keel = loft.stem_curve()
    centre = float(tubes.centre_height(tubes.front))
    z = np.linspace(keel[0, 2], centre + tubes.radius * np.sin(EDGE), len(keel))
    round_it = np.sqrt(np.clip(tubes.radius**2 - (z - centre) ** 2, 0, None))
    x = np.maximum(np.interp(z, keel[:, 2], keel[:, 0]), np.where(round_it > 0, tubes.front + round_it, -np.inf))
    return rising_curve(x, z)


def _tubes(tubes: Tube) -> list[Part]:
    """The tube with its ends drawn in to cones, and a rubbing strake along its outermost line."""
    port = tubes.path()
    path = np.concatenate([port, port[-2::-1] * [1, -1, 1]])
    strake = tubes.surface(port[:-1, 0], 0.0, 1.0)
    front = np.array([[tubes.length / 2, 0.0, tubes.centre_height(tubes.front)]])
    around = np.concatenate([strake, front, strake[::-1] * [1, -1, 1]])
    ends = np.array([tubes.surface(-tubes.length / 2, 0.0, 0.0) - [0.02 * tubes.length, 0, 0], port[0]])
    parts = [Part(tube(path, tubes.radius, 24), "tube"), Part(tube(around, 0.006 * tubes.length, 6), "trim")]
    cone = np.array([0.55, 1.0]) * tubes.radius
    parts += [Part(tube(ends * [1, side, 1], cone, 24), "trim") for side in (1, -1)]
    return parts


def _signs(tubes: Tube) -> tuple[Sign, Sign]:
    """Room for letters on the outer side of both tubes."""
    angle = np.linspace(1.05, 0.16, SIGN_ROWS)[:, None]
    x = np.linspace(0.09, -0.16, SIGN_COLUMNS)[None] * tubes.length  # from port, the bow is on the left
    points = tubes.surface(x, angle, 1.03)
    up = np.ones(points.shape[:2])
    return Sign(points, "tube", up), Sign(points[:, ::-1] * [1, -1, 1], "tube", up)


def _fittings(loft: Loft, tubes: Tube, rng: np.random.Generator) -> list[Part]:
    length = tubes.length

    def on_deck(x: float) -> Place:
        return Place(np.array([x * length, 0, float(tubes.centre_height(x * length)) - 0.5 * tubes.radius]), length)

    parts: list[Part] = []
    middle = rng.uniform(-0.12, 0.0)
    width = tubes.half_width / length
    console = on_deck(middle)
    height = rng.uniform(0.1, 0.14)
    parts.append(console.box((0.11, 0.6 * width, height), "cabin", (0.75, 0.9), -0.01))
    parts.append(console.moved(0.02, 0, height).box((0.02, 0.54 * width, 0.05), "glass", (0.3, 0.9), -0.025))
    parts.append(on_deck(middle - 0.14).box((0.12, 0.55 * width, 0.075), "dark", (0.9, 0.95)))
    parts.append(on_deck(0.24).box((0.12, 0.7 * width, 0.05), "accent", (0.8, 0.85)))
    aft = on_deck(-0.36)
    if rng.random() < 0.7:
        parts += outfit.arch(aft, 1.5 * width, 0.24, 0.011)
        parts += outfit.mast(aft.moved(-0.035, 0, 0.24), rng.uniform(0.08, 0.18), 0.35 * width, rng)
    else:
        parts += outfit.mast(console.moved(-0.02, 0, 0.8 * height), rng.uniform(0.18, 0.28), 0.35 * width, rng)
    if rng.random() < 0.5:
        parts += outfit.lidar(console.moved(-0.02, 0, height))
    if rng.random() < 0.6:
        parts += outfit.whip(aft.moved(0.03, 0.6 * width, 0), rng.uniform(0.25, 0.4))
    clamp = np.array([loft.x_m[0, 0] - 0.01 * length, 0.0, float(loft.z_m[0, -1]) + 0.01 * length])
    parts += outfit.outboard(clamp, length, rng.uniform(0.13, 0.17))
    return parts
