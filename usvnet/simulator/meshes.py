"""Triangles with a colour and a roughness at every vertex, and the solids that scenes are put together from.

Everything in a scene is such a mesh: one kind of surface keeps the renderer's compiled kernels the same from frame to
frame. Faces are counter-clockwise seen from outside.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Mesh:
    """V vertices and F triangles."""

    vertices_m: Floats
    """(V, 3)"""
    faces: NDArray[np.uint32]
    """(F, 3) indices of vertices."""
    colours: Floats
    """(V, 3) linear RGB reflectance."""
    roughness: Floats
    """(V,) 0 is a mirror, 1 is matt."""
    normals: Floats | None = None
    """(V, 3) for a smooth surface; None shows the facets."""

    def painted(self, colour: ArrayLike, roughness: float | None = None) -> "Mesh":
        """The same triangles in one linear RGB ``colour`` (3,) or one a vertex (V, 3)."""
        colours = np.broadcast_to(np.asarray(colour, np.float32), self.vertices_m.shape).copy()
        rough = self.roughness if roughness is None else np.full(len(self.vertices_m), roughness, np.float32)
        return replace(self, colours=colours, roughness=rough)

    def moved(self, rotation: ArrayLike, shift_m: ArrayLike) -> "Mesh":
        """Turned by ``rotation`` (3, 3) and then shifted by ``shift_m`` (3,)."""
        R, t = np.asarray(rotation, np.float64), np.asarray(shift_m, np.float64)
        normals = None if self.normals is None else (self.normals @ R.T).astype(np.float32)
        return replace(self, vertices_m=(self.vertices_m @ R.T + t).astype(np.float32), normals=normals)


def make_mesh(vertices_m: ArrayLike, faces: ArrayLike, colour: ArrayLike = (0.5, 0.5, 0.5), rough: float = 0.5) -> Mesh:
    """A mesh of vertices (V, 3) and faces (F, 3) in one colour (3,) or one a vertex (V, 3)."""
    vertices = np.asarray(vertices_m, np.float32)
    colours = np.broadcast_to(np.asarray(colour, np.float32), vertices.shape).copy()
    return Mesh(vertices, np.asarray(faces, np.uint32), colours, np.full(len(vertices), rough, np.float32))


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """All triangles in one mesh; a smooth one among them is shown with facets."""
    starts = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices_m for mesh in meshes]),
        np.concatenate([mesh.faces + np.uint32(start) for mesh, start in zip(meshes, starts)]),
        np.concatenate([mesh.colours for mesh in meshes]),
        np.concatenate([mesh.roughness for mesh in meshes]),
    )


def grid_faces(rows: int, columns: int, wrap: bool = False) -> NDArray[np.uint32]:
    """Triangles between the vertices of a grid (rows, columns) in row-major order.

    They face where (next row) x (next column) points; ``wrap`` joins the last column to the first.
    """
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns if wrap else columns - 1), indexing="ij")
    a, b = i * columns + j, i * columns + (j + 1) % columns
    quads = np.stack([a, a + columns, b + columns, b], -1).reshape(-1, 4)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.uint32)


def sheet(points_m: ArrayLike, colour: ArrayLike = (0.5, 0.5, 0.5), rough: float = 0.5, flip: bool = False) -> Mesh:
    """A surface through a grid of points (rows, columns, 3); see :func:`grid_faces` for its side, ``flip`` turns it."""
    points = np.asarray(points_m, np.float32)
    faces = grid_faces(*points.shape[:2])
    return make_mesh(points.reshape(-1, 3), faces[:, ::-1] if flip else faces, colour, rough)


def box(
    centre_m: ArrayLike, size_m: ArrayLike, taper: tuple[float, float] = (1.0, 1.0), rake_m: float = 0.0, **look: object
) -> Mesh:
    """A box whose top is ``taper`` times as long and wide as its bottom, and shifted by ``rake_m`` along x."""
    corners = np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]]) * np.asarray(size_m) / 2
    top = corners * [*taper, -1] + [rake_m, 0, 0]
    faces = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4]]
    faces += [[1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7]]
    return make_mesh(np.concatenate([corners, top]) + np.asarray(centre_m), faces, **look)  # type: ignore[arg-type]


def tube(path_m: ArrayLike, radius_m: ArrayLike, sides: int = 12, **look: object) -> Mesh:
    """A round bar along the points (P, 3), with one radius or one a point, closed at both ends."""
    path = np.asarray(path_m, float)
    radius = np.broadcast_to(np.asarray(radius_m, float), len(path))
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-12
    aside = np.where(np.abs(along[:, 2:3]) > 0.9, [[1.0, 0, 0]], [[0, 0, 1.0]])
    first = np.cross(along, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(along, first)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    vertices = (path[:, None] + radius[:, None, None] * ring).reshape(-1, 3)
    faces = grid_faces(len(path), sides, wrap=True)[:, ::-1]
    turn, end, last = np.arange(sides), len(vertices), (len(path) - 1) * sides
    caps = np.concatenate(
        [
            np.stack([np.full(sides, end), (turn + 1) % sides, turn], -1),
            np.stack([np.full(sides, end + 1), last + turn, last + (turn + 1) % sides], -1),
        ]
    )
    vertices = np.concatenate([vertices, path[:1], path[-1:]])
    return make_mesh(vertices, np.concatenate([faces, caps]), **look)  # type: ignore[arg-type]


def ball(centre_m: ArrayLike, radii_m: ArrayLike, around: int = 16, down: int = 10, **look: object) -> Mesh:
    """An ellipsoid with one radius or three."""
    azimuth = np.linspace(0, 2 * np.pi, around, endpoint=False)
    polar = np.linspace(0, np.pi, down)[:, None]
    sphere = np.stack(
        np.broadcast_arrays(np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)), -1
    )
    vertices = sphere.reshape(-1, 3) * np.asarray(radii_m) + np.asarray(centre_m)
    return make_mesh(vertices, grid_faces(down, around, wrap=True), **look)  # type: ignore[arg-type]
