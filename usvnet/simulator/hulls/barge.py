"""Barges: boxes with a flat bottom that rises to a square, raked bow; a family of hulls that training never sees."""

import numpy as np

from usvnet.simulator.frame_spec import HullSpec
from usvnet.simulator.hulls import outfit
from usvnet.simulator.hulls.loft import Loft, loft_sections
from usvnet.simulator.hulls.monohull import SHOULDER, strakes
from usvnet.simulator.hulls.outfit import Place
from usvnet.simulator.hulls.shape import Part, Shape, seven_keypoints


def build_barge(spec: HullSpec) -> Shape:
    """The family ``barge``; its bow is the middle of the bow plate's upper edge."""
    rng = np.random.default_rng([spec.seed, *spec.family.encode()])
    length = spec.length_m
    beam, freeboard = rng.uniform(0.34, 0.48) * length, rng.uniform(0.08, 0.13) * length
    draught = rng.uniform(0.04, 0.07) * length
    loft = _loft(length, beam, freeboard, draught, rng)
    parts = [loft.shell(), Part(loft.deck(0.006 * length, 0.006 * length), "deck"), *strakes(loft, length)]
    parts += _bulwark(loft, length)
    parts += _fittings(loft, length, beam / length, rng)
    stem, stern = loft.stem_curve(), loft.stern_curve()
    low = 0.03 * length
    return Shape(
        parts=tuple(parts),
        signs=loft.signs(0.55, low, low + 0.8 * (freeboard - low)),
        keypoints_m=seven_keypoints(
            loft.gunwale(1.0) * [1, 0, 1], loft.gunwale(SHOULDER), stem, loft.gunwale(0.0), stern
        ),
        stem_curve_m=stem,
        stern_curve_m=stern,
        waterline_outline_m=loft.outline(),
        length_m=length,
        beam_m=beam,
        freeboard_m=freeboard,
        draught_m=draught,
    )


def _loft(length: float, beam: float, freeboard: float, draught: float, rng: np.random.Generator) -> Loft:
    t = np.linspace(0, 1, 160)
    forward = np.clip((t - 0.6) / 0.4, 0, 1)
    half = beam / 2 * (1 - rng.uniform(0.02, 0.22) * forward**2)
    top = freeboard + rng.uniform(0.0, 0.03) * length * forward**1.5
    rise = np.clip((t - rng.uniform(0.68, 0.8)) / 0.25, 0, None) ** 1.2
    keel = -draught + (rng.uniform(0.2, 0.5) * freeboard + draught) * rise / rise[-1]
    loft = loft_sections(length * (t - 0.5), half, top, keel, 0.14, 0.94, 40)
    share = (loft.z_m - keel[:, None]) / (top - keel)[:, None]
    rake = rng.uniform(0.0, 0.05) * length * (1 - share) * np.clip((t - 0.85) / 0.15, 0, 1)[:, None]
    return Loft(loft.x_m - rake, loft.y_m, loft.z_m)


def _bulwark(loft: Loft, length: float) -> list[Part]:
    """The strake across the bow plate, and bollards along the sides."""
    corner = loft.gunwale(1.0)
    place = Place(corner * [1, 0, 1], length)
    half = corner[1] / length
    parts = [place.bar([[0, -half, 0], [0, half, 0]], 0.008, "trim")]
    for along in (0.08, 0.5, 0.9):
        for side in (1, -1):
            foot = Place(loft.gunwale(along) * [1, 0.9 * side, 1], length)
            parts.append(foot.bar([[0, 0, -0.01], [0, 0, 0.024]], 0.009, "dark", 10))
    return parts


def _fittings(loft: Loft, length: float, beam: float, rng: np.random.Generator) -> list[Part]:
    """A house aft or a housing amidships, a load forward, a gantry."""

    def on_deck(x: float, y: float = 0.0) -> Place:
        return Place(np.array([x * length, y * length, loft.gunwale(x + 0.5)[2] - 0.006 * length]), length)

    parts: list[Part] = []
    if rng.random() < 0.55:
        middle, roof = rng.uniform(-0.32, -0.24), rng.uniform(0.11, 0.17)
        parts += outfit.cabin(on_deck(middle), (0.2, 0.55 * beam, roof), (0.92, 0.94))
    else:
        middle, roof = rng.uniform(-0.1, 0.1), rng.uniform(0.05, 0.09)
        parts += outfit.equipment_box(on_deck(middle), (0.26, 0.6 * beam, roof))
    if middle < -0.2:
        for k in range(int(rng.integers(1, 4))):
            side = rng.uniform(-0.1, 0.1) * beam
            size = (rng.uniform(0.09, 0.14), rng.uniform(0.4, 0.6) * beam, rng.uniform(0.04, 0.1))
            parts.append(on_deck(-0.05 + 0.15 * k, side).box(size, ("accent", "dark", "cabin")[int(rng.integers(3))]))
    else:
        parts += outfit.solar_panel(on_deck(middle - 0.25), (0.18, 0.7 * beam))
        parts += outfit.cargo(on_deck(middle + 0.25), 0.6 * beam, rng)
    if rng.random() < 0.4:
        parts += outfit.arch(on_deck(0.38), 0.7 * beam, rng.uniform(0.14, 0.24), 0.012)
    parts += outfit.mast(on_deck(middle - 0.02).raised(roof * 0.8), rng.uniform(0.12, 0.26), 0.2 * beam, rng)
    if rng.random() < 0.6:
        parts += outfit.whip(on_deck(-0.44, 0.35 * beam), rng.uniform(0.2, 0.34))
    transom = np.array([loft.x_m[0, 0], 0.0, 0.0])
    if rng.random() < 0.5:
        parts += outfit.thrusters(transom, 0.28 * beam * length, length)
    else:
        parts += outfit.outboard(transom + loft.gunwale(0.0) * [0, 0, 1], length, 0.14)
    return parts
