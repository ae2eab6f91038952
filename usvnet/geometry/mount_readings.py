"""Readings that tell how a camera is mounted: a CSV file, one reading a line.

============ ===================================================================================================
``kind``     ``range`` (the default): a point on the water whose slant range was measured;
             ``point``: a surveyed point; ``horizon``: a point of the sea's horizon (two make a line).
``u_px``     where it is in the picture; ``pixel_std_px`` says how well it was picked (1 if left out).
``v_px``
``range_m``  of a ``range``, from the optical centre; ``range_std_m`` says how well (0 if left out).
``right_m``  of a ``point``, from the water below the camera: to the right, forward, and up from mean water. Which way
``forward_m`` is forward does not matter, it is found with the mount; it must be the same for all points.
``up_m``
``image``    any text, told back with the residuals.
============ ===================================================================================================
"""

import csv
import math
from pathlib import Path
from typing import Literal, NamedTuple, get_args

Kind = Literal["range", "point", "horizon"]
NEEDED: dict[str, tuple[str, ...]] = {
    "range": ("u_px", "v_px", "range_m"),
    "point": ("u_px", "v_px", "right_m", "forward_m", "up_m"),
    "horizon": ("u_px", "v_px"),
}
NUMBERS = ("u_px", "v_px", "range_m", "range_std_m", "right_m", "forward_m", "up_m", "pixel_std_px")
COLUMNS = ("image", "kind", *NUMBERS)


class MountReading(NamedTuple):
    """One reading; numbers that its kind does not have are 0."""

    line: int
    """In the file, from 1."""
    image: str
    kind: Kind
    u_px: float
    v_px: float
    range_m: float = 0.0
    range_std_m: float = 0.0
    right_m: float = 0.0
    forward_m: float = 0.0
    up_m: float = 0.0
    pixel_std_px: float = 1.0


def read_mount_readings(path: Path | str) -> list[MountReading]:
    """Read a file of readings.

    Raises:
        FileNotFoundError: no such file.
        ValueError: naming file, line and what was expected.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    readings = []
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        reader = csv.DictReader(stream, skipinitialspace=True)
        for name in reader.fieldnames or ():
            if name not in COLUMNS:
                raise ValueError(f"{path}:1: unknown column '{name}', expected some of {', '.join(COLUMNS)}")
        for row in reader:
            cells = {key: cell.strip() for key, cell in row.items() if key and cell and cell.strip()}
            try:
                readings.append(_reading(reader.line_num, cells))
            except ValueError as error:
                raise ValueError(f"{path}:{reader.line_num}: {error}") from None
    if not readings:
        raise ValueError(f"{path}: no readings, expected a header and at least one line")
    return readings


def _reading(line: int, cells: dict[str, str]) -> MountReading:
    kind = cells.get("kind", "range")
    if kind not in get_args(Kind):
        raise ValueError(f"kind is '{kind}', expected one of {', '.join(get_args(Kind))}")
    for key in NEEDED[kind]:
        if key not in cells:
            raise ValueError(f"{key} is empty, expected a number for a {kind}")
    numbers = {key: _number(key, cells[key]) for key in NUMBERS if key in cells}
    for key in ("range_m", "pixel_std_px"):
        if key in numbers and numbers[key] <= 0:
            raise ValueError(f"{key} is {cells[key]}, expected more than 0")
    if numbers.get("range_std_m", 0.0) < 0:
        raise ValueError(f"range_std_m is {cells['range_std_m']}, expected metres, 0 or more")
    if kind == "point" and math.hypot(numbers["right_m"], numbers["forward_m"]) == 0:
        raise ValueError("right_m and forward_m are 0, expected a point that is not straight below the camera")
    return MountReading(line, cells.get("image", ""), kind, **numbers)  # type: ignore[arg-type]


def _number(key: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise ValueError(f"{key} is '{text}', expected a number") from None
    if not math.isfinite(number):
        raise ValueError(f"{key} is {text}, expected a finite number")
    return number
