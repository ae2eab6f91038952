"""What comes out of one rendered frame: the picture and everything that is true of it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import BoatSpec, FrameSpec

Doubles = NDArray[np.float64]


@dataclass(frozen=True)
class BoatTruth:
    """One boat that can be seen in the picture. Points in the world frame, pixels with integer centres."""

    spec: BoatSpec
    box_px: Doubles
    """(4,) x1, y1, x2, y2 around what of the boat can be seen."""
    keypoints_px: Doubles
    """(7, 2) through the camera's own lens and shutter; NaN behind the camera."""
    visibility: NDArray[np.int64]
    """(7,) 0 outside the picture, 1 hidden, 2 seen."""
    keypoints_m: Doubles
    """(7, 3) the two waterline points on the drawn water."""
    hull_keypoints_m: Doubles
    """(7, 3) in the hull frame, the waterline points on the resting waterline: what a hull file says."""
    water_height_m: Doubles
    """(2,) of the drawn water at bow_bottom and stern_bottom, above mean water."""
    origin_m: Doubles
    """(3,) of the hull frame."""
    yaw_rad: float
    pitch_rad: float
    roll_rad: float
    """Attitude of the hull with the waves under it: bow up, starboard down."""
    slant_m: Doubles
    """(2,) from the optical centre to bow_bottom and stern_bottom."""
    horizontal_m: Doubles
    """(2,) the same along the water."""
    laser_hit_m: Doubles
    """(3,) where a laser aimed at mid-hull hits first; NaN where it hits nothing."""
    laser_on_boat: bool
    """Whether what it hits is this boat."""
    seen_px: int
    """Pixels that show the boat."""
    truncated: bool
    """Whether the edge of the picture cuts the boat."""

    @property
    def nearest(self) -> int:
        """0 where bow_bottom is the nearer waterline point, 1 for stern_bottom."""
        return int(self.slant_m[1] < self.slant_m[0])


@dataclass(frozen=True)
class RenderedFrame:
    """One picture and its truth."""

    spec: FrameSpec
    picture: NDArray[np.uint8]
    """(H, W, 3) RGB, before it is stored as JPEG."""
    boats: tuple[BoatTruth, ...]
    """The boats that can be seen, in the order of the spec."""
    sea_height_std_m: float
    """Standard deviation of the water's height in this sea: what a flat-water range cannot know."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Processor time of each step."""
