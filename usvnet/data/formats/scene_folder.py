"""A folder as the paper's data is kept: pictures by scene (and time), a text file of labels each, a table of ranges.

- Pictures anywhere below; the first folder is the scene (``I/0001.jpg``), unless it is ``images``, or it is ``train``,
  ``val`` or ``test``, which is then the split.
- ``0001.txt`` beside its picture, or in a folder ``labels`` where the picture's is called ``images``: YOLO-pose lines
  with or without visibility (:mod:`usvnet.data.formats.exports`). A picture without is one without boats.
- ``*.csv`` at the top, as spreadsheets save them (comma, semicolon or tab; decimal point or comma): a column for the
  picture (``image``, ``file``, ``name`` ...; with folders or without, with its ending or without) and one for the laser
  (``range``, ``distance``, ``laser`` ..., in metres), and if need be ``std_m``, ``instance``, ``reference``, ``scene``.
  An empty range is no reading. A picture in no scene's folder has the scene that ``scene`` says.
"""

import csv
import math
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from usvnet.data.formats.exports import (
    KEYPOINT_ORDER_NOTE,
    Export,
    Follow,
    LabelledPicture,
    picture_size,
    read_text_labels,
    refuse_several_classes,
)
from usvnet.data.formats.ranges import REFERENCES, TOO_LARGE
from usvnet.data.picture_files import PICTURE_SUFFIXES, pictures_below
from usvnet.data.records import SPLITS, Faults, RangeReading

HEADERS = {
    "image": ("image", "picture", "photo", "frame", "file", "filename", "file_name", "image_name", "name"),
    "range_m": ("range", "range_m", "distance", "distance_m", "laser", "laser_m", "laser_range", "laser_range_m"),
    "range_std_m": ("range_std_m", "range_std", "std_m", "std"),
    "instance": ("instance", "boat"),
    "reference": ("reference",),
    "scene": ("scene",),
}
"""What people call each column, in small letters, with a ``_`` for whatever is no letter or digit."""

Readings = dict[str, list[tuple[str, RangeReading]]]
"""Place for messages and reading, by the picture's path below the folder."""
Scenes = dict[str, tuple[str, str]]
"""Place for messages and scene, by the same."""


def read_scene_folder(folder: Path, faults: Faults, follow: Follow = iter) -> Export:
    """Read the pictures of a folder, in the order of their paths.

    Args:
        folder: holds pictures, labels and perhaps tables.
        faults: where to note what is wrong; without ``collect`` the first fault is raised.
        follow: wraps the pictures while they are read.

    Raises:
        FileNotFoundError: no pictures, or no labels.
        ValueError: naming file and line.
    """
    paths = pictures_below(folder)
    names = [path.relative_to(folder) for path in paths]
    if not names:
        raise FileNotFoundError(f"{folder}: no pictures, expected some {', '.join(PICTURE_SUFFIXES)}")
    label_paths = {name: _label_path(folder, name) for name in names}
    if not any(path.is_file() for path in label_paths.values()):
        raise FileNotFoundError(f"{folder}: no labels, expected a text file such as {label_paths[names[0]]}")
    readings, scenes = _read_tables(folder, [name.as_posix() for name in names], faults)
    pictures: list[LabelledPicture] = []
    classes: set[int] = set()
    for name in follow(names):
        with faults.catch():
            size_px = picture_size(folder / name)
            noted = len(faults.sentences)
            labels, kinds = read_text_labels(label_paths[name], size_px, faults)
            classes |= kinds
            found = readings.get(name.as_posix(), [])
            for where, reading in found:
                if reading.instance >= len(labels.boxes_px):
                    boats = f"{label_paths[name]} has {len(labels.boxes_px)} boats"
                    raise ValueError(f"{where}: a range for boat {reading.instance} of {name}, but {boats}")
            if len(faults.sentences) > noted:
                continue
            parts = [part for part in name.parts if part != "images"]
            split = parts.pop(0) if len(parts) > 1 and parts[0] in SPLITS else None
            scene = parts[0] if len(parts) > 1 else None
            if name.as_posix() in scenes:
                where, said = scenes[name.as_posix()]
                if scene not in (None, said):
                    raise ValueError(f"{where}: scene is {said}, but {name} lies in the folder of scene {scene}")
                scene = said
            taken = tuple(reading for _, reading in found)
            pictures.append(LabelledPicture(folder / name, "/".join(parts), split, scene, size_px, labels, taken))
    with faults.catch():
        refuse_several_classes(f"{folder}", classes)
    return Export(pictures, [KEYPOINT_ORDER_NOTE])


def _label_path(folder: Path, name: Path) -> Path:
    """Where the labels of a picture lie: beside it, or in ``labels`` where it lies in ``images``."""
    beside = (folder / name).with_suffix(".txt")
    if "images" not in name.parts[:-1] or beside.is_file():
        return beside
    at = name.parts.index("images")
    return folder.joinpath(*name.parts[:at], "labels", *name.parts[at + 1 :]).with_suffix(".txt")


def _read_tables(folder: Path, names: list[str], faults: Faults) -> tuple[Readings, Scenes]:
    """What the laser read and which scene it was, from every table at the top of the folder."""
    by_ending: dict[str, list[str]] = defaultdict(list)  # a picture's names: I/0001.jpg, I/0001, 0001.jpg, 0001
    for name in names:
        parts = PurePosixPath(name).parts
        for start in range(len(parts)):
            ending = PurePosixPath(*parts[start:])
            for way in (ending.as_posix(), ending.with_suffix("").as_posix()):
                by_ending[way].append(name)
    readings: Readings = defaultdict(list)
    scenes: Scenes = {}
    for path in sorted(folder.glob("*.csv")):
        with faults.catch():
            for where, row in _rows(path):
                with faults.catch():
                    try:
                        reading = _reading(row)
                        if reading is None and len(_pictures_of(row, by_ending)) != 1:
                            continue
                        name = _picture_of(row, by_ending)
                        if "scene" in row and scenes.setdefault(name, (where, row["scene"]))[1] != row["scene"]:
                            before, said = scenes[name]
                            raise ValueError(f"scene of {name} is {row['scene']}, but {before} says {said}")
                        if reading is None:
                            continue
                        if reading.instance in (known.instance for _, known in readings[name]):
                            raise ValueError(f"a second range for boat {reading.instance} of {name}, expected one")
                    except ValueError as error:
                        raise ValueError(f"{where}: {error}") from None
                    readings[name].append((where, reading))
    return readings, scenes


def _rows(path: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield ``file:line`` and the cells that are filled and known, by our name of their column."""
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        header = stream.readline()
        delimiter = max(",;\t", key=header.count)
        stream.seek(0)
        reader = csv.reader(stream, delimiter=delimiter, skipinitialspace=True)
        columns: list[str | None] = []
        try:
            for cells in reader:
                if not columns:
                    columns = [_column(cell) for cell in cells]
                    for needed in ("image", "range_m"):
                        if columns.count(needed) != 1:
                            known = ", ".join(HEADERS[needed])
                            raise ValueError(f"{path}:1: {columns.count(needed)} columns of {known}, expected one")
                elif any(cell.strip() for cell in cells):
                    row = {column: cell.strip() for column, cell in zip(columns, cells) if column and cell.strip()}
                    if delimiter != ",":
                        row |= {key: row[key].replace(",", ".") for key in ("range_m", "range_std_m") if key in row}
                    yield f"{path}:{reader.line_num}", row
        except csv.Error as error:
            raise ValueError(f"{path}:{reader.line_num}: not readable as a table: {error}") from None


def _column(header: str) -> str | None:
    """Our name of a column, None of one that is not needed."""
    plain = re.sub(r"[^a-z0-9]+", "_", header.lower()).strip("_")
    return next((name for name, ways in HEADERS.items() if plain in ways), None)


def _reading(row: dict[str, str]) -> RangeReading | None:
    """What the laser read in a row; None where it read nothing."""
    if "range_m" not in row:
        return None
    range_m, std_m = _number(row, "range_m"), _number(row, "range_std_m")
    if range_m <= 0 or std_m < 0:
        raise ValueError(f"range {range_m:g} m, deviation {std_m:g} m, expected more than 0, and 0 or more")
    instance = row.get("instance", "0")
    if not re.fullmatch(r"[0-9]{1,6}", instance):
        raise ValueError(f"instance is {instance}, expected the boat's row in the label file, from 0")
    reference = row.get("reference", "nearest_waterline")
    if reference not in REFERENCES:
        raise ValueError(f"reference is {reference}, expected one of {', '.join(REFERENCES)}")
    return RangeReading(range_m, std_m, int(instance), REFERENCES[reference])


def _number(row: dict[str, str], key: str) -> float:
    text = row.get(key, "0")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) < TOO_LARGE:
        raise ValueError(f"{key} is {text}, expected a number of metres")
    return value


def _pictures_of(row: dict[str, str], by_ending: dict[str, list[str]]) -> set[str]:
    """The pictures that a row can mean."""
    found = set(by_ending.get(_written(row), []))
    if len(found) > 1 and "scene" in row:
        found = {name for name in found if row["scene"] in PurePosixPath(name).parts[:-1]}
    return found


def _picture_of(row: dict[str, str], by_ending: dict[str, list[str]]) -> str:
    """The only picture that a row can mean."""
    if "image" not in row:
        raise ValueError("a range without a picture, expected a name such as I/0001.jpg")
    found = _pictures_of(row, by_ending)
    if len(found) != 1:
        raise ValueError(f"image is {_written(row)}, which {len(found)} pictures could be, expected one")
    return found.pop()


def _written(row: dict[str, str]) -> str:
    """The picture's name as it stands in a row, with slashes."""
    return row.get("image", "").replace("\\", "/").removeprefix("./")
