"""Everything around the boats of a frame: light, water, air, shore, and what else floats there."""

import math

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.draw_boats import Place, pixels_of
from usvnet.simulator.draw_camera import MountedCamera
from usvnet.simulator.fleet_settings import CameraSettings
from usvnet.simulator.frame_spec import (
    AirSpec,
    BoatSpec,
    ClutterKind,
    ClutterSpec,
    SeaSpec,
    SensorSpec,
    ShoreSpec,
    SkySpec,
)
from usvnet.simulator.scene_settings import (
    AirSettings,
    ExposureSettings,
    SceneSettings,
    SeaSettings,
    ShoreSettings,
    SkySettings,
)
from usvnet.types import Camera

GLINT_SHARE = 0.55
"""A sun in view stands within this share of the field of view from straight ahead."""
SHORE_GAP = 1.3
"""The shore is at least this many times as far as any boat."""
CLUTTER_SIZE_M: dict[ClutterKind, tuple[float, float]] = {
    "buoy": (0.2, 0.5),
    "pile": (0.25, 0.45),
    "marker": (0.2, 0.4),
}
CLUTTER_FAR_M = 120.0
CLUTTER_NEAR = 1.5
"""Nothing floats nearer than this many times the nearest water that is seen."""
CLUTTER_CANDIDATES = 24


def choose(shares: list[float], rng: np.random.Generator) -> int:
    """An index, as often as its share says."""
    total = np.cumsum(shares)
    return int(np.searchsorted(total, rng.uniform(0, total[-1]), side="right"))


def draw_sky(settings: tuple[SkySettings, ...], camera: MountedCamera, rng: np.random.Generator) -> SkySpec:
    """Light for a frame of this camera."""
    sky = settings[choose([sky.share for sky in settings], rng)]
    elevation, azimuth = sky.sun_elevation_deg.draw(rng), sky.sun_azimuth_deg.draw(rng)
    if rng.uniform() < sky.sun_in_view:  # its mirror image lies as far below the horizon as it stands above
        low, high = sky.sun_elevation_deg.low, math.degrees(0.9 * camera.bottom_rad)
        elevation = float(rng.uniform(low, max(low, min(high, sky.sun_elevation_deg.high))))
        azimuth = math.degrees(rng.uniform(-1, 1) * GLINT_SHARE * 2 * camera.half_width_rad)
    return SkySpec(
        kind=sky.kind,
        sun_azimuth_rad=math.radians(azimuth),
        sun_elevation_rad=math.radians(elevation),
        sun_strength=sky.sun_strength.draw(rng),
        turbidity=sky.turbidity.draw(rng),
        cloud_cover=sky.cloud_cover.draw(rng),
        seed=int(rng.integers(2**31)),
    )


def draw_sea(settings: SeaSettings, rng: np.random.Generator) -> SeaSpec:
    """Water for a frame."""
    calm = rng.uniform() < settings.calm_share
    slope, calm_slope = settings.slope_std.draw(rng), settings.calm_slope_std.draw(rng)
    foam, swell = settings.foam.draw(rng), settings.swell_slope_std.draw(rng)
    red, green, blue = settings.colours_rgb[int(rng.integers(len(settings.colours_rgb)))]
    scale = settings.colour_scale.draw(rng)
    return SeaSpec(
        slope_std=calm_slope if calm else slope,
        peak_wavelength_m=settings.peak_wavelength_m.draw_log(rng),
        wind_rad=float(rng.uniform(-math.pi, math.pi)),
        swell_slope_std=min(swell, calm_slope / 2) if calm else swell,
        swell_wavelength_m=settings.swell_wavelength_m.draw(rng),
        foam=0.0 if calm else foam,
        colour_rgb=(red * scale, green * scale, blue * scale),
        seed=int(rng.integers(2**31)),
    )


def draw_air(settings: AirSettings, distance_m: float, rng: np.random.Generator) -> AirSpec:
    """Air for a frame whose first boat is ``distance_m`` away."""
    if settings.visibility_m is not None:
        visibility = settings.visibility_m.draw_log(rng)
    else:
        assert settings.visibility_boats is not None
        visibility = settings.visibility_boats.draw(rng) * distance_m
    rains, rain = rng.uniform() < settings.rain_share, settings.rain_mm_h.draw(rng)
    return AirSpec(visibility, rain if rains else 0.0)


def draw_shore(settings: ShoreSettings, farthest_m: float, rng: np.random.Generator) -> ShoreSpec:
    """A shore beyond everything that floats within ``farthest_m``."""
    kinds = list(settings.kinds)
    kind = kinds[choose(list(settings.kinds.values()), rng)]
    distance = max(settings.distance_m.draw_log(rng), SHORE_GAP * farthest_m + 5)
    return ShoreSpec(kind, distance, int(rng.integers(2**31)))


def draw_sensor(settings: ExposureSettings, camera: CameraSettings, rng: np.random.Generator) -> SensorSpec:
    """How the frame is exposed and stored."""
    return SensorSpec(
        exposure_key=settings.key.draw(rng),
        noise_gain=settings.noise_gain.draw_log(rng),
        blur_px=camera.blur_px.draw(rng),
        jpeg_quality=camera.jpeg_quality.draw_whole(rng),
        seed=int(rng.integers(2**31)),
    )


def draw_clutter(
    scene: SceneSettings,
    camera: MountedCamera,
    true: Camera,
    boats: tuple[BoatSpec, ...],
    shore: ShoreSpec,
    rng: np.random.Generator,
) -> tuple[ClutterSpec, ...]:
    """What else floats in the picture: clear of boats, of each other and of the line of sight to a boat's middle."""
    near = CLUTTER_NEAR * camera.near_m
    far = min(CLUTTER_FAR_M, camera.far_m, shore.distance_m * 0.8 if shore.kind != "none" else math.inf)
    wanted = [kind for kind, count in scene.clutter.items() for _ in range(count.draw_whole(rng))]
    if not wanted or near >= far:
        return ()
    shape = (len(wanted), CLUTTER_CANDIDATES)
    distance = np.exp(rng.uniform(math.log(near), math.log(far), shape))
    bearing = rng.uniform(-1, 1, shape) * camera.half_width_rad
    x, y = distance * np.sin(bearing), distance * np.cos(bearing)
    pixels = pixels_of(np.stack([x, y, np.zeros_like(x)], -1), true)
    with np.errstate(invalid="ignore"):
        inside: NDArray[np.bool_] = (pixels >= 0) & (pixels <= true.size_px[0].numpy() - 1)
    seen = np.asarray(inside.all(-1))
    taken = [Place(boat.x_m, boat.y_m, boat.hull.length_m / 2) for boat in boats]
    placed = []
    for i, kind in enumerate(wanted):
        size = float(rng.uniform(*CLUTTER_SIZE_M[kind]))
        free = seen[i].copy()
        for j, place in enumerate(taken):
            free &= place.leaves(x[i], y[i], size, 2 * place.radius_m)
            if j < len(boats):
                toward = np.abs(bearing[i] - math.atan2(place.x_m, place.y_m))
                free &= (toward > 2 * size / distance[i]) | (distance[i] > math.hypot(place.x_m, place.y_m))
        if free.any():
            k = int(np.argmax(free))
            placed.append(ClutterSpec(kind, float(x[i, k]), float(y[i, k]), size, int(rng.integers(2**31))))
            taken.append(Place(float(x[i, k]), float(y[i, k]), size))
    return tuple(placed)
