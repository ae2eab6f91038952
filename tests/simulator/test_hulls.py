"""Boats: keypoints on the mesh and the water, shells that face outward, paint that moves nothing, files."""

import struct
import time
from pathlib import Path

import numpy as np
import pytest

from usvnet.simulator.frame_spec import HullSpec
from usvnet.simulator.hulls.hull import BUILDERS, Hull, build_hull
from usvnet.simulator.hulls.paint import write
from usvnet.types import FLIP_INDEX

FAMILIES = ("mono", "survey", "patrol", "catamaran", "rib", "barge")
CASES = [(family, seed) for family in FAMILIES for seed in range(6)]
SQUARE_BOAT = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-0.3, 0.3) for z in (-0.1, 0.2)])
SQUARE_FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
SQUARE_KEYPOINTS = (
    (1.0, 0.0, 0.2), (0.6, 0.3, 0.2), (0.6, -0.3, 0.2), (1.0, 0.0, 0.0), (-1.0, 0.3, 0.2), (-1.0, -0.3, 0.2),
    (-1.0, 0.0, 0.0),
)  # fmt: skip


def hull_of(family: str, seed: int, length_m: float = 2.0, paint_seed: int = 1) -> Hull:
    return build_hull(HullSpec("hull", family, length_m, seed), paint_seed)


def distance_to_mesh(point, vertices, faces):
    """Distance from a point to the nearest triangle."""
    a, b, c = np.moveaxis(vertices.astype(float)[faces], 1, 0)
    normal = np.cross(b - a, c - a)
    real = np.linalg.norm(normal, axis=1) > 0
    a, b, c, normal = a[real], b[real], c[real], normal[real]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    edges = [(a, b), (b, c), (c, a)]
    inside = np.all([np.einsum("ij,ij->i", np.cross(q - p, point - p), normal) >= 0 for p, q in edges], axis=0)
    best = np.abs(np.einsum("ij,ij->i", point - a, normal))[inside].min(initial=np.inf)
    for p, q in edges:
        along = np.clip(np.einsum("ij,ij->i", point - p, q - p) / ((q - p) ** 2).sum(1), 0, 1)
        best = min(best, np.linalg.norm(p + along[:, None] * (q - p) - point, axis=1).min())
    return best


@pytest.mark.parametrize(("family", "seed"), CASES)
def test_waterline_keypoints_are_where_the_curves_cross_the_resting_water(family, seed):
    hull = hull_of(family, seed)
    for k, curve in ((3, hull.stem_curve_m), (6, hull.stern_curve_m)):
        assert (np.diff(curve[:, 2]) > 0).all()
        assert curve[0, 2] < -0.02 * hull.length_m
        assert curve[-1, 2] > 0.03 * hull.length_m
        assert (curve[:, 1] == 0).all()
        crossing = [np.interp(0.0, curve[:, 2], curve[:, axis]) for axis in range(3)]
        np.testing.assert_allclose(hull.keypoints_m[k], crossing, atol=1e-9)
        assert hull.keypoints_m[k, 2] == 0


@pytest.mark.parametrize(("family", "seed"), CASES)
def test_keypoints_are_their_own_mirror_image(family, seed):
    keypoints = hull_of(family, seed).keypoints_m
    np.testing.assert_array_equal(keypoints, keypoints[list(FLIP_INDEX)] * [1, -1, 1])
    assert keypoints[1, 1] > 0 < keypoints[4, 1]  # left is port is y > 0
    assert keypoints[1, 0] > keypoints[4, 0]


@pytest.mark.parametrize("family", FAMILIES)
def test_the_bow_is_ahead_of_its_shoulders(family):
    for seed in range(6):
        keypoints = hull_of(family, seed).keypoints_m
        assert keypoints[0, 0] > keypoints[1, 0]


@pytest.mark.parametrize(("family", "seed"), CASES)
def test_keypoints_lie_on_the_mesh(family, seed):
    hull = hull_of(family, seed)
    for k, point in enumerate(hull.keypoints_m):
        if family == "catamaran" and k in (3, 6):
            continue  # midway between its two hulls there is only water
        distance = distance_to_mesh(point, hull.mesh.vertices_m, hull.mesh.faces)
        assert distance < 0.015 * hull.length_m, f"keypoint {k} is {distance / hull.length_m:.3f} lengths off"


@pytest.mark.parametrize(("family", "seed"), CASES)
def test_the_mesh_is_fit_to_render(family, seed):
    mesh = hull_of(family, seed).mesh
    assert np.isfinite(mesh.vertices_m).all()
    assert mesh.colours.shape == mesh.vertices_m.shape
    assert (mesh.colours >= 0).all()
    assert (mesh.colours <= 0.9).all()
    assert (mesh.roughness > 0).all()
    assert (mesh.roughness <= 1).all()
    assert mesh.faces.max() < len(mesh.vertices_m)
    assert len(mesh.faces) <= 60_000


@pytest.mark.parametrize(("family", "seed"), CASES)
def test_the_shell_faces_outward(family, seed):
    shape = BUILDERS[family](HullSpec("hull", family, 2.0, seed))
    shells = [part.mesh for part in shape.parts if part.material in ("shell", "belly")]
    assert len(shells) == (2 if family == "catamaran" else 1)
    for mesh in shells:
        a, b, c = np.moveaxis(mesh.vertices_m.astype(float)[mesh.faces], 1, 0)
        area_normal = np.cross(b - a, c - a) / 2
        out = (a + b + c) / 3 - mesh.vertices_m.mean(0)
        area = np.linalg.norm(area_normal, axis=1)
        outward = np.einsum("ij,ij->i", area_normal, out) > 0
        assert area[outward].sum() > 0.95 * area.sum()


@pytest.mark.parametrize(("family", "seed"), CASES)
def test_sizes_are_those_of_the_mesh(family, seed):
    hull = hull_of(family, seed)
    outline = hull.waterline_outline_m
    assert hull.length_m == 2.0
    assert 0.2 < hull.beam_m / hull.length_m < 0.8
    assert abs(hull.keypoints_m[0, 0] - hull.keypoints_m[4, 0]) <= hull.length_m * 1.001
    x, y = outline.T
    area = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    assert 0.3 < area / (hull.length_m * hull.beam_m) < 1.0
    assert np.abs(y).max() <= hull.beam_m / 2 + 1e-6
    assert hull.freeboard_m > 0 < hull.draught_m


@pytest.mark.parametrize("family", FAMILIES)
def test_the_same_spec_is_the_same_hull(family):
    first, second = hull_of(family, 3), hull_of(family, 3)
    for name in ("vertices_m", "faces", "colours", "roughness"):
        np.testing.assert_array_equal(getattr(first.mesh, name), getattr(second.mesh, name))
    np.testing.assert_array_equal(first.keypoints_m, second.keypoints_m)
    assert not np.allclose(first.keypoints_m, hull_of(family, 4).keypoints_m)


@pytest.mark.parametrize("family", FAMILIES)
def test_paint_moves_nothing(family):
    first, second = hull_of(family, 3, paint_seed=1), hull_of(family, 3, paint_seed=2)
    np.testing.assert_array_equal(first.mesh.vertices_m, second.mesh.vertices_m)
    np.testing.assert_array_equal(first.keypoints_m, second.keypoints_m)
    assert np.abs(first.mesh.colours - second.mesh.colours).max() > 0.05


@pytest.mark.parametrize("family", FAMILIES)
def test_a_longer_boat_has_the_same_proportions(family):
    small, large = hull_of(family, 2, length_m=0.9), hull_of(family, 2, length_m=12.0)
    np.testing.assert_allclose(large.keypoints_m, small.keypoints_m * 12 / 0.9, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(large.mesh.vertices_m, small.mesh.vertices_m * 12 / 0.9, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("family", FAMILIES)
def test_letters_run_from_left_to_right_for_who_looks_at_either_side(family):
    port, starboard = BUILDERS[family](HullSpec("hull", family, 2.0, 5)).signs
    for sign, side in ((port, 1), (starboard, -1)):
        points = sign.points_m
        assert (points[..., 1] * side > 0).all()
        assert (np.diff(points[..., 0], axis=1) * -side > 0).all()  # from port, forward is to the left
        assert (np.diff(points[..., 2], axis=0) < 0).all()
    ink = write("USV-07", 20, 90)
    assert 0.1 < (ink > 0.5).mean() < 0.6
    assert write("", 20, 90).max() == 0


def test_a_boat_is_built_quickly():
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        hull_of("catamaran", 1)
        best = min(best, time.process_time() - start)
    assert best < 0.25


@pytest.mark.parametrize("changes", [{"family": "submarine"}, {"family": "mesh"}])
def test_a_spec_that_cannot_be_built_is_refused(changes):
    with pytest.raises(ValueError, match=r"hull|famil"):
        build_hull(HullSpec("hull", length_m=2.0, seed=0, **changes), 0)


def obj_text() -> str:
    lines = [f"v {x} {y} {z}" for x, y, z in SQUARE_BOAT]
    return "\n".join(["# a box", *lines, *("f " + " ".join(f"{i + 1}/1/1" for i in face) for face in SQUARE_FACES)])


def ply_bytes(form: str, colour: tuple[int, int, int] | None = None) -> bytes:
    colours = ["property uchar " + name for name in ("red", "green", "blue")] if colour else []
    header = ["ply", f"format {form} 1.0", "comment a box", "element vertex 8"]
    header += ["property float x", "property float y", "property float z", *colours, "element face 6"]
    head = "\n".join([*header, "property list uchar int vertex_indices", "end_header\n"]).encode()
    extra = colour or ()
    if form == "ascii":
        rows = [" ".join(map(str, (*point, *extra))) for point in SQUARE_BOAT.tolist()]
        rows += ["4 " + " ".join(map(str, face)) for face in SQUARE_FACES]
        return head + "\n".join(rows).encode()
    rows = [struct.pack(f"<3f{len(extra)}B", *point, *extra) for point in SQUARE_BOAT]
    return head + b"".join([*rows, *(struct.pack("<B4i", 4, *face) for face in SQUARE_FACES)])


def own_boat(path: Path, data: bytes, keypoints=SQUARE_KEYPOINTS) -> Hull:
    path.write_bytes(data)
    return build_hull(HullSpec("mine", "mesh", 2.0, 0, path, keypoints), 1)


@pytest.mark.parametrize(
    ("name", "data"),
    [("a.obj", obj_text().encode()), ("a.ply", ply_bytes("ascii")), ("b.ply", ply_bytes("binary_little_endian"))],
)
def test_a_file_keeps_its_shape(tmp_path, name, data):
    hull = own_boat(tmp_path / name, data)
    corners = hull.mesh.vertices_m.astype(float)[hull.mesh.faces]
    a, b, c = np.moveaxis(corners, 1, 0)
    np.testing.assert_allclose(corners.min((0, 1)), SQUARE_BOAT.min(0), atol=1e-6)
    np.testing.assert_allclose(corners.max((0, 1)), SQUARE_BOAT.max(0), atol=1e-6)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6  # closed and outward, however it was cut up
    assert volume == pytest.approx(2.0 * 0.6 * 0.3, rel=1e-4)
    np.testing.assert_allclose(hull.keypoints_m, SQUARE_KEYPOINTS)
    assert hull.draught_m == pytest.approx(0.1)
    assert hull.beam_m == pytest.approx(0.6)
    for k, curve in ((3, hull.stem_curve_m), (6, hull.stern_curve_m)):
        assert (np.diff(curve[:, 2]) > 0).all()
        crossing = [np.interp(0.0, curve[:, 2], curve[:, axis]) for axis in range(3)]
        np.testing.assert_allclose(crossing, SQUARE_KEYPOINTS[k], atol=1e-6)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_a_file_keeps_its_colours(tmp_path, form):
    hull = own_boat(tmp_path / "a.ply", ply_bytes(form, (255, 128, 0)))
    np.testing.assert_allclose(hull.mesh.colours, [[1, (128 / 255) ** 2.2, 0]] * len(hull.mesh.colours), atol=0.01)


@pytest.mark.parametrize(
    ("name", "data", "place"),
    [
        ("a.obj", obj_text().replace("v -1.0 -0.3 -0.1", "v -1.0 x -0.1").encode(), r"2"),
        ("a.obj", (obj_text() + "\nf 1 2 99").encode(), r"16"),
        ("a.obj", (obj_text() + "\nf 1 2").encode(), r"16"),
        ("a.obj", b"# nothing", ""),
        ("a.stl", obj_text().encode(), ""),
        ("a.ply", ply_bytes("ascii").replace(b"ascii", b"binary_big_endian"), r"2"),
        ("a.ply", ply_bytes("ascii").replace(b"4 0 1 3 2", b"4 0 1 3"), r"19"),
        ("a.ply", ply_bytes("ascii").replace(b"4 0 1 3 2", b"nan 0 1 3 2"), r"19"),
        ("a.ply", ply_bytes("ascii").replace(b"4 0 1 3 2", b"4 0 1 3.5 2"), r"19"),
        ("a.ply", ply_bytes("ascii").replace(b"property float x", b"property list uchar float x"), ""),
        ("a.ply", ply_bytes("ascii").replace(b"end_header", b"the end"), ""),
        ("a.ply", ply_bytes("binary_little_endian")[:-3], ""),
        ("a.ply", b"solid", r"1"),
    ],
)
def test_a_bad_file_is_refused_by_name_and_line(tmp_path, name, data, place):
    path = tmp_path / name
    with pytest.raises(ValueError, match=r".") as refused:
        own_boat(path, data)
    message = str(refused.value)
    assert str(path) in message
    assert place in message.replace(str(path), "")


def test_a_missing_file_and_a_boat_on_land_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"none\.obj"):
        build_hull(HullSpec("mine", "mesh", 2.0, 0, tmp_path / "none.obj", SQUARE_KEYPOINTS), 1)
    with pytest.raises(ValueError, match="water"):
        own_boat(tmp_path / "a.obj", obj_text().replace("-0.1", "0.1").encode())
    sunk = (*SQUARE_KEYPOINTS[:3], (1.0, 0.0, 0.1), *SQUARE_KEYPOINTS[4:])
    with pytest.raises(ValueError, match="bow_bottom"):
        own_boat(tmp_path / "b.obj", obj_text().encode(), sunk)


@pytest.mark.parametrize(
    "moved", [lambda xyz: 1000 * xyz, lambda xyz: xyz[:, [0, 2, 1]] * [1, 1, -1], lambda xyz: xyz[:, [1, 0, 2]]]
)
def test_a_mesh_in_other_units_or_axes_than_its_keypoints_is_refused(tmp_path, moved):
    rows = iter(moved(SQUARE_BOAT).tolist())
    lines = [
        " ".join(map(str, ["v", *next(rows)])) if line.startswith("v ") else line for line in obj_text().splitlines()
    ]
    with pytest.raises(ValueError, match=r"a\.obj: the mesh spans x .* does not fit its keypoints, 2 m long"):
        own_boat(tmp_path / "a.obj", "\n".join(lines).encode())
