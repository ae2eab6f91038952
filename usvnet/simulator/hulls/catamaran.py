"""Catamarans: two slim hulls with a deck or open beams between them, instruments on top."""

import numpy as np

from usvnet.simulator.frame_spec import HullSpec
from usvnet.simulator.hulls import outfit
from usvnet.simulator.hulls.lines import Lines
from usvnet.simulator.hulls.loft import CURVE_POINTS
from usvnet.simulator.hulls.monohull import SHOULDER
from usvnet.simulator.hulls.outfit import Place
from usvnet.simulator.hulls.shape import Doubles, Part, Shape, seven_keypoints
from usvnet.simulator.meshes import box, tube


def build_catamaran(spec: HullSpec) -> Shape:
    """The family ``catamaran``.

    Its bow is the middle of the foremost beam; the corners are on the outer gunwales. Its bow_bottom and stern_bottom
    are midway between the two hulls, and so on the water: people click there, and both hulls agree on it.
    """
    rng = np.random.default_rng([spec.seed, *spec.family.encode()])
    length = spec.length_m
    lines = _draw_lines(rng)
    loft = lines.loft(length, stations=100, points=32)
    apart = rng.uniform(0.17, 0.24) * length  # of each hull from the middle
    parts: list[Part] = []
    for side in (1, -1):
        parts += [loft.shell(side * apart), Part(loft.deck(0.003 * length, 0.006 * length, side * apart), "deck")]
    bridge, bow_x = _bridge(lines.freeboard * length, apart, length, rng)
    parts += bridge
    foremost = np.array([bow_x, 0.0, lines.freeboard * length + 0.02 * length])
    shift = np.array([0, apart, 0])
    stem, stern = _upright(loft.stem_curve(), foremost[2]), _upright(loft.stern_curve(), foremost[2])
    outer = loft.outline()
    outer = outer[: len(outer) // 2 + 1] + shift[:2]  # the port hull's port side, stern to bow
    low = 0.025 * length
    port, starboard = loft.signs(0.6, low, low + 0.8 * (lines.freeboard * length - low), apart)
    return Shape(
        parts=tuple(parts),
        signs=(port, starboard),
        keypoints_m=seven_keypoints(foremost, loft.gunwale(SHOULDER) + shift, stem, loft.gunwale(0.0) + shift, stern),
        stem_curve_m=stem,
        stern_curve_m=stern,
        waterline_outline_m=np.concatenate([outer, outer[::-1] * [1, -1]]),
        length_m=length,
        beam_m=2 * apart + lines.beam * length,
        freeboard_m=lines.freeboard * length,
        draught_m=lines.draught * length,
    )


def _draw_lines(rng: np.random.Generator) -> Lines:
    return Lines(
        beam=rng.uniform(0.09, 0.14),
        freeboard=rng.uniform(0.09, 0.13),
        draught=rng.uniform(0.05, 0.08),
        sheer=rng.uniform(0.0, 0.03),
        transom=rng.uniform(0.55, 0.95),
        fullness=rng.uniform(1.8, 3.2),
        bluntness=float(rng.choice([0, 0, 0.3])),
        forefoot=rng.uniform(0.68, 0.85),
        stem=rng.uniform(2.0, 5.0),
        chine=rng.uniform(0.35, 0.6),
        chine_width=rng.uniform(0.85, 1.0),
    )


def _upright(curve_m: Doubles, top_m: float) -> Doubles:
    """The vertical (300, 3) through where a hull's curve meets the resting waterline, on the centreline."""
    x = float(np.interp(0.0, curve_m[:, 2], curve_m[:, 0]))
    z = np.linspace(curve_m[0, 2], top_m, CURVE_POINTS)
    return np.stack([np.full_like(z, x), np.zeros_like(z), z], -1)


def _bridge(freeboard: float, apart: float, length: float, rng: np.random.Generator) -> tuple[list[Part], float]:
    """What joins the hulls and stands between them, and the x of its forward edge.

    A platform from hull to hull or round beams with a housing in the middle; its top is 0.02 lengths above the deck.
    """
    half = (apart + 0.03 * length) / length
    centre = Place(np.array([0.0, 0.0, freeboard]), length)
    middle = rng.uniform(-0.08, 0.04)
    if rng.random() < 0.5:
        front, back = rng.uniform(0.315, 0.38), -rng.uniform(0.3, 0.42)
        size = np.array([(front - back) * length, 2 * half * length, 0.024 * length])
        deck_at = [(front + back) / 2 * length, 0, freeboard + 0.008 * length]
        parts = [Part(box(deck_at, size), "deck")]
        for x in (front, back):
            parts.append(centre.moved(x - 0.012 * np.sign(x), 0, -0.012).box((0.024, 2 * half, 0.026), "trim"))
        deck = centre.raised(0.02)
        parts += _payload(deck, middle, half, rng)
        return parts, front * length
    front = rng.uniform(0.315, 0.38)  # ahead of the shoulders: the bow is here
    radius = 0.018
    parts = []
    for x in (front, rng.uniform(-0.05, 0.05), -front):
        ends = np.array([[x, half, 0.02 - radius], [x, -half, 0.02 - radius]]) * length + [0, 0, freeboard]
        parts.append(Part(tube(ends, radius * length, 16), "metal"))
    for y in (0.4 * half, -0.4 * half):
        parts.append(centre.moved(0, y, 0.02).bar([[front, 0, 0], [-front, 0, 0]], 0.01))
    deck = centre.raised(0.028)
    parts.append(deck.moved(0, 0, -0.004).box((1.1 * front, half, 0.008), "dark"))
    parts += _payload(deck.raised(0.004), middle * 0.5, 0.6 * half, rng)
    return parts, front * length


def _payload(deck: Place, middle: float, half: float, rng: np.random.Generator) -> list[Part]:
    """A cabin or a housing with solar panels, a mast or an arch, sensors."""
    parts: list[Part] = []
    if rng.random() < 0.35:
        roof = rng.uniform(0.08, 0.12)
        parts += outfit.cabin(deck.moved(middle, 0, 0), (0.26, 1.1 * half, roof), (0.7, 0.85))
    else:
        roof = rng.uniform(0.05, 0.09)
        parts += outfit.equipment_box(deck.moved(middle, 0, 0), (0.2, 0.9 * half, roof))
        parts += outfit.solar_panel(deck.moved(middle - 0.2, 0, 0), (0.16, 1.5 * half))
        if rng.random() < 0.5:
            parts += outfit.solar_panel(deck.moved(middle + 0.18, 0, 0), (0.12, 1.5 * half))
    if rng.random() < 0.5:
        parts += outfit.arch(deck.moved(middle - 0.12, 0, 0), 1.6 * half, rng.uniform(0.16, 0.24))
    parts += outfit.mast(deck.moved(middle, 0, roof * 0.8), rng.uniform(0.12, 0.28), 0.5 * half, rng)
    if rng.random() < 0.5:
        parts += outfit.lidar(deck.moved(middle + 0.06, 0, roof))
    if rng.random() < 0.5:
        parts += outfit.whip(deck.moved(-0.25, 0.8 * half, 0), rng.uniform(0.18, 0.3))
    return parts
