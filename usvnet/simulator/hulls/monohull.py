"""Single-hulled boats: an open or decked workboat, a low survey boat and a patrol boat with a wheelhouse."""

import numpy as np

from usvnet.simulator.frame_spec import HullSpec
from usvnet.simulator.hulls import outfit
from usvnet.simulator.hulls.lines import Lines
from usvnet.simulator.hulls.loft import Loft
from usvnet.simulator.hulls.outfit import Place
from usvnet.simulator.hulls.shape import Part, Shape, seven_keypoints
from usvnet.simulator.meshes import tube

SHOULDER = 0.8
"""Where bow_left and bow_right are, from the stern."""


def build_monohull(spec: HullSpec) -> Shape:
    """The families ``mono``, ``survey`` and ``patrol``."""
    rng = np.random.default_rng([spec.seed, *spec.family.encode()])
    length = spec.length_m
    lines = draw_lines(spec.family, rng)
    loft = lines.loft(length)
    parts = [loft.shell(), Part(loft.deck(0.004 * length, 0.018 * length), "deck"), *strakes(loft, length)]
    parts += _superstructure(spec.family, loft, length, lines.beam * length, rng)
    stem, stern = loft.stem_curve(), loft.stern_curve()
    bow = loft.gunwale(1.0) * [1, 0, 1]
    low = 0.03 * length
    return Shape(
        parts=tuple(parts),
        signs=loft.signs(0.66, low, low + 0.75 * (lines.freeboard * length - low)),
        keypoints_m=seven_keypoints(bow, loft.gunwale(SHOULDER), stem, loft.gunwale(0.0), stern),
        stem_curve_m=stem,
        stern_curve_m=stern,
        waterline_outline_m=loft.outline(),
        length_m=length,
        beam_m=lines.beam * length,
        freeboard_m=lines.freeboard * length,
        draught_m=lines.draught * length,
    )


def draw_lines(family: str, rng: np.random.Generator) -> Lines:
    """The proportions of one hull of a family; a patrol boat is sharper and has more sheer."""
    sharp = family == "patrol"
    return Lines(
        beam=rng.uniform(0.26, 0.36) if sharp else rng.uniform(0.24, 0.40),
        freeboard=rng.uniform(0.10, 0.15) if sharp else rng.uniform(0.085, 0.14),
        draught=rng.uniform(0.04, 0.08),
        sheer=rng.uniform(0.03, 0.075) if sharp else rng.uniform(0.01, 0.07),
        transom=rng.uniform(0.75, 0.98) if sharp else rng.uniform(0.6, 0.98),
        fullness=rng.uniform(1.6, 3.2),
        bluntness=0.0 if sharp else float(rng.choice([0, 0, 0, 0.25, 0.5])),
        forefoot=rng.uniform(0.55, 0.75),
        stem=rng.uniform(2.0, 4.5),
        chine=rng.uniform(0.25, 0.5),
        chine_width=rng.uniform(0.72, 0.95),
    )


def strakes(loft: Loft, length_m: float, shift_y_m: float = 0.0) -> list[Part]:
    """The rubbing strakes along both gunwales."""
    port = loft.gunwale(1 - (1 - np.linspace(0, 1, 70)) ** 1.35)
    sides = [port * [1, side, 1] + [0, shift_y_m, 0] for side in (1, -1)]
    return [Part(tube(side, 0.008 * length_m, 8), "trim") for side in sides]


def _superstructure(family: str, loft: Loft, length: float, beam: float, rng: np.random.Generator) -> list[Part]:
    def on_deck(x: float, y: float = 0.0) -> Place:  # x and y in lengths and beams from amidships
        return Place(np.array([x * length, y * beam, loft.gunwale(x + 0.5)[2] + 0.004 * length]), length)

    parts: list[Part] = []
    middle = rng.uniform(-0.1, 0.04)
    if family == "patrol" or (family == "mono" and rng.random() < 0.6):
        size = (rng.uniform(0.22, 0.34), rng.uniform(0.45, 0.62) * beam / length, rng.uniform(0.08, 0.13))
        parts += outfit.cabin(on_deck(middle), size)
        roof = size[2]
        parts += outfit.hatch(on_deck(middle + size[0] / 2 + 0.11), 0.30 * beam / length)
    elif family == "survey":
        roof = rng.uniform(0.03, 0.06)
        parts += outfit.equipment_box(on_deck(middle), (rng.uniform(0.2, 0.32), 0.5 * beam / length, roof))
        parts += outfit.solar_panel(on_deck(middle + 0.25), (0.19, 0.5 * beam / length))
        parts += outfit.solar_panel(on_deck(middle - 0.25), (0.17, 0.6 * beam / length))
    else:
        roof = 0.05
        parts += outfit.equipment_box(on_deck(middle), (0.28, 0.5 * beam / length, roof))
        parts += outfit.hatch(on_deck(middle + 0.27), 0.34 * beam / length)
        parts += outfit.cargo(on_deck(middle - 0.27), 0.5 * beam / length, rng)
    mast_at = on_deck(middle + rng.uniform(-0.1, 0.04)).raised(roof * 0.8)
    parts += outfit.mast(mast_at, rng.uniform(0.14, 0.32), 0.2 * beam / length, rng)
    if rng.random() < 0.5:
        parts += outfit.lidar(on_deck(middle + 0.06).raised(roof))
    if rng.random() < 0.6:
        parts += outfit.whip(on_deck(-0.42, 0.3), rng.uniform(0.2, 0.36))
    if family == "patrol" or rng.random() < 0.35:
        rail = loft.gunwale(np.linspace(0.66, 0.985, 9)) * [1, 0.88, 1]
        parts += outfit.bow_rail(rail, 0.055 * length, length)
    for x in (0.36, -0.4):
        edge = loft.gunwale(x + 0.5)
        parts += outfit.cleats(edge * [1, 0.8, 1], length)
    drive = rng.random()
    transom = np.array([loft.x_m[0, 0], 0.0, 0.0])
    if drive < 0.35:
        parts += outfit.thrusters(transom, 0.22 * beam, length)
    elif drive < 0.7:
        parts += outfit.outboard(transom + loft.gunwale(0.0) * [0, 0, 1], length, 0.16)
    return parts
