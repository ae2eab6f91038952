"""``imu.csv``: the camera's pitch and roll as an inertial unit read them, and what they were when a picture was taken.

Columns ``time_s``, ``pitch_deg``, ``roll_deg`` and, if known, ``pitch_std_deg``, ``roll_std_deg``; times rise from row
to row. The angles are the camera's (:mod:`usvnet.types`): how the unit is turned against it is taken off beforehand.
"""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

REQUIRED = ("time_s", "pitch_deg", "roll_deg")
STDS = ("pitch_std_deg", "roll_std_deg")
HIGHEST_DEG = 90.0


@dataclass(frozen=True)
class ImuLog:
    """N readings in the order of their times."""

    time_s: NDArray[np.float64]
    """(N,) rising."""
    angles_deg: NDArray[np.float64]
    """(N, 2) pitch and roll."""
    stds_deg: NDArray[np.float64] | None
    """(N, 2) their standard deviations, None where the file has none."""

    def at(self, time_s: float, max_gap_s: float) -> tuple[list[float], list[float] | None] | None:
        """Pitch and roll (deg) and their standard deviations at a time, by linear interpolation.

        Between two readings of independent errors, v = (1 - t)^2 v0 + t^2 v1; what the boat does between them is not
        in it, so ``max_gap_s`` should be short against its roll.

        Returns:
            None outside the log, and inside a gap longer than ``max_gap_s``.
        """
        after = int(np.searchsorted(self.time_s, time_s))
        if after < len(self.time_s) and self.time_s[after] == time_s:
            return self.angles_deg[after].tolist(), None if self.stds_deg is None else self.stds_deg[after].tolist()
        if after in (0, len(self.time_s)) or self.time_s[after] - self.time_s[after - 1] > max_gap_s:
            return None
        share = (time_s - self.time_s[after - 1]) / (self.time_s[after] - self.time_s[after - 1])
        weights = np.array([1 - share, share])
        angles = weights @ self.angles_deg[after - 1 : after + 1]
        if self.stds_deg is None:
            return angles.tolist(), None
        return angles.tolist(), np.sqrt(weights**2 @ self.stds_deg[after - 1 : after + 1] ** 2).tolist()


def read_imu(path: Path) -> ImuLog:
    """Read an IMU's log.

    Raises:
        FileNotFoundError: no such file.
        ValueError: naming file and line.
    """
    rows: list[list[float]] = []
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        reader = csv.DictReader(stream, skipinitialspace=True)
        try:
            columns = reader.fieldnames or ()
            missing = [name for name in REQUIRED if name not in columns]
            if missing:
                raise ValueError(f"{path}:1: column {missing[0]} is missing, expected {', '.join(REQUIRED)}")
            has_stds = [name in columns for name in STDS]
            if any(has_stds) and not all(has_stds):
                raise ValueError(f"{path}:1: expected both {' and '.join(STDS)}, or neither")
            for row in reader:
                where = f"{path}:{reader.line_num}"
                rows.append([_number(row, name, where) for name in (*REQUIRED, *(STDS if all(has_stds) else ()))])
                if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
                    raise ValueError(f"{where}: time_s is {rows[-1][0]:g}, not after the row before ({rows[-2][0]:g})")
        except csv.Error as error:
            raise ValueError(f"{path}:{reader.line_num}: not readable as a table: {error}") from None
    if not rows:
        raise ValueError(f"{path}: no readings, expected at least one row")
    table = np.array(rows)
    return ImuLog(table[:, 0], table[:, 1:3], table[:, 3:5] if all(has_stds) else None)


def _number(row: dict[str, str], name: str, where: str) -> float:
    text = (row[name] or "").strip()
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{where}: {name} is '{text}', expected a number") from None
    if not math.isfinite(value):
        raise ValueError(f"{where}: {name} is {text}, expected a finite number")
    if name.endswith("std_deg") and value < 0:
        raise ValueError(f"{where}: {name} is {text}, expected a deviation of 0 or more")
    if name in ("pitch_deg", "roll_deg") and abs(value) > HIGHEST_DEG:
        raise ValueError(f"{where}: {name} is {text}, expected -90 to 90 degrees")
    return value
