"""The height of a polar grid's triangles over any point, as exact as the triangles themselves."""

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
NEIGHBOURS = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)]
TOLERANCE = 1e-6
"""Barycentric coordinates may be this much below zero: rounding must not leave cracks between triangles."""


class PolarHeights:
    """Heights of the triangles that :func:`usvnet.simulator.meshes.grid_faces` draws through a polar grid."""

    def __init__(self, radius_m: Doubles, azimuth_rad: Doubles, vertices_m: NDArray[np.float32]):
        """Remember the grid.

        Args:
            radius_m: (R,) rising distances of the rows from the origin.
            azimuth_rad: (C,) rising azimuths of the columns, clockwise from world y.
            vertices_m: (R * C, 3) row-major, exactly as drawn.
        """
        self.radius, self.azimuth = radius_m, azimuth_rad
        self.vertices = vertices_m.reshape(len(radius_m), len(azimuth_rad), 3)

    def __call__(self, x_m: NDArray, y_m: NDArray) -> Doubles:
        """Heights like x and y; NaN outside the grid."""
        x, y = np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)
        points = np.stack([x.ravel(), y.ravel()], -1)
        row = np.searchsorted(self.radius, np.hypot(points[:, 0], points[:, 1]), side="right") - 1
        column = np.searchsorted(self.azimuth, np.arctan2(points[:, 0], points[:, 1]), side="right") - 1
        heights = np.full(len(points), np.nan)
        # A row's triangles have straight edges inside its arc, so a point may lie in the next row's.
        left = np.arange(len(points))
        for down, across in NEIGHBOURS:
            heights[left] = self._in_cell(points[left], row[left] + down, column[left] + across)
            left = left[np.isnan(heights[left])]
            if not len(left):
                break
        return heights.reshape(x.shape)

    def _in_cell(self, points: Doubles, row: NDArray, column: NDArray) -> Doubles:
        """Heights in the two triangles of each point's cell; NaN where the point is in neither."""
        rows, columns = self.vertices.shape[:2]
        exists = (row >= 0) & (row < rows - 1) & (column >= 0) & (column < columns - 1)
        i, j = np.clip(row, 0, rows - 2), np.clip(column, 0, columns - 2)
        a, far, along = (self.vertices[p].astype(np.float64) for p in ((i, j), (i + 1, j + 1), (i, j + 1)))
        below = self.vertices[i + 1, j].astype(np.float64)
        heights = np.full(len(points), np.nan)
        for b, c in ((below, far), (far, along)):
            u, v, w = b[:, :2] - a[:, :2], c[:, :2] - a[:, :2], points - a[:, :2]
            area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
            area = np.where(area == 0, np.inf, area)  # no triangle at all holds no point
            second = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / area
            third = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / area
            inside = exists & (np.minimum(np.minimum(second, third), 1 - second - third) >= -TOLERANCE)
            plane = a[:, 2] + second * (b[:, 2] - a[:, 2]) + third * (c[:, 2] - a[:, 2])
            heights = np.where(inside & np.isnan(heights), plane, heights)
        return heights
