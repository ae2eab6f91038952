"""The shore: where it stands, how many triangles it costs, and that it repeats."""

import numpy as np
import pytest

from usvnet.simulator.buildings import church, flats, house, shed
from usvnet.simulator.frame_spec import ShoreSpec
from usvnet.simulator.land import make_land, rock, spiral
from usvnet.simulator.meshes import Mesh
from usvnet.simulator.shore import build_shore, grow_kinds, nothing
from usvnet.simulator.trees import plant, reed_clump

KINDS = ("trees", "town", "mixed", "harbour")
HALF_RAD, EYE_M = 0.6, 1.7


def check_mesh(mesh: Mesh) -> None:
    assert np.isfinite(mesh.vertices_m).all()
    assert mesh.faces.max() < len(mesh.vertices_m)
    assert mesh.colours.shape == mesh.vertices_m.shape
    assert 0 <= mesh.colours.min() <= mesh.colours.max() <= 0.95
    assert len(mesh.roughness) == len(mesh.vertices_m)
    assert 0 <= mesh.roughness.min() <= mesh.roughness.max() <= 1


def areas(mesh: Mesh) -> np.ndarray:
    a, b, c = mesh.vertices_m.astype(float)[mesh.faces].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("distance_m", [12, 60, 350, 5000])
def test_shore_stands_at_its_distance_across_the_view(kind: str, distance_m: float) -> None:
    mesh = build_shore(ShoreSpec(kind, distance_m, 5), HALF_RAD, EYE_M)
    check_mesh(mesh)
    assert 5_000 < len(mesh.faces) <= 120_000
    x, y, z = mesh.vertices_m.astype(float).T
    reach, azimuth = np.hypot(x, y), np.arctan2(x, y)
    wet = reach[z < -0.05]
    assert wet.min() > 0.8 * distance_m - 8  # moored posts and stones stand in front of the quay
    above = (z > 0.3) & (reach < 2 * distance_m + 80)
    assert azimuth[above].min() < -0.9 * HALF_RAD
    assert azimuth[above].max() > 0.9 * HALF_RAD


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(6))
def test_no_seed_breaks_the_triangle_budget(kind: str, seed: int) -> None:
    for distance_m, half in ((30, 0.4), (150, 0.7), (900, 1.0)):
        assert len(build_shore(ShoreSpec(kind, distance_m, seed), half, EYE_M).faces) <= 120_000


@pytest.mark.parametrize("eye_m", [1.0, 12.0])
def test_no_gap_opens_between_the_land_and_the_sky(eye_m: float) -> None:
    mesh = build_shore(ShoreSpec("trees", 80, 2), HALF_RAD, eye_m)
    x, y, z = mesh.vertices_m.astype(float).T
    far = np.hypot(x, y) > 850
    elevation = (z[far] - eye_m) / np.hypot(x, y)[far]
    column = np.digitize(np.arctan2(x, y)[far], np.linspace(-HALF_RAD, HALF_RAD, 40))
    assert min(elevation[column == number].max() for number in np.unique(column)) > 0


def test_none_is_one_triangle_far_below_the_water() -> None:
    mesh = build_shore(ShoreSpec("none", 100, 1), HALF_RAD, EYE_M)
    assert len(mesh.faces) == 1
    assert mesh.vertices_m[:, 2].max() < -100
    assert areas(nothing())[0] > 0


@pytest.mark.parametrize("kind", KINDS)
def test_seed_decides_the_shore(kind: str) -> None:
    first, again, other = (build_shore(ShoreSpec(kind, 90, seed), HALF_RAD, EYE_M) for seed in (1, 1, 2))
    for name in ("vertices_m", "faces", "colours", "roughness"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert first.vertices_m.shape != other.vertices_m.shape or not np.allclose(first.vertices_m, other.vertices_m)


@pytest.mark.parametrize("build", [house, flats, church, shed])
def test_buildings_stand_on_the_ground_with_glass_in_front(build) -> None:
    for seed in range(4):
        mesh = build(np.random.default_rng(seed))
        check_mesh(mesh)
        assert mesh.vertices_m[:, 2].max() > 4
        assert -2.1 < mesh.vertices_m[:, 2].min() <= -1.9
        glass = mesh.vertices_m[mesh.roughness < 0.1]
        assert len(glass) >= 8
        assert glass[:, 2].min() > 0


@pytest.mark.parametrize("triangles", [500, 1500, 4000])
def test_trees_are_one_metre_high_and_within_their_budget(triangles: int) -> None:
    for tree in grow_kinds(triangles, np.random.default_rng(2)):
        check_mesh(tree)
        assert len(tree.faces) <= triangles
        assert 0.8 < tree.vertices_m[:, 2].max() < 1.35
        assert tree.vertices_m[:, 2].min() > -0.35


def test_planting_scales_turns_and_counts() -> None:
    rng = np.random.default_rng(0)
    kinds = [reed_clump(rng, 60, (0.1, 0.1, 0.1)), rock(rng, (0.2, 0.2, 0.2))]
    which, feet = np.array([1, 0, 1]), np.array([[0, 10, 0], [5, 10, 0], [10, 10, 1.0]])
    mesh = plant(kinds, which, feet, np.array([1.0, 2.0, 3.0]), rng)
    assert len(mesh.faces) == len(kinds[0].faces) + 2 * len(kinds[1].faces)
    stone = mesh.vertices_m[mesh.vertices_m[:, 0] > 7.5]
    assert np.ptp(stone[:, 2]) == pytest.approx(3 * np.ptp(kinds[1].vertices_m[:, 2]), rel=1e-4)
    with pytest.raises(ValueError, match="nothing to plant"):
        plant(kinds, np.zeros(0, int), np.zeros((0, 3)), np.zeros(0), rng)


def test_rock_is_closed_and_faces_outwards() -> None:
    points, faces = spiral(26)
    a, b, c = points[faces].transpose(1, 0, 2)
    assert (np.einsum("fk,fk->f", np.cross(b - a, c - a), a + b + c) > 0).all()
    assert len(faces) == 2 * len(points) - 4


def test_things_are_placed_on_the_ground_facing_the_camera() -> None:
    land = make_land(100, HALF_RAD, None, np.random.default_rng(1))
    arrow = Mesh(
        np.array([[0, 0, 0], [0, -1, 0], [0, 0, 1]], np.float32),
        np.array([[0, 1, 2]], np.uint32),
        np.ones((3, 3), np.float32),
        np.ones(3, np.float32),
    )
    placed = land.place(arrow, 0.4, 12.0).vertices_m
    foot, front = placed[0], placed[1]
    assert np.arctan2(foot[0], foot[1]) == pytest.approx(0.4, abs=1e-4)
    assert np.hypot(*foot[:2]) - np.hypot(*front[:2]) == pytest.approx(1, abs=1e-3)
    np.testing.assert_allclose(foot, land.point_m(np.array([0.4]), np.array([12.0]))[0], rtol=1e-5)


@pytest.mark.parametrize(
    ("spec", "half", "eye"),
    [
        (ShoreSpec("moon", 100, 1), HALF_RAD, EYE_M),  # type: ignore[arg-type]
        (ShoreSpec("trees", 0, 1), HALF_RAD, EYE_M),
        (ShoreSpec("trees", 100, 1), 0.0, EYE_M),
        (ShoreSpec("trees", 100, 1), HALF_RAD, -1.0),
    ],
)
def test_nonsense_is_refused(spec: ShoreSpec, half: float, eye: float) -> None:
    with pytest.raises(ValueError, match="shore"):
        build_shore(spec, half, eye)
