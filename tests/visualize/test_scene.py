"""Range, horizon and chart stand where they belong."""

import dataclasses
import math

import numpy as np
import pytest
from evaluation.boats import boat, truth

from usvnet.evaluation.records import ESTIMATORS
from usvnet.geometry.camera import make_camera
from usvnet.visualize.horizon import draw_horizon, horizon_px
from usvnet.visualize.scene import SceneDrawer
from usvnet.visualize.topdown import TopDownChart, field_of_view_rad

WIDTH, HEIGHT = 640, 480
FOCAL_PX = 500.0


def camera(pitch_rad=0.1, roll_rad=0.0, distortion=None, scale=1):
    K = [[scale * FOCAL_PX, 0, scale * WIDTH / 2 - 0.5], [0, scale * FOCAL_PX, scale * HEIGHT / 2 - 0.5], [0, 0, 1]]
    return make_camera(
        K, (scale * WIDTH, scale * HEIGHT), distortion, height_m=1.5, pitch_rad=pitch_rad, roll_rad=roll_rad
    )


def picture(scale=1):
    return np.full((scale * HEIGHT, scale * WIDTH, 3), 90, np.uint8)


def at(distance_m, bearing_rad=0.0, std_m=0.1, usable=True):
    """A boat that every estimator places there."""
    found = boat(truth(range_m=distance_m), std_m=std_m, valid=usable)
    ranges = {
        name: dataclasses.replace(estimate, bearing_rad=bearing_rad, slant_m=distance_m if usable else math.inf)
        for name, estimate in found.ranges.items()
    }
    return dataclasses.replace(found, ranges=ranges)


def test_the_horizon_is_the_tangent_of_the_pitch_above_the_middle():
    points = horizon_px(camera(pitch_rad=0.1))
    dip_rad = math.sqrt(2 * 1.5 * 0.87 / 6_371_008.8)  # sqrt(2 h (1 - k) / R)
    middle = points[np.argmin(np.abs(points[:, 0] - WIDTH / 2))]
    assert middle[1] == pytest.approx(HEIGHT / 2 - 0.5 - FOCAL_PX * math.tan(0.1 - dip_rad), abs=0.02)
    assert points[:, 0].min() < 0 < WIDTH < points[:, 0].max()


def test_a_camera_turned_clockwise_sees_the_horizon_rise_to_the_right():
    points = horizon_px(camera(pitch_rad=0.0, roll_rad=0.1))
    slope = np.polyfit(points[:, 0], points[:, 1], 1)[0]
    assert slope == pytest.approx(-math.tan(0.1), rel=0.01)


def test_a_lens_bends_the_horizon():
    points = horizon_px(camera(distortion=[-0.2, 0.0, 0.0, 0.0, 0.0]))
    inside = points[(points[:, 0] > 0) & (points[:, 0] < WIDTH)]
    assert np.abs(np.polyval(np.polyfit(*inside.T, 1), inside[:, 0]) - inside[:, 1]).max() > 1


def test_the_horizon_is_drawn_there_and_nowhere_else():
    canvas = picture()
    draw_horizon(canvas, camera(), 1.0)
    rows, columns = np.nonzero((canvas != 90).any(axis=-1))
    right = columns > 120  # its name stands at the left
    row = HEIGHT / 2 - FOCAL_PX * math.tan(0.1)
    assert np.abs(rows[right] - row).max() < 4
    assert columns.max() > WIDTH - 30
    below = picture()
    draw_horizon(below, camera(pitch_rad=1.2), 1.0)  # the camera looks down: no horizon in the picture
    assert (below == 90).all()


@pytest.mark.parametrize(
    ("slant_m", "std_m", "first", "second"),
    [
        (23.41, 0.52, "23.41 m", "90 %: 22.55 to 24.27 m"),
        (23.41, 1.52, "23.4 m", "90 %: 20.9 to 25.9 m"),
        (523.4, 41.2, "523 m", "90 %: 456 to 591 m"),
        (3.2, 4.1, "3.2 m", "90 %: 0.0 to 9.9 m"),
    ],
)
def test_a_label_has_the_digits_that_its_uncertainty_leaves(slant_m, std_m, first, second):
    label = SceneDrawer("waterline").label(boat(truth(range_m=slant_m), std_m=std_m))
    assert label[0].startswith(first)
    assert label[1] == second


def test_a_boat_without_a_range_says_so():
    assert SceneDrawer("waterline").label(at(10.0, usable=False))[0] == "no range"


def chart_of(boats, scale=1):
    canvas = picture(scale)
    place = TopDownChart().draw(canvas, boats, "waterline", camera(scale=scale), scale, [])
    return canvas, place


def yellow(canvas):
    rows, columns = np.nonzero((np.abs(canvas.astype(int) - (255, 209, 66)) < 40).all(axis=-1))
    return rows, columns


def test_the_chart_shows_left_as_left_and_far_as_far():
    (near_rows, near_columns), (far_rows, _) = (yellow(chart_of([at(metres)], 3)[0]) for metres in (21.0, 44.0))
    assert far_rows.mean() < near_rows.mean() - 20
    _, left_columns = yellow(chart_of([at(21.0, -0.3)], 3)[0])
    assert left_columns.mean() < near_columns.mean() - 10


def test_a_boat_of_known_heading_points_along_it():
    def bow(heading_rad):
        boat = dataclasses.replace(at(21.0), heading_rad=heading_rad, heading_std_rad=0.05)
        rows, columns = yellow(chart_of([boat], 4)[0])
        return rows, columns

    (ahead_rows, ahead_columns), (right_rows, right_columns) = bow(0.0), bow(math.pi / 2)
    assert np.ptp(ahead_rows) > np.ptp(ahead_columns) + 10
    assert np.ptp(right_columns) > np.ptp(right_rows) + 10
    assert right_columns.max() - ahead_columns.max() > 10  # the bow is longer than the stern


def test_a_wider_interval_is_a_longer_ellipse_along_the_line_of_sight():
    def height(std_m):
        rows, columns = yellow(chart_of([at(60.0, std_m=std_m)], 3)[0])
        return np.ptp(rows), np.ptp(columns)

    sharp, vague = height(0.5), height(12.0)
    assert vague[0] > sharp[0] + 20
    assert vague[1] < sharp[1] + 10


def test_the_chart_keeps_its_reach_until_it_is_far_too_large():
    chart = TopDownChart()

    def reach_m(*boats):
        chart.draw(picture(), boats, "waterline", camera(), 1.0, [])
        return chart.reach_m

    assert reach_m() == 50
    assert reach_m(at(30.0)) == 50
    assert reach_m(at(60.0)) == 100
    assert reach_m(at(45.0)) == 100
    assert reach_m() == 100
    assert reach_m(at(12.0)) == 20
    assert reach_m(at(1e6)) == 5000


def test_the_chart_moves_away_from_what_is_taken_and_stays_inside():
    canvas, place = chart_of([])
    x1, y1, x2, y2 = place
    assert 0 < x1 < x2 < WIDTH
    assert 0 < y1 < y2 < HEIGHT
    assert x1 > WIDTH / 2
    chart = TopDownChart()
    moved = chart.draw(canvas, [], "waterline", camera(), 1.0, [place])
    assert moved[2] < WIDTH / 2
    assert moved[1] == pytest.approx(y1)
    assert chart.draw(canvas, [], "waterline", camera(), 1.0, []) == moved  # it does not jump back


def test_the_field_of_view_is_that_of_the_lens():
    left, right = field_of_view_rad(camera(pitch_rad=0.0))
    assert right == pytest.approx(math.atan((WIDTH - 1) / 2 / FOCAL_PX), rel=1e-4)
    assert left == pytest.approx(-right, rel=1e-3)


@pytest.mark.parametrize("topdown", [True, False])
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_a_scene_is_a_new_picture_of_the_same_size(estimator, topdown):
    original = picture()
    drawn = SceneDrawer(estimator, topdown).draw(original, [at(12.0, std_m=0.2), at(9.0, usable=False)], camera(), "a")
    assert drawn.shape == original.shape
    assert (original == 90).all()
    assert (drawn[-200:, -200:] == 90).all() != topdown
    assert SceneDrawer(estimator, topdown).draw(picture(), [], camera()).shape == original.shape


def test_the_horizon_moves_along_with_a_small_picture_that_is_drawn_twice_as_large():
    drawn = SceneDrawer("waterline", topdown=False).draw(picture()[::2, ::2].copy(), [], half_camera())
    rows, columns = np.nonzero((drawn != 90).any(axis=-1))
    line = rows[(columns > 120) & (rows < HEIGHT - 60)]
    assert np.abs(line - (HEIGHT / 2 - FOCAL_PX * math.tan(0.1))).max() < 5


def half_camera():
    K = [[FOCAL_PX / 2, 0, WIDTH / 4 - 0.5], [0, FOCAL_PX / 2, HEIGHT / 4 - 0.5], [0, 0, 1]]
    return make_camera(K, (WIDTH // 2, HEIGHT // 2), height_m=1.5, pitch_rad=0.1)
