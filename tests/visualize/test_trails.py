"""Trails lie on the water where the boat was, in the picture and on the chart, and labels tell the track."""

import numpy as np
import torch
from evaluation.boats import boat, truth

from usvnet.geometry.camera import make_camera
from usvnet.geometry.ranging import RangingLayer
from usvnet.tracking.encounter import Encounter
from usvnet.tracking.filter import Sighting
from usvnet.tracking.tracker import Tracker, TrackingConfig
from usvnet.visualize.scene import SceneDrawer
from usvnet.visualize.trails import draw_trail, seen_on_water

CAMERA = make_camera(
    [[500.0, 0, 310.0], [0, 490.0, 230.0], [0, 0, 1]],
    (640, 480),
    (-0.1, 0.02, 0.001, -0.001),
    height_m=1.6,
    pitch_rad=0.12,
    roll_rad=0.05,
    dtype=torch.float64,
)


def tracks():
    """One boat, 12 m ahead and going right, seen ten times."""
    tracker = Tracker(TrackingConfig())
    for n in range(10):
        found = tracker.step(0.1 * n, [Sighting(-0.1 + 0.02 * n, 0.001, 1 / 12, 0.001, 0.0005)])
    return found


def test_places_on_the_water_are_where_their_range_and_bearing_is_read():
    places = np.array([[0.0, 10.0], [3.0, 25.0], [-4.0, 12.0]])
    pixels = torch.tensor(seen_on_water(places, CAMERA))[None]
    estimate = RangingLayer().double().range_points(pixels, torch.zeros(1, 3, 2, 2).double(), CAMERA)
    np.testing.assert_allclose(estimate.position_m[0][:, [0, 2]], places, atol=1e-6)
    assert np.isnan(seen_on_water(np.array([[0.0, -10.0]]), CAMERA)).all()


def test_a_trail_is_drawn_and_gaps_are_not():
    canvas = np.zeros((40, 40, 3), np.uint8)
    draw_trail(canvas, np.array([[5.0, 20.0], [15.0, 20.0], [np.nan, 20.0], [25.0, 20.0], [35.0, 20.0]]), 1.0)
    assert [int(canvas[20, u, 0]) > 200 for u in (10, 20, 30)] == [True, False, True]


def test_the_label_tells_number_smoothed_range_and_approach():
    (track,) = tracks()
    seen = boat(truth(range_m=99.0), std_m=0.5)
    drawer = SceneDrawer("waterline")
    lines = drawer.label(seen, track, 1.6)
    assert lines[0].startswith("#1  12.1")  # the slant range of 12 m
    assert "CPA" not in " ".join(drawer.label(seen))
    approaching = track._replace(encounter=Encounter(3.2, 1.1, 20.4, 2.0))
    assert drawer.label(seen, approaching, 1.6)[2].startswith("CPA 3 m")
    assert len(drawer.label(seen, track._replace(encounter=None), 1.6)) == 2


def test_a_scene_with_tracks_differs_by_them():
    picture = np.full((480, 640, 3), 90, np.uint8)
    seen = [boat(truth(range_m=12.0))]
    drawer = SceneDrawer("waterline")
    plain = drawer.draw(picture, seen, CAMERA)
    (track,) = tracks()
    followed = drawer.draw(picture, seen, CAMERA, tracks=[track._replace(sighting=None)])
    changed = np.argwhere((plain != followed).any(axis=-1))
    path = seen_on_water(track.trail_m, CAMERA)[[0, -1]]
    for u, v in path:
        assert np.hypot(*(changed - (v, u)).T).min() < 3
