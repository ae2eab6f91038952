import math
import time

import numpy as np
import pytest

from usvnet.simulator.frame_spec import SeaSpec
from usvnet.simulator.wake import Wake
from usvnet.simulator.water import WaterView, build_water
from usvnet.simulator.waves import Sea

WATER = (0.012, 0.024, 0.028)
BREEZE = SeaSpec(0.1, 4.0, 0.4, 0.02, 8.0, 0.02, WATER, 2)
WAKE = Wake(0.5, 9.0, 0.6, 2.0, 0.8, 2.0)


def small_water(spec=BREEZE, view=None, far_m=120.0, row_px=4.0, column_px=5.0, wakes=(WAKE,)):
    view = view or WaterView(1.5, 0.5, 0.4, 400.0)
    return build_water(Sea(spec), view, far_m, row_px, column_px, wakes)


def planes(water):
    """Each triangle's first corner and two sides (F, 3), float64."""
    a, b, c = (water.mesh.vertices_m[water.mesh.faces[:, k]].astype(float) for k in range(3))
    return a, b - a, c - a


def drawn_height(water, x, y):
    """Where a vertical line meets the triangles, each of them tried; NaN where it meets none."""
    a, u, v = planes(water)
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    s = ((x - a[:, 0]) * v[:, 1] - (y - a[:, 1]) * v[:, 0]) / area
    t = (u[:, 0] * (y - a[:, 1]) - u[:, 1] * (x - a[:, 0])) / area
    hit = np.flatnonzero((s >= 0) & (t >= 0) & (s + t <= 1))
    return (a[hit, 2] + s[hit] * u[hit, 2] + t[hit] * v[hit, 2]).mean() if len(hit) else math.nan


@pytest.mark.parametrize("half_azimuth", [0.4, 1.4, math.pi])
@pytest.mark.parametrize("column_px", [5.0, 60.0])  # wide columns: chords bow well inside the arcs
def test_height_at_is_the_height_of_the_drawn_triangles(half_azimuth, column_px):
    water = small_water(view=WaterView(1.5, 0.5, half_azimuth, 400.0), column_px=column_px, row_px=3.0)
    rng = np.random.default_rng(0)
    radius, azimuth = np.exp(rng.uniform(0.5, 5.0, 150)), rng.uniform(-3.14, 3.14, 150)
    radius[:50] = rng.choice(np.hypot(*water.mesh.vertices_m[:, :2].T), 50) * (1 - 1e-6)  # just inside an arc
    x, y = radius * np.sin(azimuth), radius * np.cos(azimuth)
    told, drawn = water.height_at(x, y), np.array([drawn_height(water, *point) for point in zip(x, y)])
    assert np.array_equal(np.isnan(told), np.isnan(drawn))
    assert np.nanmax(np.abs(told - drawn)) < 1e-6
    assert np.isfinite(drawn).sum() > 10


def test_height_at_a_vertex_is_its_height():
    water = small_water()
    inner = water.mesh.vertices_m[np.random.default_rng(0).integers(0, len(water.mesh.vertices_m), 500)].astype(float)
    assert np.abs(water.height_at(inner[:, 0], inner[:, 1]) - inner[:, 2]).max() < 1e-6


def test_there_is_no_water_outside_the_grid():
    water = small_water()
    assert np.isnan(water.height_at(np.array([0.0, 0.0, 500.0, 0.0]), np.array([-5.0, 0.1, 500.0, 121.0]))).all()


def test_triangles_face_up_and_normals_are_theirs():
    water = small_water(SeaSpec(0.05, 8.0, 0.4, 0, 8.0, 0, WATER, 2), row_px=1.5, column_px=2.0, wakes=())
    _, u, v = planes(water)
    facing = np.cross(u, v)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    assert (facing[:, 2] > 0).all()
    smooth = water.mesh.normals[water.mesh.faces].mean(1)
    assert np.allclose(np.linalg.norm(water.mesh.normals, axis=1), 1, atol=1e-5)
    assert np.degrees(np.arccos(np.clip((facing * smooth).sum(1), -1, 1))).mean() < 0.5
    assert np.cross(*np.diff(water.floor.vertices_m[water.floor.faces[0]], axis=0))[2] > 0


def border_rays(focal, width, height, pitch, roll):
    """World directions (N, 3) of the picture's border."""
    u, v = np.linspace(-width / 2, width / 2, 150), np.linspace(-height / 2, height / 2, 150)
    x = np.concatenate([u, u, np.full(150, u[0]), np.full(150, u[-1])])
    y = np.concatenate([np.full(150, v[0]), np.full(150, v[-1]), v, v])
    x, y = math.cos(roll) * x - math.sin(roll) * y, math.sin(roll) * x + math.cos(roll) * y
    c, s = math.cos(pitch), math.sin(pitch)
    return np.stack([x, focal * c - y * s, -focal * s - y * c], -1)


@pytest.mark.parametrize(
    ("focal", "pitch", "roll", "eye_m"),
    [(770, 0.15, 0, 1.5), (450, 0.3, 0.1, 1.2), (450, 0.6, -0.1, 1.5), (900, 0.05, 0, 6.0)],
)
def test_every_ray_below_the_horizon_meets_the_water(focal, pitch, roll, eye_m):
    rays = border_rays(focal, 640, 640, pitch, roll)
    rays = rays[rays[:, 2] < 0]
    lowest = np.arctan2(-rays[:, 2], np.hypot(rays[:, 0], rays[:, 1])).max()
    aside = np.abs(np.arctan2(rays[:, 0], rays[:, 1])).max()
    water = small_water(view=WaterView(eye_m, lowest, aside, focal), far_m=400.0)
    levels = water.mesh.vertices_m[:, 2]
    for level in (levels.min() / 2, 0, levels.max() / 2):
        points = rays * ((level - eye_m) / rays[:, 2])[:, None]
        points = points[np.hypot(points[:, 0], points[:, 1]) < 399]
        assert np.isfinite(water.height_at(points[:, 0], points[:, 1])).all()


@pytest.mark.parametrize("far_m", [30.0, 4000.0])
def test_rows_reach_the_far_end_and_are_close_on_the_screen(far_m):
    view = WaterView(1.5, 0.5, 0.4, 400.0)
    water = small_water(view=view, far_m=far_m)
    radius = np.unique(np.hypot(*water.mesh.vertices_m[:, :2].T).round(3))
    radius = radius[np.r_[True, np.diff(radius) > 2e-3]]
    assert radius[-1] == pytest.approx(far_m, rel=1e-5)
    assert (radius[1:] / radius[:-1] < 1.12).all()
    assert np.abs(np.diff(np.arctan2(view.height_m, radius))[1:]).max() < 1.1 * 4.0 / view.focal_px
    below = water.floor.vertices_m[:, 2].max()
    assert -3 < below < water.mesh.vertices_m[:, 2].min()


def test_a_wake_lifts_the_water_and_the_labels_with_it():
    with_wake, without = small_water(), small_water(wakes=())
    lifted = with_wake.mesh.vertices_m[:, 2] != without.mesh.vertices_m[:, 2]
    assert 0.001 < lifted.mean() < 0.5
    x, y = with_wake.mesh.vertices_m[lifted, :2].astype(float).T
    assert np.abs(with_wake.height_at(x, y) - without.height_at(x, y)).max() > 0.005


def test_rough_far_water_foam_and_the_same_picture_twice():
    water, again = small_water(), small_water()
    for one, other in zip(
        (water.mesh.vertices_m, water.mesh.colours, water.mesh.roughness, water.mesh.normals),
        (again.mesh.vertices_m, again.mesh.colours, again.mesh.roughness, again.mesh.normals),
    ):
        assert np.array_equal(one, other)
        assert one.dtype == np.float32
    clear = small_water(SeaSpec(0.1, 4.0, 0.4, 0.02, 8.0, 0, WATER, 2), wakes=())
    distance = np.hypot(*clear.mesh.vertices_m[:, :2].T)
    assert clear.mesh.roughness[distance > 100].mean() > 1.2 * clear.mesh.roughness[distance < 2.5].mean()
    assert np.allclose(clear.mesh.colours, WATER)
    assert water.mesh.colours.max() > 0.4


@pytest.mark.parametrize("wrong", [{"height_m": 0.0}, {"focal_px": -1.0}, {"lowest_ray_rad": -0.1}])
def test_nonsense_is_refused(wrong):
    view = {"height_m": 1.5, "lowest_ray_rad": 0.5, "half_azimuth_rad": 0.4, "focal_px": 400.0, **wrong}
    with pytest.raises(ValueError, match=r"expected more than 0|sees no water"):
        small_water(view=WaterView(**view))
    with pytest.raises(ValueError, match="nearest water"):
        small_water(far_m=1.0)


def test_the_water_of_a_training_picture_is_quick():
    best = math.inf
    for _ in range(2):
        start = time.process_time()
        build_water(Sea(BREEZE), WaterView(1.5, 0.58, 0.45, 770.0), 4000.0, 1.2, 1.6, [WAKE])
        best = min(best, time.process_time() - start)
    assert best < 0.7
