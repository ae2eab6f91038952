"""The water that a camera sees: a polar grid of triangles around it, as fine as the screen can show.

Rows are about as far apart on the screen everywhere, up to the far end; what waves the triangles cannot show becomes
roughness of the surface.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import SeaSpec
from usvnet.simulator.meshes import Mesh, grid_faces, make_mesh
from usvnet.simulator.polar_heights import PolarHeights
from usvnet.simulator.wake import Wake, wake_foam, wake_height
from usvnet.simulator.waves import Sea
from usvnet.simulator.whitecaps import whitecaps

Doubles = NDArray[np.float64]
Floats = NDArray[np.float32]
MARGIN, MARGIN_RAD, STEEPEST_RAD = 1.05, math.radians(2), math.radians(89)
"""The nearest row lies this much below the lowest ray."""
GROWTH = 1.06
"""Rows of the far water are this much farther than the ones before."""
CREST_STDS = 3.0
"""Crests that are looked for in front of the nearest flat water."""
SMOOTHEST_ALPHA, ROUGHEST_ALPHA = 0.012, 0.6
"""GGX roughness of still water, and the most that waves make of it."""
FLOOR_SIZE_M, FLOOR_ROUGHNESS = 6000.0, 0.35
FLOOR_BELOW_M = 0.05
FOAM_RGB, FOAM_ROUGHNESS = 0.6, 0.9


@dataclass(frozen=True)
class WaterView:
    """What a camera above the world's origin sees of the water."""

    height_m: float
    lowest_ray_rad: float
    """Steepest depression below the horizontal."""
    half_azimuth_rad: float
    """Largest azimuth to either side of straight ahead, world y."""
    focal_px: float


@dataclass(frozen=True)
class Water:
    """The drawn water."""

    mesh: Mesh
    """The waves, with smooth normals."""
    floor: Mesh
    """What shows below and beyond them."""
    far_m: float
    surface: PolarHeights = field(repr=False)

    def height_at(self, x_m: NDArray, y_m: NDArray) -> Doubles:
        """Height (N,) of the drawn triangles over x and y (N,), metres; NaN where none are drawn."""
        return self.surface(x_m, y_m)


def build_water(
    sea: Sea, view: WaterView, far_m: float, row_px: float, column_px: float, wakes: Sequence[Wake] = ()
) -> Water:
    """Draw the water.

    Args:
        sea: its waves.
        view: where it is seen from.
        far_m: where the waves end.
        row_px: distance between rows on the screen.
        column_px: distance between columns on the screen.
        wakes: boats that move through it.

    Raises:
        ValueError: a height, focal length, distance or spacing is not positive, or no water nearer than ``far_m``
            is in view.
    """
    sizes = (view.height_m, view.focal_px, far_m, row_px, column_px)
    if not min(sizes) > 0:
        raise ValueError(f"height, focal length, far end, row and column spacing are {sizes}, expected more than 0")
    radius = _row_distances(view, far_m, row_px, CREST_STDS * sea.height_std_m)
    azimuth = _column_azimuths(view, column_px)
    x, y = radius[:, None] * np.sin(azimuth), radius[:, None] * np.cos(azimuth)
    spacing = np.maximum(np.gradient(radius), radius * (azimuth[1] - azimuth[0]))
    heights, unresolved = sea.heights(x, y, spacing)
    foam = whitecaps(sea.spec, x, y, spacing)
    for wake in wakes:
        _add_wake(wake, x, y, spacing, heights, foam)
    vertices = np.stack([x, y, heights], -1).astype(np.float32).reshape(-1, 3)
    faces = np.ascontiguousarray(grid_faces(len(radius), len(azimuth))[:, ::-1])  # azimuth turns clockwise: turn up
    colours, roughness = _look(sea.spec, unresolved, foam)
    mesh = Mesh(vertices, faces, colours, roughness, _normals(heights, radius, azimuth))
    floor = _floor(sea, float(heights.min()))
    return Water(mesh, floor, far_m, PolarHeights(radius, azimuth, vertices))


def _row_distances(view: WaterView, far_m: float, row_px: float, crest_m: float) -> Doubles:
    """Distances along the water of the rows, nearest first."""
    steepest = min(MARGIN * view.lowest_ray_rad + MARGIN_RAD, STEEPEST_RAD)
    if steepest <= 0:
        raise ValueError("the camera sees no water: its lowest ray points into the sky")
    nearest = (view.height_m - min(crest_m, view.height_m / 2)) / math.tan(steepest)
    if nearest >= far_m:
        raise ValueError(f"the nearest water in view is {nearest:.1f} m away, expected less than far_m {far_m:g} m")
    step = row_px / view.focal_px
    # to the horizon by equal angles, until those rows would be farther apart than the far ones
    depressions = np.arange(math.atan2(view.height_m, nearest), step, -step)
    near = view.height_m / np.tan(depressions)
    near[0] = nearest
    wide = np.flatnonzero(near[1:] > GROWTH * near[:-1])
    near = near[: wide[0] + 1] if len(wide) else near
    near = near[near < far_m]
    more = max(1, math.ceil(math.log(far_m / near[-1]) / math.log(GROWTH)))
    return np.concatenate([near, near[-1] * (far_m / near[-1]) ** (np.arange(1, more + 1) / more)])


def _column_azimuths(view: WaterView, column_px: float) -> Doubles:
    half = min(view.half_azimuth_rad + MARGIN_RAD, math.pi)
    columns = max(2, math.ceil(2 * half * view.focal_px / column_px) + 1)
    return np.linspace(-half, half, columns)


def _add_wake(wake: Wake, x: Doubles, y: Doubles, spacing: Doubles, heights: Floats, foam: Floats) -> None:
    near = wake.nearby(x, y)
    if not near.any():
        return
    wide = np.broadcast_to(spacing[:, None], x.shape)[near]
    heights[near] += wake_height(wake, x[near], y[near], wide)
    foam[near] = np.maximum(foam[near], wake_foam(wake, x[near], y[near], wide))


def _normals(heights: Floats, radius: Doubles, azimuth: Doubles) -> Floats:
    """Unit normals (V, 3) from central differences along rows and columns."""
    outward = np.gradient(heights, radius.astype(np.float32), axis=0)
    around = np.gradient(heights, np.float32(azimuth[1] - azimuth[0]), axis=1) / radius[:, None].astype(np.float32)
    s, c = np.sin(azimuth).astype(np.float32), np.cos(azimuth).astype(np.float32)
    normals = np.empty((*heights.shape, 3), np.float32)
    normals[..., 0] = -(outward * s + around * c)
    normals[..., 1] = -(outward * c - around * s)
    normals[..., 2] = 1
    normals /= np.sqrt(1 + outward * outward + around * around)[..., None]
    return normals.reshape(-1, 3)


def _look(spec: SeaSpec, unresolved: Floats, foam: Floats) -> tuple[Floats, Floats]:
    """Colours (V, 3) and roughness (V,)."""
    alpha = np.clip(np.sqrt(unresolved + SMOOTHEST_ALPHA**2), SMOOTHEST_ALPHA, ROUGHEST_ALPHA)
    rough = np.sqrt(alpha)[:, None]  # principled surfaces square theirs
    roughness = (rough + foam * (FOAM_ROUGHNESS - rough)).astype(np.float32)
    water = np.asarray(spec.colour_rgb, np.float32)
    colours: Floats = water + foam[..., None] * (np.float32(FOAM_RGB) - water)
    return colours.reshape(-1, 3), roughness.ravel()


def _floor(sea: Sea, lowest_m: float) -> Mesh:
    below = min(lowest_m, -4 * sea.height_std_m) - FLOOR_BELOW_M
    corners = [[sx * FLOOR_SIZE_M, sy * FLOOR_SIZE_M, below] for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return make_mesh(corners, [[0, 1, 2], [0, 2, 3]], sea.spec.colour_rgb, FLOOR_ROUGHNESS)
