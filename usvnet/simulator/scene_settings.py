"""What a kind of scene may look like: light, water, air, shore and flotsam. Degrees and metres, as in files."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from usvnet.simulator.frame_spec import ClutterKind, ShoreKind, SkyKind
from usvnet.simulator.typed_yaml import Bounded, Bounds, Range

ZERO = Range(0, 0)
ONE = Range(1, 1)
ALL_ROUND = Range(-180, 180)
MIRROR = Range(0.008, 0.02)
SWELL_M = Range(6, 12)
RAIN_MM_H = Range(2, 15)
SOME_HAZE = Range(2, 4)


@dataclass(frozen=True)
class SkySettings(Bounded):
    """One kind of light."""

    kind: SkyKind
    sun_elevation_deg: Annotated[Range, Bounds(-6, 90)]
    share: Annotated[float, Bounds(0)] = 1.0
    """How often, relative to the scene's other skies."""
    sun_azimuth_deg: Annotated[Range, Bounds(-180, 180)] = ALL_ROUND
    """Clockwise from straight ahead."""
    sun_in_view: Annotated[float, Bounds(0, 1)] = 0.0
    """Share of frames with the sun ahead and low enough for its glint to lie in the picture."""
    sun_strength: Annotated[Range, Bounds(0, 20)] = ZERO
    """Irradiance of the sun relative to the sky's; 0 is a hidden sun, 4 to 9 a bright day."""
    turbidity: Annotated[Range, Bounds(1, 10)] = SOME_HAZE
    cloud_cover: Annotated[Range, Bounds(0, 1)] = ZERO


@dataclass(frozen=True)
class SeaSettings(Bounded):
    """The water."""

    slope_std: Annotated[Range, Bounds(0, 0.4)]
    """Root mean square slope: 0.03 a calm, 0.1 a breeze (Cox and Munk 1954)."""
    peak_wavelength_m: Annotated[Range, Bounds(0.1, 60)]
    """The longest wind wave; every doubling alike."""
    colours_rgb: tuple[tuple[float, float, float], ...]
    """Linear RGB of the light that comes back out of the water; each as often as the others."""
    colour_scale: Annotated[Range, Bounds(0, 5)] = ONE
    """Brightness of that colour."""
    calm_share: Annotated[float, Bounds(0, 1)] = 0.0
    """Share of frames with water like a mirror."""
    calm_slope_std: Annotated[Range, Bounds(0, 0.4)] = MIRROR
    swell_slope_std: Annotated[Range, Bounds(0, 0.2)] = ZERO
    swell_wavelength_m: Annotated[Range, Bounds(1, 200)] = SWELL_M
    foam: Annotated[Range, Bounds(0, 0.1)] = ZERO
    """Share of the water covered by whitecaps, where the water is not calm."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.colours_rgb:
            raise ValueError("colours_rgb: expected at least one colour")
        for colour in self.colours_rgb:
            if not all(0 <= part <= 1 for part in colour):
                raise ValueError(f"colours_rgb: expected numbers between 0 and 1, got {list(colour)}")


@dataclass(frozen=True)
class ShoreSettings(Bounded):
    """The far end of the water."""

    kinds: dict[ShoreKind, float]
    """How often each kind, relative to the others."""
    distance_m: Annotated[Range, Bounds(10, 5000)]
    """Every doubling alike; always beyond the boats."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_shares("kinds", self.kinds)


@dataclass(frozen=True)
class AirSettings(Bounded):
    """What is between the camera and the boat: ``visibility_m`` or ``visibility_boats``."""

    visibility_m: Annotated[Range | None, Bounds(1)] = None
    """Meteorological visibility (Koschmieder 1924)."""
    visibility_boats: Annotated[Range | None, Bounds(1)] = None
    """The same in multiples of the boat's distance, for fog that hides near and far boats alike."""
    rain_share: Annotated[float, Bounds(0, 1)] = 0.0
    rain_mm_h: Annotated[Range, Bounds(0.1, 100)] = RAIN_MM_H

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.visibility_m is None) == (self.visibility_boats is None):
            raise ValueError("expected either visibility_m or visibility_boats")


@dataclass(frozen=True)
class ExposureSettings(Bounded):
    """How the camera takes such a scene."""

    key: Annotated[Range, Bounds(0.01, 1)]
    """Where the log-average luminance lands: 0.06 is dim, 0.18 the usual, 0.5 bright fog."""
    noise_gain: Annotated[Range, Bounds(1e-6, 0.1)]
    """Variance of the shot noise at radiance 1: 0.0005 is clean, 0.005 a high ISO; every doubling alike."""
    time_s: Annotated[Range, Bounds(0, 0.2)] = ZERO
    """Exposure time; smears the picture of a camera that turns."""


@dataclass(frozen=True)
class SceneSettings(Bounded):
    """One kind of scene."""

    distance_m: Annotated[Range, Bounds(1, 1000)]
    """Along the water from below the camera to a boat's middle."""
    skies: tuple[SkySettings, ...]
    sea: SeaSettings
    shore: ShoreSettings
    air: AirSettings
    exposure: ExposureSettings
    tag: str | None = None
    """What evaluation groups by; the scene's name where it is left out."""
    share: Annotated[float, Bounds(0)] = 1.0
    """How often, relative to the other scenes."""
    distance_drawn: Literal["uniform", "log"] = "uniform"
    """All metres alike, or every doubling alike."""
    clutter: dict[ClutterKind, Range] = field(default_factory=dict)
    """How many of each; what finds no room is left out."""
    hulls: tuple[str, ...] = ()
    """The entries of ``hulls`` that may be seen here; all of them where it is left out."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_shares("skies", {str(i): sky.share for i, sky in enumerate(self.skies)})
        for kind, count in self.clutter.items():
            if not (
                count.low >= 0 and count.high <= 20 and count.low == int(count.low) and count.high == int(count.high)
            ):
                raise ValueError(
                    f"clutter: {kind}: expected whole numbers between 0 and 20, got {count.low:g}, {count.high:g}"
                )


def check_shares(key: str, shares: dict[str, float] | dict[ShoreKind, float]) -> None:
    """Insist on shares of at least 0, not all of them 0.

    Raises:
        ValueError: naming ``key``.
    """
    if any(share < 0 for share in shares.values()) or not sum(shares.values()) > 0:
        raise ValueError(f"{key}: expected shares of at least 0 and one above 0, got {list(shares.values())}")
