"""One frame from its numbers to its picture and its truth: the whole simulator at a glance."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.air import add_rain, through_air, transmittance
from usvnet.simulator.clutter import build_clutter
from usvnet.simulator.denoise import denoise
from usvnet.simulator.engine import start_engine
from usvnet.simulator.frame_spec import BoatSpec, FrameSpec
from usvnet.simulator.hulls.hull import Hull, build_hull
from usvnet.simulator.labels import label_boat
from usvnet.simulator.meshes import merge
from usvnet.simulator.optics import Optics, view_limits
from usvnet.simulator.pose import Pose, camera_from_world, eye_of, float_boat
from usvnet.simulator.render import QUALITIES, Geometry, Quality, free_memory, render_radiance, trace_geometry
from usvnet.simulator.rendered import RenderedFrame
from usvnet.simulator.scene import Scene, View, Window
from usvnet.simulator.sensor import expose
from usvnet.simulator.shore import build_shore
from usvnet.simulator.sky import Sky, build_sky
from usvnet.simulator.wake import Wake
from usvnet.simulator.water import Water, WaterView, build_water
from usvnet.simulator.waves import Sea

OPEN_WATER_M = 4000.0
"""How far waves are drawn where no shore ends them."""
UNDER_SHORE = 1.12
"""The water goes on under the foot of the shore."""
AROUND_BOAT = 0.25
"""More light paths also fall on the water this many boat sizes around a boat: its reflection and its wake."""
FEWEST_AROUND_PX = 8


@dataclass(frozen=True)
class World:
    """A frame's meshes, put together but not yet looked at."""

    scene: Scene
    water: Water
    sea: Sea
    sky: Sky
    hulls: tuple[Hull, ...]
    poses: tuple[Pose, ...]
    view: View


@dataclass
class Stopwatch:
    """Processor time of named steps."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Add what the block takes to ``name``."""
        start = time.process_time()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.process_time() - start


def render_frame(spec: FrameSpec, quality: str = "standard") -> RenderedFrame:
    """Draw one frame and say what is true of it. The same spec is the same picture, bit for bit, on one machine.

    Args:
        spec: what the frame shows.
        quality: ``preview`` for a look, ``standard`` for training, ``high`` for show.

    Raises:
        ValueError: no such quality, or the packages of the extra ``sim`` are missing.
    """
    if quality not in QUALITIES:
        raise ValueError(f"quality is {quality}, expected {', '.join(QUALITIES)}")
    start_engine()
    effort, watch = QUALITIES[quality], Stopwatch()
    optics = Optics(spec.camera, spec.shutter)
    world = build_world(spec, optics, effort, watch)
    with watch.step("geometry"):
        geometry = trace_geometry(world.scene, world.view, effort)
    radiance = render_light(spec, world, geometry, effort, watch)
    with watch.step("camera"):
        picture = expose(optics.apply(radiance), spec.sensor)
    with watch.step("labels"):
        owner = optics.apply_labels(geometry.boat, effort.subpixels)
        boats = [
            label_boat(boat, hull, pose, owner == i, world.scene, spec.camera, optics, world.water.height_at, spec.air)
            for i, (boat, hull, pose) in enumerate(zip(spec.boats, world.hulls, world.poses))
        ]
    free_memory()
    labelled = tuple(boat for boat in boats if boat is not None)
    return RenderedFrame(spec, picture, labelled, world.sea.height_std_m, watch.seconds)


def build_world(spec: FrameSpec, optics: Optics, effort: Quality, watch: Stopwatch) -> World:
    """Put the frame's meshes together: water first, because everything else floats or stands in it."""
    pinhole, eye = optics.view, eye_of(spec.camera)
    view = View(pinhole.width, pinhole.height, pinhole.focal_px, eye, camera_from_world(spec.camera))
    lowest_rad, half_azimuth_rad = view_limits(spec.camera, spec.shutter)
    with watch.step("hulls"):
        hulls = tuple(build_hull(boat.hull, boat.paint_seed) for boat in spec.boats)
    with watch.step("water"):
        sea = Sea(spec.sea)
        far = OPEN_WATER_M if spec.shore.kind == "none" else UNDER_SHORE * spec.shore.distance_m
        limits = WaterView(float(eye[2]), lowest_rad, half_azimuth_rad, pinhole.focal_px)
        wakes = [_wake_of(boat, hull) for boat, hull in zip(spec.boats, hulls)]
        water = build_water(sea, limits, far, effort.row_px, effort.column_px, wakes)
    with watch.step("surroundings"):
        sky = build_sky(spec.sky)
        shore = build_shore(spec.shore, half_azimuth_rad, float(eye[2]))
        backdrop = merge([shore, build_clutter(spec.clutter, water.height_at)])
    with watch.step("scene"):
        poses = tuple(
            float_boat(boat, hull.length_m, hull.beam_m, water.height_at) for boat, hull in zip(spec.boats, hulls)
        )
        boats = [hull.mesh.moved(pose.rotation, pose.origin_m) for hull, pose in zip(hulls, poses)]
        scene = Scene(water.mesh, water.floor, backdrop, boats, sky.radiance)
    return World(scene, water, sea, sky, hulls, poses, view)


def render_light(
    spec: FrameSpec, world: World, geometry: Geometry, effort: Quality, watch: Stopwatch
) -> NDArray[np.float32]:
    """Radiance (H, W, 3) that reaches the pinhole: light paths, the denoiser, and the air on the way."""
    with watch.step("light"):
        windows = boat_windows(geometry.boat, effort.subpixels, len(spec.boats))
        radiance = render_radiance(world.scene, world.view, effort, spec.sensor.seed, windows)
    if effort.denoise != "no":
        with watch.step("denoise"):
            radiance = denoise(radiance, geometry.albedo, geometry.normals, fast=effort.denoise == "fast")
    with watch.step("air"):
        clear = transmittance(geometry.depth_m, spec.air, effort.subpixels, fog=spec.sky.kind == "fog")
        radiance = through_air(radiance, clear, world.sky.airlight(_rays(world.view)))
        return add_rain(radiance, spec.air, np.random.default_rng([spec.sensor.seed, 1]))


def boat_windows(boat: NDArray[np.int32], subpixels: int, boats: int) -> list[Window]:
    """The parts of the view that show a boat and the water around it; boats that share pixels share a window."""
    height, width = (size // subpixels for size in boat.shape)
    found: list[Window] = []
    for number in range(boats):
        rows, columns = np.nonzero(boat == number)
        if not len(rows):
            continue
        top, bottom = int(rows.min()) // subpixels, int(rows.max()) // subpixels + 1
        left, right = int(columns.min()) // subpixels, int(columns.max()) // subpixels + 1
        aside = FEWEST_AROUND_PX + int(AROUND_BOAT * (right - left))
        below = FEWEST_AROUND_PX + int(2 * AROUND_BOAT * (bottom - top))
        window = Window(max(left - aside, 0), max(top - FEWEST_AROUND_PX, 0), min(right + aside, width), bottom + below)
        found.append(Window(window.left, window.top, window.right, min(window.bottom, height)))
    return _joined(found)


def _joined(windows: Sequence[Window]) -> list[Window]:
    apart: list[Window] = []
    for window in windows:
        for other in [other for other in apart if _overlap(window, other)]:
            apart.remove(other)
            window = Window(
                min(window.left, other.left),
                min(window.top, other.top),
                max(window.right, other.right),
                max(window.bottom, other.bottom),
            )
        apart.append(window)
    return apart if len(apart) == len(windows) else _joined(apart)


def _overlap(a: Window, b: Window) -> bool:
    return a.left < b.right and b.left < a.right and a.top < b.bottom and b.top < a.bottom


def _wake_of(boat: BoatSpec, hull: Hull) -> Wake:
    return Wake(boat.x_m, boat.y_m, boat.yaw_rad, hull.length_m, hull.beam_m, boat.speed_mps)


def _rays(view: View) -> NDArray[np.float32]:
    """Directions (H, W, 3) of a view's pixels in the world frame, not normalised."""
    u, v = np.meshgrid(np.arange(view.width), np.arange(view.height))
    x, y = (u - (view.width - 1) / 2) / view.focal_px, (v - (view.height - 1) / 2) / view.focal_px
    rays: NDArray[np.float32] = (np.stack([x, y, np.ones_like(x)], -1) @ view.rotation).astype(np.float32)
    return rays
