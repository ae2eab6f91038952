"""From a dataset's settings to what each of its frames shows. Any frame can be drawn alone, by its number."""

import math

import numpy as np

from usvnet.simulator.draw_boats import OwnedHull, Place, choose_hull, make_hulls, place_boat, set_afloat
from usvnet.simulator.draw_camera import MountedCamera, draw_shutter, make_cameras, measure_attitude, true_camera
from usvnet.simulator.draw_surroundings import (
    choose,
    draw_air,
    draw_clutter,
    draw_sea,
    draw_sensor,
    draw_shore,
    draw_sky,
)
from usvnet.simulator.frame_spec import BoatSpec, FrameSpec, HullSpec
from usvnet.simulator.scene_settings import SceneSettings
from usvnet.simulator.settings import SPLITS, SimulatorSettings
from usvnet.types import Camera

ATTEMPTS = 200
GOLDEN = (math.sqrt(5) - 1) / 2
"""Steps of this size fill the unit interval evenly, however many are taken."""
PARTS = ("boats", "attitude", "sky", "sea", "air", "shore", "clutter", "sensor", "laser")
"""Each has random numbers of its own, so that changing one leaves the others as they are."""


class Scenario:
    """The frames of a dataset, numbered through all splits: first train, then val, then test.

    Attributes:
        settings: what they are drawn from.

    Raises:
        ValueError: a camera or a hull cannot be made.
    """

    def __init__(self, settings: SimulatorSettings) -> None:
        self.settings = settings
        self._cameras = make_cameras(settings.cameras)
        self._hulls = make_hulls(settings.hulls)
        self._scene_start = float(np.random.default_rng(settings.seed).uniform())

    @property
    def total(self) -> int:
        """Frames of all splits."""
        return self.settings.frames.total

    def cameras(self) -> dict[str, Camera]:
        """The cameras as their files say: a batch of 1 each, float32."""
        return {camera.name: camera.nominal for camera in self._cameras}

    def hulls(self) -> dict[str, HullSpec]:
        """The hulls by name."""
        return {hull.spec.name: hull.spec for hull in self._hulls}

    def frame(self, number: int) -> FrameSpec:
        """What frame ``number`` shows.

        Raises:
            IndexError: there is no such frame.
            ValueError: no camera sees the water, or no hull has a fitting size, where the scene wants its boats.
        """
        split = self._split(number)
        rngs = {part: np.random.default_rng([self.settings.seed, number, i]) for i, part in enumerate(PARTS)}
        tag, scene = self._scene(number)
        distance_m = _draw_distance(scene, rngs["boats"])
        camera, true, boats = self._place_boats(tag, scene, distance_m, rngs["boats"])
        pitch_deg, roll_deg, attitude_std_deg = measure_attitude(camera, true, rngs["attitude"])
        shutter = draw_shutter(camera, scene.exposure.time_s.draw(rngs["sensor"]), rngs["sensor"])
        farthest_m = max([distance_m, *(math.hypot(boat.x_m, boat.y_m) + boat.hull.length_m for boat in boats)])
        shore = draw_shore(scene.shore, farthest_m, rngs["shore"])
        lasered = bool(rngs["laser"].uniform() < getattr(self.settings.laser, split))
        return FrameSpec(
            number=number,
            split=split,
            scene=scene.tag or tag,
            camera_name=camera.name,
            camera=true,
            measured_pitch_deg=pitch_deg,
            measured_roll_deg=roll_deg,
            attitude_std_deg=attitude_std_deg,
            shutter=shutter,
            sky=draw_sky(scene.skies, camera, rngs["sky"]),
            air=draw_air(scene.air, distance_m, rngs["air"]),
            sea=draw_sea(scene.sea, rngs["sea"]),
            shore=shore,
            clutter=draw_clutter(scene, camera, true, boats, shore, rngs["clutter"]),
            boats=boats,
            sensor=draw_sensor(scene.exposure, camera.settings, rngs["sensor"]),
            laser_std_m=self.settings.laser.std_m,
            has_laser=lasered and bool(boats),
        )

    def _split(self, number: int) -> str:
        if not 0 <= number < self.total:
            raise IndexError(f"frame {number} of {self.total}")
        ends = np.cumsum([getattr(self.settings.frames, split) for split in SPLITS])
        return SPLITS[int(np.searchsorted(ends, number, side="right"))]

    def _scene(self, number: int) -> tuple[str, SceneSettings]:
        """Spread the scenes evenly over every run of frames, so that small splits hold their shares too."""
        names = list(self.settings.scenes)
        ends = np.cumsum([scene.share for scene in self.settings.scenes.values()])
        where = (self._scene_start + number * GOLDEN) % 1.0 * ends[-1]
        name = names[int(np.searchsorted(ends, where, side="right"))]
        return name, self.settings.scenes[name]

    def _place_boats(
        self, name: str, scene: SceneSettings, distance_m: float, rng: np.random.Generator
    ) -> tuple[MountedCamera, Camera, tuple[BoatSpec, ...]]:
        """Choose a camera and place the boats before it, the first one ``distance_m`` away."""
        count = choose(list(self.settings.boats.per_frame), rng)
        cuts = rng.uniform(size=count) < self.settings.boats.truncated_share
        hulls = [hull for hull in self._hulls if not scene.hulls or hull.entry in scene.hulls]
        cameras = [camera for camera in self._cameras if camera.near_m < distance_m < camera.far_m]
        if not sum(camera.share for camera in cameras) > 0:
            raise ValueError(f"scenes: {name}: distance_m: no camera sees the water {distance_m:.1f} m away")
        for _ in range(ATTEMPTS):
            camera = cameras[choose([camera.share for camera in cameras], rng)]
            true = true_camera(camera, rng)
            boats: list[BoatSpec] = []
            for i, cut in enumerate(cuts):
                far_m = distance_m if i == 0 else _draw_distance(scene, rng)
                boat = self._place_boat(hulls, far_m, bool(cut), camera, true, boats, rng)
                if boat is None:
                    break
                boats.append(boat)
            if len(boats) == count:
                return camera, true, tuple(boats)
        raise ValueError(
            f"scenes: {name}: found no room for {count} boats, the first {distance_m:.1f} m away: "
            "expected cameras that see it there, and hulls whose length lies within boats: length_px"
        )

    def _place_boat(
        self,
        hulls: list[OwnedHull],
        distance_m: float,
        cut: bool,
        camera: MountedCamera,
        true: Camera,
        others: list[BoatSpec],
        rng: np.random.Generator,
    ) -> BoatSpec | None:
        settings = self.settings.boats
        px_per_m = true.K[0, 0, 0].item() / math.hypot(distance_m, true.height_m.item())
        hull = choose_hull(hulls, (settings.length_px.low, settings.length_px.high), px_per_m, rng)
        if hull is None:
            return None
        taken = [Place(boat.x_m, boat.y_m, boat.hull.length_m / 2) for boat in others]
        boat = place_boat(hull.spec, distance_m, cut, true, camera.half_width_rad, taken, rng)
        return None if boat is None else set_afloat(boat, hull, settings, rng)


def _draw_distance(scene: SceneSettings, rng: np.random.Generator) -> float:
    return scene.distance_m.draw(rng) if scene.distance_drawn == "uniform" else scene.distance_m.draw_log(rng)
