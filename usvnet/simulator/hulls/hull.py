"""A boat as the renderer and the labels need it, and the one function that builds any of them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import HullSpec
from usvnet.simulator.hulls.barge import build_barge
from usvnet.simulator.hulls.catamaran import build_catamaran
from usvnet.simulator.hulls.mesh_hull import build_mesh_hull
from usvnet.simulator.hulls.monohull import build_monohull
from usvnet.simulator.hulls.paint import paint
from usvnet.simulator.hulls.rib import build_rib
from usvnet.simulator.hulls.shape import Shape
from usvnet.simulator.meshes import Mesh

BUILDERS: dict[str, Callable[[HullSpec], Shape]] = {
    "mono": build_monohull,
    "survey": build_monohull,
    "patrol": build_monohull,
    "catamaran": build_catamaran,
    "rib": build_rib,
    "barge": build_barge,
    "mesh": build_mesh_hull,
}


@dataclass(frozen=True)
class Hull:
    """A painted boat in the hull frame: x forward, y to port, z up, origin amidships on the resting waterline."""

    mesh: Mesh
    """The whole boat."""
    keypoints_m: NDArray[np.float64]
    """(7, 3) in the order of KEYPOINT_NAMES; bow_bottom and stern_bottom at z = 0."""
    stem_curve_m: NDArray[np.float64]
    """(n, 3) up the centreline of the bow, z strictly rising: where it meets the water is bow_bottom."""
    stern_curve_m: NDArray[np.float64]
    """(n, 3) up the middle of the stern, likewise."""
    waterline_outline_m: NDArray[np.float64]
    """(k, 2) the closed outline at z = 0, seen from above."""
    length_m: float
    beam_m: float
    freeboard_m: float
    """Height of the deck's edge above the resting waterline, amidships."""
    draught_m: float


def build_hull(spec: HullSpec, paint_seed: int) -> Hull:
    """Build a boat: ``spec`` alone decides its shape, ``paint_seed`` its colours and its number.

    Raises:
        ValueError: an unknown family, a length of no size, or a file of the family ``mesh`` that cannot be used.
    """
    if spec.family not in BUILDERS:
        raise ValueError(f"{spec.name}: family {spec.family!r}, expected one of {', '.join(BUILDERS)}")
    if not spec.length_m > 0:
        raise ValueError(f"{spec.name}: length_m {spec.length_m}, expected above 0")
    shape = BUILDERS[spec.family](spec)
    return Hull(
        paint(shape, paint_seed),
        shape.keypoints_m,
        shape.stem_curve_m,
        shape.stern_curve_m,
        shape.waterline_outline_m,
        shape.length_m,
        shape.beam_m,
        shape.freeboard_m,
        shape.draught_m,
    )
