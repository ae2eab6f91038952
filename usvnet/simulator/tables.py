"""The truths of a dataset as tables: frames.csv, boats.csv and ranges.csv.

``frames.csv`` has a row a picture: all that was drawn for it, and the whole truth of its first boat (but ``hull``
only where it is every boat's). ``boats.csv`` has
a row a boat. ``ranges.csv`` is what the laser read, all that training may know of the distance. Angles are in degrees,
points in the world frame (:mod:`usvnet.simulator`); an empty cell is a number that does not exist.
"""

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from usvnet.files import atomic_write
from usvnet.simulator.truth import Truth, numbers_or_nan
from usvnet.types import KEYPOINT_NAMES, WATERLINE_KEYPOINTS

Row = dict[str, Any]

PARTS = ("sky", "air", "sea", "shore", "shutter", "sensor")
"""Parts of a frame's spec whose every number becomes a column, ``<part>_<name>``."""
SHORTER = {
    "air_visibility_m": "visibility_m",
    "sky_sun_azimuth_rad": "sun_azimuth_rad",
    "sky_sun_elevation_rad": "sun_elevation_rad",
    "sky_sun_strength": "sun_strength",
    "sea_wind_rad": "wind_rad",
}
ATTITUDE = ("pitch_deg", "roll_deg", "pitch_std_deg", "roll_std_deg")
DECIMALS = 6


def frame_row(truth: Truth) -> Row:
    """The row of frames.csv: what was drawn, then the columns of boats.csv for the first boat, if there is one."""
    spec = truth["spec"]
    camera = spec["camera"]
    row = {
        "image": truth["image"],
        **{key: spec[key] for key in ("split", "scene", "number")},
        "camera": spec["camera_name"],
        **_attitude(spec),
        "true_pitch_deg": math.degrees(camera["pitch_rad"]),
        "true_roll_deg": math.degrees(camera["roll_rad"]),
        "true_height_m": camera["height_m"],
        "boats": len(truth["boats"]),
        "clutter": len(spec["clutter"]),
        "sea_height_std_m": truth["sea_height_std_m"],
        "has_laser": spec["has_laser"],
        "laser_std_m": spec["laser_std_m"],
    }
    for part in PARTS:
        for name, value in spec[part].items():
            row |= _column(f"{part}_{name}", value)
    if truth["boats"]:
        row |= _boat_columns(truth["boats"][0], camera["height_m"])
        if len({boat["spec"]["hull"]["name"] for boat in truth["boats"]}) > 1:
            row["hull"] = None  # a reader takes this column for the hull of every boat in the picture
    return row


def boat_rows(truth: Truth) -> list[Row]:
    """The rows of boats.csv; ``instance`` is the boat's row in the label file."""
    return [
        {"image": truth["image"], "instance": i, **_boat_columns(boat, truth["spec"]["camera"]["height_m"])}
        for i, boat in enumerate(truth["boats"])
    ]


def range_rows(truth: Truth) -> list[Row]:
    """The rows of ranges.csv."""
    spec = truth["spec"]
    return [
        {
            "image": truth["image"],
            "range_m": boat["laser_reading_m"],
            "range_std_m": spec["laser_std_m"],
            "instance": i,
            "reference": "nearest_waterline",
            "scene": spec["scene"],
            **_attitude(spec),
        }
        for i, boat in enumerate(truth["boats"])
        if boat["laser_reading_m"] is not None
    ]


def write_table(path: Path, rows: Sequence[Row], columns: Iterable[str] = ()) -> None:
    """Write rows as CSV with a header: ``columns``, then every further one in the order in which it first appears."""
    header = list(dict.fromkeys([*columns, *(key for row in rows for key in row)]))
    with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([_cell(row.get(key)) for key in header] for row in rows)


def _attitude(spec: Row) -> Row:
    """What an IMU has measured; nothing where there is none, and the mount stands."""
    std_deg = spec["attitude_std_deg"]
    if std_deg is None:
        return dict.fromkeys(ATTITUDE)
    return dict(zip(ATTITUDE, (spec["measured_pitch_deg"], spec["measured_roll_deg"], std_deg, std_deg)))


def _boat_columns(boat: Row, camera_height_m: float) -> Row:
    slant_m, horizontal_m, water_m = (
        numbers_or_nan(boat[key]) for key in ("slant_m", "horizontal_m", "water_height_m")
    )
    nearest = int(np.argmin(np.nan_to_num(slant_m, nan=np.inf)))
    laser_m = numbers_or_nan(boat["laser_hit_m"])
    spec, hull, origin = boat["spec"], boat["spec"]["hull"], boat["origin_m"]
    return {
        "hull": hull["name"],
        "hull_family": hull["family"],
        "hull_length_m": hull["length_m"],
        "paint_seed": spec["paint_seed"],
        "nearest_waterline": KEYPOINT_NAMES[WATERLINE_KEYPOINTS[nearest]],
        "true_slant_m": slant_m[nearest],
        "true_horizontal_m": horizontal_m[nearest],
        "bow_bottom_slant_m": slant_m[0],
        "stern_bottom_slant_m": slant_m[1],
        "bow_bottom_horizontal_m": horizontal_m[0],
        "stern_bottom_horizontal_m": horizontal_m[1],
        "water_height_bow_m": water_m[0],
        "water_height_stern_m": water_m[1],
        "boat_x_m": origin[0],
        "boat_y_m": origin[1],
        "boat_z_m": origin[2],
        "boat_yaw_deg": math.degrees(boat["yaw_rad"]),
        "boat_pitch_deg": math.degrees(boat["pitch_rad"]),
        "boat_roll_deg": math.degrees(boat["roll_rad"]),
        "speed_mps": spec["speed_mps"],
        "laser_x_m": laser_m[0],
        "laser_y_m": laser_m[1],
        "laser_z_m": laser_m[2],
        "laser_on_boat": boat["laser_on_boat"],
        "mid_hull_laser_slant_m": np.linalg.norm(laser_m - (0, 0, camera_height_m)),
        "mid_hull_laser_horizontal_m": np.hypot(laser_m[0], laser_m[1]),
        "seen_px": boat["seen_px"],
        "truncated": boat["truncated"],
    }


def _column(name: str, value: Any) -> Row:
    """One number of a spec as a column, angles in degrees and colours as three columns."""
    name = SHORTER.get(name, name)
    if name.endswith("_rgb"):
        return {f"{name.removesuffix('rgb')}{colour}": part for colour, part in zip(("red", "green", "blue"), value)}
    if name.endswith(("_rad", "_rad_s")):
        name, value = name.replace("_rad", "_deg"), math.degrees(value)
    return {name: value}


def _cell(value: Any) -> str:
    """What stands in a cell: numbers to a millionth, empty for what does not exist."""
    if value is None:
        return ""
    if isinstance(value, bool | int | str):
        return str(int(value) if isinstance(value, bool) else value)
    if not math.isfinite(value):
        return ""
    text = f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
