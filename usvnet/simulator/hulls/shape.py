"""A boat before it is painted: parts that say what they are made of, and what the labels need to know of the hull."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.meshes import Mesh

Doubles = NDArray[np.float64]
Material = Literal[
    "shell", "belly", "tube", "deck", "trim", "cabin", "accent", "panel", "dark", "glass", "metal", "as is"
]
"""``shell`` is painted with stripe, boot-top and bottom; ``belly`` is plainer, under the coloured ``tube`` of a rigid
inflatable; ``panel`` is solar cells; ``as is`` keeps the colours of its mesh."""


@dataclass(frozen=True)
class Part:
    """Triangles of one material, in the hull frame."""

    mesh: Mesh
    material: Material
    up: Doubles | None = None
    """(V,) share of the local freeboard, 0 on the resting waterline and 1 at the gunwale, for ``shell``."""


@dataclass(frozen=True)
class Sign:
    """Where letters may stand."""

    points_m: Doubles
    """(rows, columns, 3) a sheet just outside a side, from the top and from the left of who reads it."""
    material: Material
    """What is behind the letters."""
    up: Doubles
    """(rows, columns) as in :class:`Part`."""


@dataclass(frozen=True)
class Shape:
    """What :class:`usvnet.simulator.hulls.hull.Hull` says of a boat, and its parts."""

    parts: tuple[Part, ...]
    signs: tuple[Sign, ...]
    keypoints_m: Doubles
    stem_curve_m: Doubles
    stern_curve_m: Doubles
    waterline_outline_m: Doubles
    length_m: float
    beam_m: float
    freeboard_m: float
    draught_m: float


def seven_keypoints(bow: Doubles, shoulder: Doubles, stem: Doubles, corner: Doubles, stern: Doubles) -> Doubles:
    """Keypoints (7, 3) in the package's order.

    Args:
        bow: (3,)
        shoulder: (3,) bow_left; bow_right is its mirror image.
        stem: (n, 3) the curve that bow_bottom is on.
        corner: (3,) stern_left.
        stern: (n, 3) the curve that stern_bottom is on.
    """
    mirror = np.array([1.0, -1.0, 1.0])
    return np.stack(
        [bow, shoulder, shoulder * mirror, at_waterline(stem), corner, corner * mirror, at_waterline(stern)]
    )


def at_waterline(curve_m: Doubles) -> Doubles:
    """Where a curve (n, 3) of increasing z crosses the resting waterline: (3,) with z = 0."""
    x, y = (float(np.interp(0.0, curve_m[:, 2], curve_m[:, k])) for k in (0, 1))
    return np.array([x, y, 0.0])
