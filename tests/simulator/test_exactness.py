"""The labels against Mitsuba's own rays: what is drawn is what is labelled."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mitsuba", reason="the extra sim is not installed")
pytest.importorskip("pyoidn", reason="the extra sim is not installed")

import mitsuba as mi
import torch

from tests.simulator.small_frames import STRONG_LENS, boat, frame, small_camera
from usvnet.geometry.camera import project
from usvnet.simulator import frame_spec as fs
from usvnet.simulator.engine import start_engine
from usvnet.simulator.frame import Stopwatch, build_world, render_frame
from usvnet.simulator.labels import HIDDEN_BEHIND, label_boat
from usvnet.simulator.meshes import ball, merge
from usvnet.simulator.optics import Optics
from usvnet.simulator.pose import camera_from_world, eye_of
from usvnet.simulator.render import QUALITIES, trace_geometry
from usvnet.simulator.scene import NOTHING, Scene, make_sensor

PREVIEW = QUALITIES["preview"]
EXACT = QUALITIES["standard"]
CAMERAS = {
    "pinhole": small_camera(),
    "lens": small_camera(distortion=STRONG_LENS),
    "rolled": small_camera(roll_rad=0.07, distortion=[-0.2, 0.05, 0, 0, 0]),
}


@pytest.fixture(autouse=True)
def engine():
    start_engine()


def world_of(spec, quality=PREVIEW):
    optics = Optics(spec.camera, spec.shutter)
    return optics, build_world(spec, optics, quality, Stopwatch())


def mitsuba_rays(view, pixels_px):
    """Unit directions (N, 3) of Mitsuba's own camera through pixels of the view."""
    sensor = make_sensor(view)
    rays = []
    for u, v in pixels_px:
        at = mi.Point2f(float(u + 0.5) / view.width, float(v + 0.5) / view.height)
        ray, _ = sensor.sample_ray(0.0, 0.5, at, mi.Point2f(0.5))
        rays.append(np.array(ray.d, float).ravel())
    return np.array(rays)


@pytest.mark.parametrize("name", CAMERAS)
def test_projection_agrees_with_the_renderers_rays_up_to_100_m(name):
    camera = CAMERAS[name]
    optics, world = world_of(frame(camera=camera, boats=()))
    rng = np.random.default_rng(0)
    pixels = rng.uniform([0, 0], [159, 119], (60, 2))
    rays = mitsuba_rays(world.view, optics.pinhole_of(pixels, np.zeros(len(pixels))))
    for distance in (3.0, 11.0, 100.0):
        points = torch.from_numpy(distance * rays @ camera_from_world(camera).T)
        seen = project(points[None], camera)[0].numpy()
        assert np.abs(seen - pixels).max() < 1e-3
        assert np.abs(optics.project(points.numpy()) - pixels).max() < 1e-3


def test_a_rolling_shutter_is_labelled_where_it_is_drawn():
    shutter = fs.ShutterSpec(0.0, 0.03, 0.4, -0.6, 0.3)
    spec = frame(shutter=shutter, camera=small_camera(distortion=STRONG_LENS))
    optics, world = world_of(spec)
    pixels = np.random.default_rng(1).uniform([0, 0], [159, 119], (40, 2))
    moments = shutter.readout_s * (pixels[:, 1] / 119 - 0.5)
    rays = mitsuba_rays(world.view, optics.pinhole_of(pixels, moments))
    seen = optics.project(20 * rays @ camera_from_world(spec.camera).T)
    assert np.abs(seen - pixels).max() < 1e-3
    still = Optics(spec.camera, fs.ShutterSpec()).project(20 * rays @ camera_from_world(spec.camera).T)
    assert np.abs(still - pixels).max() > 0.5, "the shutter made no difference"


@pytest.mark.parametrize("y_m", [5.0, 12.0, 40.0, 100.0])
@pytest.mark.parametrize("speed_mps", [0.0, 2.0])
def test_waterline_keypoints_lie_on_the_drawn_water(y_m, speed_mps):
    spec = frame(
        boats=(boat(0.1, y_m, speed_mps=speed_mps, length_m=max(1.6, y_m / 12)),), shore=fs.ShoreSpec("none", 1.0, 0)
    )
    optics, world = world_of(spec, EXACT)
    truth = label_boat(
        spec.boats[0], world.hulls[0], world.poses[0], np.ones((120, 160), bool), world.scene, spec.camera, optics,
        world.water.height_at, spec.air,
    )  # fmt: skip
    water_only = Scene(world.water.mesh, NOTHING, NOTHING, [], world.sky.radiance)
    for point in truth.keypoints_m[[3, 6]]:
        drop = water_only.distance(point + np.array([0, 0, 2.0]), np.array([[0.0, 0, -1]]))[0]
        assert abs(drop - 2.0) < 1e-3
        assert np.linalg.norm(point) > 0.5 * y_m


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("yaw_rad", [0.3, 2.0, 3.9, 5.5])
def test_visibility_agrees_with_a_picture_of_balls_on_the_keypoints(name, yaw_rad):
    """A ball of the tolerance's radius stands out before everything else exactly where a keypoint is seen."""
    spec = frame(camera=CAMERAS[name], boats=(boat(yaw_rad=yaw_rad), boat(1.6, 9.0, yaw_rad=yaw_rad + 1)))
    optics, world = world_of(spec)
    for i in (0, 1):
        owner = np.ones((120, 160), bool)
        truth = label_boat(
            spec.boats[i], world.hulls[i], world.poses[i], owner, world.scene, spec.camera, optics,
            world.water.height_at, spec.air,
        )  # fmt: skip
        radius = HIDDEN_BEHIND * world.hulls[i].length_m
        boats = [hull.mesh.moved(pose.rotation, pose.origin_m) for hull, pose in zip(world.hulls, world.poses)]
        for k in np.nonzero(truth.visibility)[0]:
            centre = truth.keypoints_m[k]
            scene = Scene(
                world.water.mesh, world.water.floor, merge(boats), [ball(centre, radius, 48, 24)], world.sky.radiance
            )
            ray = centre - eye_of(spec.camera)
            hit = scene.distance(eye_of(spec.camera), (ray / np.linalg.norm(ray))[None])[0]
            seen = abs(hit - (np.linalg.norm(ray) - radius)) < 0.05 * radius
            assert seen == (truth.visibility[k] == 2), f"boat {i} keypoint {k}"


@pytest.mark.parametrize("name", ["pinhole", "lens"])
def test_the_box_holds_the_boat_of_an_independent_mask(name):
    """Depth of the boat alone, where it is the depth of the whole scene, shows the same pixels as the labels' mask."""
    spec = frame(camera=CAMERAS[name])
    optics, world = world_of(spec)
    whole = trace_geometry(world.scene, world.view, PREVIEW)
    mesh = world.hulls[0].mesh.moved(world.poses[0].rotation, world.poses[0].origin_m)
    alone = trace_geometry(Scene(NOTHING, NOTHING, NOTHING, [mesh], world.sky.radiance), world.view, PREVIEW)
    with np.errstate(invalid="ignore"):  # the sky is infinitely far in both
        same = np.abs(alone.depth_m - whole.depth_m) < 1e-4
    independent = np.isfinite(alone.depth_m) & same
    assert np.array_equal(independent, whole.boat == 0)
    truth = render_frame(spec, "preview").boats[0]
    rows, columns = np.nonzero(optics.apply_labels(np.where(independent, 0, -1).astype(np.int32), 1) == 0)
    edges = [columns.min() - 0.5, rows.min() - 0.5, columns.max() + 0.5, rows.max() + 0.5]
    assert truth.box_px.tolist() == edges
    assert truth.seen_px == len(rows)


def test_true_keypoints_give_back_the_true_range():
    """With the water's height put in, the geometry layer returns every range of a rendered frame."""
    from usvnet.geometry.ranging import RangingLayer  # here, so that a fault in it fails this test alone

    spec = frame(camera=small_camera(distortion=STRONG_LENS, roll_rad=0.02))
    truth = render_frame(spec, "preview").boats[0]
    for k, place in ((3, 0), (6, 1)):
        camera = spec.camera._replace(height_m=spec.camera.height_m - truth.water_height_m[place])
        points = torch.from_numpy(truth.keypoints_px[None, [k]])
        estimate = RangingLayer().range_points(points, torch.zeros(1, 1, 2, 2, dtype=torch.float64), camera)
        assert float(estimate.slant_m) == pytest.approx(truth.slant_m[place], rel=1e-6)


def test_the_laser_reads_the_boat_it_is_aimed_at():
    truth = render_frame(frame(), "preview").boats[0]
    assert truth.laser_on_boat
    assert abs(np.linalg.norm(truth.laser_hit_m - [0, 0, 1.5]) - truth.slant_m.min()) < 1.2


def test_the_same_frame_is_the_same_picture_and_another_seed_is_not():
    first, again = render_frame(frame(), "preview"), render_frame(frame(), "preview")
    assert np.array_equal(first.picture, again.picture)
    assert np.array_equal(first.boats[0].keypoints_px, again.boats[0].keypoints_px)
    other = render_frame(frame(sea=fs.SeaSpec(0.05, 2.0, 0.4, 0.01, 6.0, 0.0, (0.012, 0.024, 0.028), 99)), "preview")
    assert not np.array_equal(first.picture, other.picture)


def test_a_boat_behind_another_is_labelled_only_where_it_shows():
    front, behind = boat(0.0, 5.0, length_m=2.5, yaw_rad=0.0), boat(0.0, 9.0, length_m=0.9, yaw_rad=0.0)
    alone = render_frame(frame(boats=(behind,)), "preview").boats
    both = render_frame(frame(boats=(front, behind)), "preview").boats
    hidden = [truth for truth in both if truth.spec is behind]
    assert alone[0].seen_px > 0
    assert not hidden or hidden[0].seen_px < alone[0].seen_px
    assert not hidden or (hidden[0].visibility < 2).sum() > (alone[0].visibility < 2).sum()


def test_a_boat_that_the_fog_hides_is_not_labelled():
    sky = fs.SkySpec("fog", 2.0, 0.6, 0.0, 2.5, 0.0, 1)
    for visibility_m, seen in ((40.0, 1), (7.0, 0)):
        spec = frame(sky=sky, air=fs.AirSpec(visibility_m, 0.0))
        assert len(render_frame(spec, "preview").boats) == seen


def test_a_wake_outside_the_picture_is_no_trouble():
    assert render_frame(frame(boats=(boat(-60.0, 0.5, speed_mps=2.0),)), "preview").boats == ()


def test_boxes_are_not_biased_by_the_number_of_subpixels():
    """Two and three sub-pixels a side agree to a sub-pixel, and on average to much less: neither leans to one side."""
    spec = frame(boats=(boat(0.0, 7.0, yaw_rad=np.pi / 2, roll_rad=0.0, pitch_rad=0.0),))
    calm = fs.SeaSpec(0.0005, 0.5, 0.4, 0.0, 6.0, 0.0, (0.012, 0.024, 0.028), 2)
    boxes = [render_frame(replace(spec, sea=calm), quality).boats[0].box_px for quality in ("standard", "high")]
    assert np.abs(boxes[0] - boxes[1]).max() <= 0.5
    assert abs((boxes[0] - boxes[1]).mean()) < 0.15
