"""What one picture shows, in numbers: the scenario draws these, the builders of the scene obey them.

Nothing here is random any more: the same :class:`FrameSpec` is the same picture. Where a builder has small choices of
its own (where a tree stands, how a hull is lettered) it draws them from the ``seed`` of its part.

World frame: x right, y forward, z up, metres (see :mod:`usvnet.simulator`). Azimuths are clockwise from straight
ahead, seen from above; ``yaw_rad`` of a boat is the direction of its bow, counter-clockwise from world x.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from usvnet.types import Camera

SkyKind = Literal["clear", "overcast", "dusk", "fog"]
ShoreKind = Literal["none", "trees", "town", "mixed", "harbour"]
ClutterKind = Literal["buoy", "pile", "marker"]
HullFamily = Literal["mono", "survey", "patrol", "catamaran", "rib", "barge", "mesh"]

MAX_BOATS = 8
"""In one picture."""


@dataclass(frozen=True)
class SkySpec:
    """The light of the picture."""

    kind: SkyKind
    sun_azimuth_rad: float
    sun_elevation_rad: float
    sun_strength: float
    """Irradiance of the sun's disc relative to the sky's, 0 where the sun is hidden; 4 to 9 is a bright day."""
    turbidity: float
    """Haziness of a clear sky (Hosek and Wilkie 2012), 1.7 very clear to 10 hazy."""
    cloud_cover: float
    """Share of a clear or dusk sky that clouds hide, 0 to 1."""
    seed: int


@dataclass(frozen=True)
class SeaSpec:
    """The water."""

    slope_std: float
    """Root mean square slope of the wind waves (Cox and Munk 1954: 0.03 a calm, 0.1 a breeze)."""
    peak_wavelength_m: float
    """The longest wind wave."""
    wind_rad: float
    """Direction that the waves run to, counter-clockwise from world x."""
    swell_slope_std: float
    swell_wavelength_m: float
    foam: float
    """Share of the water covered by whitecaps, 0 to about 0.05."""
    colour_rgb: tuple[float, float, float]
    """Light that comes back out of the water: linear RGB reflectance."""
    seed: int


@dataclass(frozen=True)
class ShoreSpec:
    """What stands at the far end of the water."""

    kind: ShoreKind
    distance_m: float
    seed: int


@dataclass(frozen=True)
class ClutterSpec:
    """A thing on the water that is no boat."""

    kind: ClutterKind
    x_m: float
    y_m: float
    size_m: float
    """Radius of a buoy's body; a pile is about 0.45 of it thick and six times as high."""
    seed: int


@dataclass(frozen=True)
class HullSpec:
    """A boat's shape and fittings. The same spec is the same hull, however it is painted."""

    name: str
    family: HullFamily
    length_m: float
    seed: int
    mesh_file: Path | None = None
    """An OBJ or PLY file in the hull frame, metres, for the family ``mesh``."""
    keypoints_m: tuple[tuple[float, float, float], ...] | None = None
    """The seven keypoints of the family ``mesh``."""


@dataclass(frozen=True)
class BoatSpec:
    """One boat in the picture."""

    hull: HullSpec
    paint_seed: int
    x_m: float
    y_m: float
    """Where its amidships is."""
    yaw_rad: float
    roll_rad: float
    pitch_rad: float
    """Roll to starboard and bow up, on top of what the waves under the boat do."""
    heave_m: float
    """Up, on top of the waves."""
    speed_mps: float
    """Through the water; above about 0.3 m/s the boat leaves a wake."""


@dataclass(frozen=True)
class AirSpec:
    """What is between the camera and the boat."""

    visibility_m: float
    """Meteorological visibility: contrast falls to 2 % (Koschmieder 1924)."""
    rain_mm_h: float


@dataclass(frozen=True)
class ShutterSpec:
    """How the camera moved while it took the picture; all zero is a still camera with a global shutter."""

    exposure_s: float = 0.0
    readout_s: float = 0.0
    """Time from the first row to the last of a rolling shutter; the middle row is taken at time 0."""
    pitch_rate_rad_s: float = 0.0
    yaw_rate_rad_s: float = 0.0
    roll_rate_rad_s: float = 0.0
    """Rates of turn about the camera's own axes: x (nose down), y (to the right) and z (clockwise from behind)."""


@dataclass(frozen=True)
class SensorSpec:
    """From radiance to a stored picture."""

    exposure_key: float
    """Where the log-average luminance of the picture lands: 0.06 is dim, 0.18 the usual, 0.5 bright fog."""
    noise_gain: float
    """Variance of the shot noise at radiance 1: 0.0005 is clean, 0.005 a high ISO."""
    blur_px: float
    """Standard deviation of the lens blur."""
    jpeg_quality: int
    seed: int


@dataclass(frozen=True)
class FrameSpec:
    """One picture of a dataset."""

    number: int
    split: str
    scene: str
    """The tag that evaluation groups by, such as I to VI."""
    camera_name: str
    camera: Camera
    """The camera as it truly stood (a batch of 1, float64), in the middle of the exposure."""
    measured_pitch_deg: float
    measured_roll_deg: float
    """What the IMU said of it, or without one the mount."""
    attitude_std_deg: float | None
    """Standard deviation of what the IMU says; None where there is none."""
    shutter: ShutterSpec
    sky: SkySpec
    air: AirSpec
    sea: SeaSpec
    shore: ShoreSpec
    clutter: tuple[ClutterSpec, ...]
    boats: tuple[BoatSpec, ...]
    sensor: SensorSpec
    laser_std_m: float
    """Standard deviation of the laser's reading."""
    has_laser: bool
    """Whether this frame's range is in ranges.csv; the truth is always in frames.csv."""

    @property
    def name(self) -> str:
        """The picture's path below ``images/``."""
        return f"{self.split}/{self.number:06d}.jpg"
