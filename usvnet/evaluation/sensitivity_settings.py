"""What ``usvnet sensitivity`` is asked: a camera, distances and what may be wrong, from YAML.

Files hold degrees, metres and pixels; paths are relative to the file. See configs/sensitivity/.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from usvnet.evaluation.disturbances import DISTURBANCES
from usvnet.geometry.yaml_files import read_mapping
from usvnet.simulator.typed_yaml import Bounded, Bounds, fill


@dataclass(frozen=True)
class SensitivitySettings(Bounded):
    """Everything that a study depends on."""

    disturbances: dict[str, tuple[float, ...]]
    """Amounts of each kind of error; of a kind that is noise they are standard deviations."""
    camera: Path | None = None
    """Camera file, whose sigmas make the error budget; not needed for the predictions of a dataset."""
    hull: Path | None = None
    """Hull file of the boat that is looked at; a generic one where there is none."""
    distances_m: tuple[float, ...] = (5.0, 10.0, 15.0, 20.0, 30.0, 50.0)
    """Slant ranges to the nearest waterline keypoint."""
    headings_deg: tuple[float, ...] = (0.0, 60.0, 120.0, 180.0)
    """Which way the boat points, 0 away from the camera; every figure is over all of them."""
    bearing_deg: Annotated[float, Bounds(-80, 80)] = 10.0
    """Where it is, right of the optical axis: roll costs nothing straight ahead."""
    keypoint_std_px: Annotated[float, Bounds(0, 100)] = 1.0
    """How well keypoints and boxes are found."""
    curved_water: bool = False
    draws: Annotated[int, Bounds(10, 1_000_000)] = 100
    """Of the Monte Carlo, for each distance and heading."""
    seed: Annotated[int, Bounds(0)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, values in (("distances_m", self.distances_m), ("headings_deg", self.headings_deg)):
            if not values:
                raise ValueError(f"{name}: expected at least one number")
        if min(self.distances_m) <= 0:
            raise ValueError(f"distances_m: expected metres above 0, got {min(self.distances_m):g}")
        for name, values in self.disturbances.items():
            if name not in DISTURBANCES:
                raise ValueError(f"disturbances: unknown key {name!r}; expected one of {', '.join(DISTURBANCES)}")
            if not values:
                raise ValueError(f"disturbances: {name}: expected at least one number")
            if DISTURBANCES[name].noise and min(values) < 0:
                raise ValueError(f"disturbances: {name}: expected standard deviations of at least 0, got {min(values)}")


def load_sensitivity(path: Path | str) -> SensitivitySettings:
    """Read the settings of a study.

    Raises:
        FileNotFoundError: no such file.
        ValueError: one sentence naming the file, the key and what was expected.
    """
    path = Path(path)
    return fill(SensitivitySettings, read_mapping(path), f"{path}", path.parent)
