"""What is true of a rendered frame as plain numbers, for a JSON file: nothing that was drawn or measured is lost.

Every number stands with the name and the unit that it has in :mod:`usvnet.simulator.frame_spec` and
:mod:`usvnet.simulator.rendered`; a number that is not finite is null.
"""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import torch

from usvnet.simulator.rendered import BoatTruth, RenderedFrame
from usvnet.types import WATERLINE_KEYPOINTS

Truth = dict[str, Any]
"""One frame: ``image``, ``size_px``, ``spec``, ``sea_height_std_m`` and ``boats`` in the order of the label rows."""

LASER_STREAM = 1
"""Tells the laser's random numbers from others that are drawn of the same seed."""


def frame_truth(frame: RenderedFrame) -> Truth:
    """Everything that is known of a frame but its pixels and how long it took."""
    readings_m = laser_readings(frame)
    return {
        "image": frame.spec.name,
        "size_px": [frame.picture.shape[1], frame.picture.shape[0]],
        "sea_height_std_m": plain(frame.sea_height_std_m),
        "boats": [
            {**plain(boat), "laser_reading_m": plain(reading_m)} for boat, reading_m in zip(frame.boats, readings_m)
        ],
        "spec": plain(frame.spec),
    }


def laser_readings(frame: RenderedFrame) -> list[float]:
    """What the laser says of each boat: the slant range of its nearer waterline point with the laser's noise.

    NaN where there is no reading: the frame has no laser, or one of the two waterline points is outside the picture.
    (Training and evaluation take the nearer of both as predicted, so both must be there to be found.)
    """
    spec = frame.spec
    noise_m = spec.laser_std_m * np.random.default_rng([spec.sensor.seed, LASER_STREAM]).standard_normal(
        len(frame.boats)
    )
    return [
        float(boat.slant_m[boat.nearest] + error_m) if spec.has_laser and _on_water(boat) else math.nan
        for boat, error_m in zip(frame.boats, noise_m)
    ]


def _on_water(boat: BoatTruth) -> bool:
    return bool((boat.visibility[list(WATERLINE_KEYPOINTS)] > 0).all() and np.isfinite(boat.slant_m).all())


def plain(value: Any) -> Any:
    """Dataclasses, cameras and arrays as what JSON has; of a file's path only its name."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return value.name  # where it lies on this machine says nothing on another
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, torch.Tensor):
        return plain(value.tolist())
    if dataclasses.is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):  # a camera is a batch of one
        return {name: plain(field[0]) for name, field in value._asdict().items()}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    raise TypeError(f"{type(value).__name__}: not known how to write it as JSON")


def truth_text(truth: Truth) -> str:
    """The truth as one line of JSON; numbers read back bit for bit."""
    return json.dumps(truth, allow_nan=False, separators=(",", ":")) + "\n"


def read_truth(path: Path) -> Truth:
    """Read what :func:`truth_text` wrote.

    Raises:
        ValueError: naming the file that is damaged.
    """
    try:
        truth: Truth = json.loads(path.read_text(encoding="utf-8"))
        if not {"image", "size_px", "boats", "spec"} <= set(truth):
            raise ValueError("keys are missing")
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: damaged ({error}), delete it and render its frame again") from None
    return truth


def numbers_or_nan(values: Any) -> np.ndarray:
    """Nested lists of numbers and nulls as an array of float64 with NaN."""
    return np.array(values, dtype=np.float64)
