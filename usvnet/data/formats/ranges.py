"""``ranges.csv`` (what the laser read) and ``frames.csv`` (which camera, hull, scene and attitude), by picture.

Both are optional tables with a header and a column ``image``, the picture's path below ``images/``. Angles are in
degrees. An empty cell is the same as a column that is not there.

``reference`` says which point of the boat the laser read: ``nearest_waterline`` (the default), ``bow_bottom`` or
``stern_bottom``. Ranges are met with the water, so that no point of the deck can be one.
"""

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from usvnet.data.records import Faults, RangeReading
from usvnet.types import KEYPOINT_NAMES, NEAREST_WATERLINE, WATERLINE_KEYPOINTS

ATTITUDE_COLUMNS = ("pitch_deg", "roll_deg", "pitch_std_deg", "roll_std_deg")
RANGE_COLUMNS = ("image", "range_m", "range_std_m", "instance", "reference", "scene", *ATTITUDE_COLUMNS)
REFERENCES = {"nearest_waterline": NEAREST_WATERLINE, **{KEYPOINT_NAMES[i]: i for i in WATERLINE_KEYPOINTS}}
TOO_LARGE = 2**63
"""What no float32 and no index holds is no measurement."""

Number = TypeVar("Number", int, float)


@dataclass
class FrameNotes:
    """What the tables say about one picture; None where they say nothing."""

    camera: str | None = None
    hull: str | None = None
    scene: str | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    pitch_std_deg: float | None = None
    roll_std_deg: float | None = None
    time_s: float | None = None
    """When it was taken, for imu.csv."""
    readings: dict[int, RangeReading] = field(default_factory=dict)
    """By instance, the boat's row in the label file."""
    line: str = ""
    """File and line of the last row, for messages."""

    def note(self, key: str, value: str | float | None) -> None:
        """Keep what a row says; two rows of one picture may not contradict each other."""
        known = getattr(self, key)
        if value is not None and known is not None and known != value:
            raise ValueError(f"{key} is {value}, but an earlier row of the same picture says {known}")
        setattr(self, key, known if value is None else value)


def read_tables(root: Path, faults: Faults) -> dict[str, FrameNotes]:
    """Read frames.csv and ranges.csv below ``root``, whichever is there, into notes by picture name.

    Other columns of frames.csv are never looked at: a rendered dataset keeps the truth there.

    Raises:
        ValueError: naming file and line (or noted in ``faults``).
    """
    notes: dict[str, FrameNotes] = {}
    for line, row in _rows(root / "frames.csv", faults):
        with faults.catch():
            _note_row(line, row, notes)
    for line, row in _rows(root / "ranges.csv", faults, allowed=RANGE_COLUMNS):
        with faults.catch():
            picture = _note_row(line, row, notes)
            _note_reading(line, row, picture)
    return notes


def _rows(path: Path, faults: Faults, allowed: tuple[str, ...] = ()) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield ``file:line`` and the filled cells of each row; ``allowed`` restricts the columns."""
    if not path.is_file():
        return
    with faults.catch(), path.open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        reader = csv.DictReader(stream, skipinitialspace=True)
        try:
            columns = reader.fieldnames or ()
            required = {"image", "range_m"} if allowed else {"image"}
            unknown = [name for name in columns if allowed and name not in allowed]
            if not required <= set(columns):
                raise ValueError(f"{path}:1: columns {', '.join(columns)}, expected {' and '.join(sorted(required))}")
            with faults.catch():
                if unknown:
                    raise ValueError(f"{path}:1: unknown column '{unknown[0]}', expected some of {', '.join(allowed)}")
            for row in reader:
                yield f"{path}:{reader.line_num}", {key: cell.strip() for key, cell in row.items() if key and cell}
        except csv.Error as error:
            raise ValueError(f"{path}:{reader.line_num}: not readable as a table: {error}") from None


def _note_row(line: str, row: dict[str, str], notes: dict[str, FrameNotes]) -> FrameNotes:
    """Keep camera, hull, scene and attitude of one row."""
    if not row.get("image"):
        raise ValueError(f"{line}: no image named, expected a path below images/ such as train/0001.jpg")
    picture = notes.setdefault(row["image"], FrameNotes())
    picture.line = line
    try:
        picture.note("camera", row.get("camera"))
        picture.note("hull", row.get("hull"))
        picture.note("scene", row.get("scene"))
        picture.note("time_s", _number(row, "time_s", float))
        for key in ATTITUDE_COLUMNS:
            value = _number(row, key, float)
            if value is not None and (value < 0 if key.endswith("std_deg") else abs(value) > 90):
                raise ValueError(f"{key} is {row[key]}, expected -90 to 90 degrees, and a deviation of 0 or more")
            picture.note(key, value)
    except ValueError as error:
        raise ValueError(f"{line}: {error}") from None
    return picture


def _note_reading(line: str, row: dict[str, str], picture: FrameNotes) -> None:
    """Keep the laser's reading of one row."""
    try:
        range_m = _number(row, "range_m", float)
        if range_m is None or range_m <= 0:
            raise ValueError(f"range_m is {row.get('range_m', 'empty')}, expected metres above 0")
        range_std_m = _number(row, "range_std_m", float) or 0.0
        if range_std_m < 0:
            raise ValueError(f"range_std_m is {row['range_std_m']}, expected metres, 0 or more")
        instance = _number(row, "instance", int) or 0
        if instance < 0:
            raise ValueError(f"instance is {row['instance']}, expected the boat's row in the label file")
        if instance in picture.readings:
            raise ValueError(f"a second range for instance {instance} of {row['image']}, expected one")
        reference = row.get("reference", "nearest_waterline")
        if reference not in REFERENCES:
            raise ValueError(f"reference is {reference}, expected one of {', '.join(REFERENCES)}")
    except ValueError as error:
        raise ValueError(f"{line}: {error}") from None
    picture.readings[instance] = RangeReading(range_m, range_std_m, instance, REFERENCES[reference])


def _number(row: dict[str, str], key: str, kind: Callable[[str], Number]) -> Number | None:
    """Read a finite number of a cell, None if the cell is empty."""
    if not row.get(key):
        return None
    try:
        value = kind(row[key])
    except ValueError:
        raise ValueError(f"{key} is '{row[key]}', expected a number") from None
    if not abs(value) < TOO_LARGE:
        raise ValueError(f"{key} is {row[key]}, expected a finite number")
    return value
