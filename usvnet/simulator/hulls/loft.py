"""A hull's shell as sections from stern to bow: triangles, deck, the curves on the centreline, the waterline."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usvnet.simulator.hulls.shape import Doubles, Part, Sign
from usvnet.simulator.meshes import Mesh, merge, sheet

CHINE = 0.45
"""Share of a section's points that lie below the chine."""
CURVE_POINTS = 300
PLATE_COLUMNS = 13
SIGN_ROWS, SIGN_COLUMNS = 20, 90


@dataclass(frozen=True)
class Loft:
    """The port half of a shell: N sections from stern to bow, each of m points from the keel up to the gunwale.

    The hull is its own mirror image in the plane y = 0.
    """

    x_m: Doubles
    """(N, m)"""
    y_m: Doubles
    """(N, m)"""
    z_m: Doubles
    """(N, m) never falls along a section."""

    def shell(self, shift_y_m: float = 0.0) -> Part:
        """Both sides, the transom and the bow plate (of no area where the bow is sharp), moved to port."""
        port = np.stack([self.x_m, self.y_m, self.z_m], -1)
        starboard = port * [1, -1, 1]
        across = np.linspace(1, -1, PLATE_COLUMNS)[None, :, None] * [0, 1, 0] + [1, 0, 1]
        transom, bow = port[0, :, None] * across, port[-1, :, None] * across
        up = self.z_m / self.z_m[:, -1:]
        plates_up = [np.repeat(up[i], PLATE_COLUMNS) for i in (0, -1)]
        mesh = merge([sheet(port, flip=True), sheet(starboard), sheet(transom, flip=True), sheet(bow)])
        return Part(mesh.moved(np.eye(3), [0, shift_y_m, 0]), "shell", np.concatenate([up.ravel()] * 2 + plates_up))

    def deck(self, sink_m: float, camber_m: float, shift_y_m: float = 0.0) -> Mesh:
        """The deck from gunwale to gunwale, ``sink_m`` below them and ``camber_m`` higher in the middle of the beam."""
        w = np.linspace(-1, 1, 9)
        half = self.y_m[:, -1:]
        x = np.broadcast_to(self.x_m[:, -1:], (len(half), len(w)))
        camber = np.where(np.arange(len(half)) == 0, 0.0, camber_m)[:, None]  # closes the gap above the transom
        z = self.z_m[:, -1:] - sink_m + camber * (1 - w**2) * half / half.max()
        return sheet(np.stack([x, 0.985 * half * w + shift_y_m, z], -1))

    def gunwale(self, place: ArrayLike) -> Doubles:
        """Points (..., 3) of the port gunwale at ``place`` 0 (stern) to 1 (bow) along the length."""
        x = self.x_m[:, -1]
        at = x[0] + np.asarray(place, float) * (x[-1] - x[0])
        return np.stack([at, np.interp(at, x, self.y_m[:, -1]), np.interp(at, x, self.z_m[:, -1])], -1)

    def stem_curve(self) -> Doubles:
        """The centreline (300, 3) from the forward end of the keel up the stem to the deck."""
        x = np.concatenate([self.x_m[:, 0], self.x_m[-1, 1:]])
        z = np.concatenate([self.z_m[:, 0], self.z_m[-1, 1:]])
        return rising_curve(x, z)

    def stern_curve(self) -> Doubles:
        """The centreline (300, 3) of the transom."""
        return rising_curve(self.x_m[0], self.z_m[0])

    def outline(self) -> Doubles:
        """The waterline (k, 2) seen from above, from the port corner of the stern around the bow."""
        rows = np.nonzero((self.z_m[:, 0] < 0) & (self.z_m[:, -1] > 0))[0]
        x = [np.interp(0.0, self.z_m[i], self.x_m[i]) for i in rows]
        y = [np.interp(0.0, self.z_m[i], self.y_m[i]) for i in rows]
        stem = self.stem_curve()
        port = np.stack([[*x, np.interp(0.0, stem[:, 2], stem[:, 0])], [*y, 0.0]], -1)
        return np.concatenate([port, port[-2::-1] * [1, -1]])

    def signs(self, place: float, low_m: float, high_m: float, shift_y_m: float = 0.0) -> tuple[Sign, Sign]:
        """Room for letters between two heights around ``place``, on the port side and on the starboard side."""
        length = float(np.ptp(self.x_m))
        width = min((high_m - low_m) * SIGN_COLUMNS / SIGN_ROWS, 0.4 * length)
        middle = self.gunwale(place)[0]
        x = np.linspace(middle + width / 2, middle - width / 2, SIGN_COLUMNS)  # from port, the bow is on the left
        z = np.linspace(high_m, low_m, SIGN_ROWS)
        stations = np.interp(x, self.x_m[:, -1], np.arange(len(self.x_m)))
        low = np.minimum(stations.astype(int), len(self.x_m) - 2)
        part = (stations - low)[:, None]
        y_of, z_of = (a[low] * (1 - part) + a[low + 1] * part for a in (self.y_m, self.z_m))
        y = np.stack([np.interp(z, z_of[k], y_of[k]) for k in range(SIGN_COLUMNS)], -1) + 0.002 * length
        points = np.stack([np.broadcast_to(x, y.shape), y + shift_y_m, np.broadcast_to(z[:, None], y.shape)], -1)
        up = z[:, None] / z_of[:, -1]
        return Sign(points, "shell", up), Sign(points[:, ::-1] * [1, -1, 1], "shell", up[:, ::-1])


def loft_sections(
    x_m: Doubles, half_m: Doubles, top_m: Doubles, keel_m: Doubles, chine: float, chine_width: ArrayLike, points: int
) -> Loft:
    """Sections of a hard-chine hull.

    Args:
        x_m: (N,) from stern to bow.
        half_m: (N,) half the beam at the gunwale.
        top_m: (N,) height of the gunwale.
        keel_m: (N,) height of the keel.
        chine: height of the chine between keel (0) and gunwale (1).
        chine_width: half the beam at the chine as a share of the gunwale's, one number or (N,).
        points: of each section, m.
    """
    below = max(3, round(points * 0.3))  # the bottom shows little, the side carries the stripes
    u = np.concatenate([np.linspace(0, CHINE, below)[:-1], np.linspace(CHINE, 1, points - below + 1)])
    half, top, keel = half_m[:, None], top_m[:, None], keel_m[:, None]
    y_chine = half * np.broadcast_to(np.asarray(chine_width, float), len(x_m))[:, None]
    z_chine = keel + (top - keel) * chine
    low, high = np.minimum(u / CHINE, 1), np.clip((u - CHINE) / (1 - CHINE), 0, 1)
    y = np.where(u < CHINE, y_chine * low, y_chine + (half - y_chine) * high**0.8)
    z = np.where(u < CHINE, keel + (z_chine - keel) * low**1.25, z_chine + (top - z_chine) * high)
    return Loft(np.broadcast_to(x_m[:, None], y.shape), y, z)


def rising_curve(x_m: NDArray, z_m: NDArray) -> Doubles:
    """The part (300, 3) of a line on the centreline from its last lowest point on, evenly spaced in height."""
    start = len(z_m) - 1 - int(np.argmin(z_m[::-1]))
    x, z = x_m[start:], np.maximum.accumulate(z_m[start:])
    rises = np.concatenate([[True], np.diff(z) > 1e-9])
    height = np.linspace(z[0], z[-1], CURVE_POINTS)
    return np.stack([np.interp(height, z[rises], x[rises]), np.zeros_like(height), height], -1)
