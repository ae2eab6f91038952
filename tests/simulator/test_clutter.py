"""Buoys, piles and marks: where they stand, how large they are, and that they repeat."""

import dataclasses

import numpy as np
import pytest

from usvnet.simulator.clutter import build_clutter, tilted
from usvnet.simulator.frame_spec import ClutterSpec

KINDS = ("buoy", "pile", "marker")


def flat(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.zeros_like(x)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(12))
def test_each_thing_stands_in_its_place(kind: str, seed: int) -> None:
    mesh = build_clutter([ClutterSpec(kind, 3.0, 20.0, 0.2, seed)], flat)  # type: ignore[arg-type]
    vertices = mesh.vertices_m.astype(float)
    assert np.isfinite(vertices).all()
    assert 0 < mesh.colours.min() <= mesh.colours.max() < 0.95
    assert 0 < mesh.roughness.min() <= mesh.roughness.max() <= 1
    assert len(mesh.faces) < 6000
    above = vertices[vertices[:, 2] > 0]
    assert np.abs(above[:, :2].mean(0) - [3, 20]).max() < 0.25
    assert vertices[:, 2].min() < -0.02
    tall = vertices[:, 2].max()
    low, high = {"buoy": (0.15, 1.2), "pile": (0.9, 1.6), "marker": (1.3, 2.3)}[kind]
    assert low < tall < high


def test_buoys_float_on_the_wave_and_piles_do_not_move() -> None:
    def wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.full_like(x, 0.4)

    for kind, lift in (("buoy", 0.4), ("pile", 0.0), ("marker", 0.0)):
        specs = [ClutterSpec(kind, 1.0, 9.0, 0.2, 4)]  # type: ignore[arg-type]
        still, lifted = (build_clutter(specs, level).vertices_m[:, 2] for level in (flat, wave))
        np.testing.assert_allclose(lifted - still, lift, atol=1e-5)


def test_height_is_asked_where_things_stand() -> None:
    asked = []

    def level(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        asked.append((x.copy(), y.copy()))
        return 0 * x

    build_clutter([ClutterSpec("buoy", 1, 9, 0.2, 1), ClutterSpec("buoy", -2, 12, 0.2, 2)], level)
    np.testing.assert_array_equal(asked[0], [[1, -2], [9, 12]])


def test_size_scales_a_buoy() -> None:
    small, large = (build_clutter([ClutterSpec("buoy", 0, 9, size, 7)], flat).vertices_m for size in (0.2, 0.4))
    np.testing.assert_allclose(np.ptp(large, axis=0), 2 * np.ptp(small, axis=0), rtol=1e-3)


def test_foot_of_a_pile_is_darker_than_its_top() -> None:
    for seed in range(5):
        mesh = build_clutter([ClutterSpec("pile", 0, 9, 0.3, seed)], flat)
        z = mesh.vertices_m[:, 2]
        assert mesh.colours[z < 0.1].mean() < 0.6 * mesh.colours[(z > 0.8) & (z < 1.3)].mean()


def test_seed_decides_the_thing_whatever_else_is_there() -> None:
    spec = ClutterSpec("buoy", 1, 9, 0.25, 3)
    alone = build_clutter([spec], flat)
    crowd = build_clutter([spec, ClutterSpec("pile", 4, 9, 0.25, 8)], flat)
    np.testing.assert_array_equal(crowd.vertices_m[: len(alone.vertices_m)], alone.vertices_m)
    np.testing.assert_array_equal(crowd.colours[: len(alone.colours)], alone.colours)
    shapes = {build_clutter([dataclasses.replace(spec, seed=seed)], flat).vertices_m.tobytes() for seed in range(8)}
    assert len(shapes) == 8


def test_tilt_is_a_rotation() -> None:
    for seed in range(5):
        R = tilted(np.random.default_rng(seed), 0.1)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1)
        assert R[2, 2] > 0.9


def test_none_is_one_triangle_far_below_the_water() -> None:
    mesh = build_clutter([], flat)
    assert len(mesh.faces) == 1
    assert mesh.vertices_m[:, 2].max() < -100


@pytest.mark.parametrize("wrong", [ClutterSpec("duck", 0, 9, 0.2, 1), ClutterSpec("buoy", 0, 9, 0.0, 1)])  # type: ignore[arg-type]
def test_nonsense_is_refused(wrong: ClutterSpec) -> None:
    with pytest.raises(ValueError, match="expected"):
        build_clutter([wrong], flat)
