"""A dataset's YAML, typed: how many frames, which cameras, which boats, which scenes.

Files hold degrees and metres; a range is ``[low, high]`` or one number; paths are relative to the file. Shares are
relative to each other. See configs/simulator/ for complete files with comments.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from usvnet.geometry.yaml_files import read_mapping
from usvnet.simulator.fleet_settings import CameraSettings, HullSettings
from usvnet.simulator.frame_spec import MAX_BOATS
from usvnet.simulator.scene_settings import SceneSettings, check_shares
from usvnet.simulator.typed_yaml import Bounded, Bounds, Range, fill

SPLITS = ("train", "val", "test")

UNDER_WAY_MPS = Range(0.5, 2.5)
VISIBLE_PX = Range(14, 500)


@dataclass(frozen=True)
class FrameCounts(Bounded):
    """How many frames each split has."""

    train: Annotated[int, Bounds(0)] = 0
    val: Annotated[int, Bounds(0)] = 0
    test: Annotated[int, Bounds(0)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.total == 0:
            raise ValueError(f"expected at least one frame in {', '.join(SPLITS)}")

    @property
    def total(self) -> int:
        """Frames of all splits."""
        return self.train + self.val + self.test


@dataclass(frozen=True)
class LaserSettings(Bounded):
    """The rangefinder: how good it is, and in which share of a split's frames it was read."""

    std_m: Annotated[float, Bounds(0, 10)]
    train: Annotated[float, Bounds(0, 1)] = 1.0
    val: Annotated[float, Bounds(0, 1)] = 1.0
    test: Annotated[float, Bounds(0, 1)] = 1.0


@dataclass(frozen=True)
class BoatSettings(Bounded):
    """How many boats are in a frame, and how they stand in it."""

    per_frame: tuple[float, ...] = (0.0, 1.0)
    """Probability of no boat, of one, of two and so on."""
    moving_share: Annotated[float, Bounds(0, 1)] = 0.0
    """Share of boats under way; the others drift without a wake."""
    speed_mps: Annotated[Range, Bounds(0, 30)] = UNDER_WAY_MPS
    roll_std_deg: Annotated[float, Bounds(0, 30)] = 0.0
    pitch_std_deg: Annotated[float, Bounds(0, 30)] = 0.0
    """On top of what the waves under the boat do."""
    heave_std_m: Annotated[float, Bounds(0, 1)] = 0.0
    truncated_share: Annotated[float, Bounds(0, 1)] = 0.0
    """Share of boats that the left or right edge of the picture cuts."""
    length_px: Annotated[Range, Bounds(4, 100_000)] = VISIBLE_PX
    """How long a boat may appear when seen from the side; hulls are chosen by it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        chances = self.per_frame
        if (
            not 1 <= len(chances) <= MAX_BOATS + 1
            or min(chances) < 0
            or not math.isclose(sum(chances), 1, abs_tol=1e-6)
        ):
            expected = f"probabilities of 0 to at most {MAX_BOATS} boats that sum to 1"
            raise ValueError(f"per_frame: expected {expected}, got {list(chances)}")


@dataclass(frozen=True)
class SimulatorSettings(Bounded):
    """Everything that a dataset is drawn from."""

    frames: FrameCounts
    cameras: dict[str, CameraSettings]
    hulls: dict[str, HullSettings]
    scenes: dict[str, SceneSettings]
    laser: LaserSettings
    boats: BoatSettings = BoatSettings()
    seed: Annotated[int, Bounds(0)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("cameras", "hulls", "scenes"):
            entries = getattr(self, key)
            for name in entries:
                if not name.replace("-", "").replace("_", "").isalnum():
                    raise ValueError(f"{key}: expected names of letters, digits, - and _, got {name!r}")
            check_shares(key, {name: entry.share for name, entry in entries.items()})
        for name, scene in self.scenes.items():
            for hull in scene.hulls:
                if hull not in self.hulls:
                    raise ValueError(f"scenes: {name}: hulls: expected some of {', '.join(self.hulls)}, got {hull!r}")
            chosen = {hull: self.hulls[hull].share for hull in scene.hulls or self.hulls}
            check_shares(f"scenes: {name}: hulls", chosen)


def load_settings(path: Path | str) -> SimulatorSettings:
    """Read a dataset's YAML.

    Raises:
        FileNotFoundError: no such file.
        ValueError: one sentence naming the file, the key and what was expected.
    """
    path = Path(path)
    return fill(SimulatorSettings, read_mapping(path), f"{path}", path.parent)
