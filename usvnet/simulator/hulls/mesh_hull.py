"""The family ``mesh``: a user's own boat, from a file of triangles and its seven keypoints."""

import cv2
import numpy as np

from usvnet.simulator.frame_spec import HullSpec
from usvnet.simulator.hulls.shape import Doubles, Material, Part, Shape
from usvnet.simulator.hulls.triangle_files import read_triangles
from usvnet.simulator.meshes import Mesh, make_mesh

CURVE_POINTS = 300
STRIPE_CELL = 0.03
"""Triangles are cut until no edge is longer than this share of the length: their corners carry the paint."""
MOST_ROUNDS, MOST_TRIANGLES = 6, 40_000
OUTSIDE = 0.05
"""How far beyond the mesh a keypoint may lie, as a share of the length: waterline points do, under an overhang."""
LENGTHS = (0.8, 1.6)
"""How long a mesh may be over the length between its keypoints: a bowsprit and an engine count with it."""
FACES_UP = 0.7
"""Cosine of the slope below which a face is a deck."""
BARE_ROUGHNESS = 0.4


def build_mesh_hull(spec: HullSpec) -> Shape:
    """A boat from ``spec.mesh_file`` and ``spec.keypoints_m``; a file with colours keeps them.

    Raises:
        ValueError: the file cannot be used, the keypoints do not fit together, or the mesh does not reach the water.
    """
    if spec.mesh_file is None or spec.keypoints_m is None:
        raise ValueError(f"hull {spec.name}: the family mesh needs a mesh_file and keypoints")
    read = read_triangles(spec.mesh_file)
    keypoints = np.array(spec.keypoints_m, np.float64)
    _check(keypoints, f"hull {spec.name}")
    length = spec.length_m
    freeboard = float((keypoints[1, 2] + keypoints[4, 2]) / 2)
    corners = read.vertices_m[read.faces]  # (F, 3, 3) own corners for every face: it may be of another material
    if not (corners[..., 2].min() < 0 < corners[..., 2].max()):
        raise ValueError(f"{spec.mesh_file}: the mesh does not cross the resting waterline z = 0")
    _check_together(corners.reshape(-1, 3), keypoints, length, str(spec.mesh_file))
    if read.colours_srgb is None:
        parts = _by_place(corners, freeboard, float(keypoints[0, 2]), length)
    else:
        linear = (read.colours_srgb[read.faces].reshape(-1, 3) / 255.0) ** 2.2
        parts = (Part(_mesh(corners).painted(linear, BARE_ROUGHNESS), "as is"),)
    below = min(float(corners[..., 2].min()), -0.02 * length)
    return Shape(
        parts=parts,
        signs=(),
        keypoints_m=keypoints,
        stem_curve_m=_straight(keypoints[3], keypoints[0], below),
        stern_curve_m=_straight(keypoints[6], keypoints[4:6].mean(0), below),
        waterline_outline_m=_outline(corners),
        length_m=length,
        beam_m=float(np.ptp(corners[..., 1])),
        freeboard_m=freeboard,
        draught_m=float(-corners[..., 2].min()),
    )


def _check(keypoints: Doubles, name: str) -> None:
    if keypoints.shape != (7, 3) or not np.isfinite(keypoints).all():
        raise ValueError(f"{name}: expected seven finite keypoints, got {keypoints.shape}")
    if np.abs(keypoints[[3, 6], 2]).max() > 1e-6:
        raise ValueError(f"{name}: bow_bottom and stern_bottom lie on the resting waterline, z = 0")
    if min(keypoints[0, 2], keypoints[4:6, 2].mean()) <= 0:
        raise ValueError(f"{name}: bow and stern corners lie above the resting waterline, z > 0")
    if keypoints[1, 1] <= keypoints[2, 1] or keypoints[4, 1] <= keypoints[5, 1]:
        raise ValueError(f"{name}: left keypoints lie to port, at greater y than the right ones")
    if keypoints[3, 0] <= keypoints[6, 0]:
        raise ValueError(f"{name}: the bow lies ahead of the stern, at greater x")


def _check_together(vertices: Doubles, keypoints: Doubles, length_m: float, name: str) -> None:
    """Insist that mesh and keypoints are one boat's: in metres, x forward and z up, origin amidships at the water."""
    low, high = vertices.min(0), vertices.max(0)
    reach_m = OUTSIDE * length_m
    outside = ((keypoints < low - reach_m) | (keypoints > high + reach_m)).any(1)
    longest = float(high[0] - low[0]) / length_m
    if outside.any() or not LENGTHS[0] < longest < LENGTHS[1]:
        spans = ", ".join(f"{axis} {a:.3g} to {b:.3g}" for axis, a, b in zip("xyz", low, high))
        raise ValueError(
            f"{name}: the mesh spans {spans} and does not fit its keypoints, {length_m:.3g} m long: expected metres, "
            "x forward, y to port, z up, and the origin amidships on the resting waterline"
        )


def _straight(through: Doubles, to: Doubles, below_m: float) -> Doubles:
    """A line (300, 3) up to ``to`` that goes on downward beyond ``through``, to the height ``below_m``."""
    share = np.linspace(below_m / to[2], 1, CURVE_POINTS)[:, None]
    line: Doubles = through + share * (to - through)
    return line


def _by_place(corners: Doubles, freeboard: float, bow_z: float, length: float) -> tuple[Part, ...]:
    """Deck where a face looks up, skin below the highest edge of the deck, cabin above."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    tilt = normal[:, 2] / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    low = corners[..., 2].mean(1) < max(freeboard, bow_z)
    deck = (tilt > FACES_UP) & (corners[..., 2].mean(1) > 0)
    kinds: list[tuple[Material, Doubles]] = [("deck", corners[deck]), ("cabin", corners[~deck & ~low])]
    parts = [Part(_mesh(faces), material) for material, faces in kinds if len(faces)]
    skin = corners[~deck & low]
    if len(skin):
        mesh = _mesh(_cut(skin, STRIPE_CELL * length))
        parts.append(Part(mesh, "shell", mesh.vertices_m[:, 2].astype(np.float64) / freeboard))
    return tuple(parts)


def _cut(corners: Doubles, longest_m: float) -> Doubles:
    """Faces (F, 3, 3), every one with a longer edge cut in four, again and again."""
    for _ in range(MOST_ROUNDS):
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
        large = edges > longest_m
        if not large.any() or len(corners) + 3 * int(large.sum()) > MOST_TRIANGLES:
            break
        a, b, c = np.moveaxis(corners[large], 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        quarters = [np.stack(face, 1) for face in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        corners = np.concatenate([corners[~large], *quarters])
    return corners


def _mesh(corners: Doubles) -> Mesh:
    return make_mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _outline(corners: Doubles) -> Doubles:
    """The convex outline (k, 2) of what crosses z = 0."""
    ends = np.concatenate([np.stack([corners[:, k], corners[:, (k + 1) % 3]], 1) for k in range(3)])
    ends = ends[(ends[:, 0, 2] < 0) != (ends[:, 1, 2] < 0)]
    share = ends[:, 0, 2] / (ends[:, 0, 2] - ends[:, 1, 2])
    points = ends[:, 0, :2] + share[:, None] * (ends[:, 1, :2] - ends[:, 0, :2])
    return np.asarray(cv2.convexHull(points.astype(np.float32))[:, 0], np.float64)
