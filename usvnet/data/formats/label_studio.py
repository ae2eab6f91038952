"""Label Studio's JSON export of ``RectangleLabels`` and ``KeyPointLabels`` on one image.

A list of tasks; each has ``data`` (where the picture is), and ``annotations``, of which one with a ``result``: a list
of regions with ``original_width``, ``original_height``, ``image_rotation`` and a ``value`` in percent of the picture. A
``rectanglelabels`` region is a boat (``x``, ``y`` its top left corner, about which it is turned by ``rotation`` degrees
clockwise; the boat's box is what encloses it), a ``keypointlabels`` region one keypoint, named as in
:data:`usvnet.types.KEYPOINT_NAMES`. A keypoint belongs to the rectangle that its ``parentID`` or a ``relation`` names,
else to the only one that it lies in. It counts as seen, unless a choice or a note (``meta.text``) of the region says
``hidden``. Other regions are left alone.

The export holds no pictures: they are looked for by name in a folder. Label Studio puts eight hexadecimal digits before
the name of an uploaded file, which may be there or not.
"""

import math
import re
from collections import defaultdict
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from usvnet.data.formats.exports import Export, Follow, LabelledPicture, picture_size
from usvnet.data.formats.fractions import TOLERANCE, keep_inside, to_boat
from usvnet.data.formats.json_files import read_json
from usvnet.data.picture_files import PICTURE_SUFFIXES, pictures_below
from usvnet.data.records import Faults, Labels
from usvnet.geometry.yaml_files import Mapping, as_mapping, as_number, require, short
from usvnet.types import KEYPOINT_NAMES, NUM_KEYPOINTS
from usvnet.wording import counted

HIDDEN = "hidden"
UPLOAD = re.compile(r"[0-9a-f]{8}-(.+)")
"""The name that Label Studio gives to an uploaded file."""


def read_label_studio(path: Path, pictures: Path, faults: Faults, follow: Follow = iter) -> Export:
    """Read the labelled tasks of an export.

    Args:
        path: the JSON file.
        pictures: the folder below which the pictures lie.
        faults: where to note what is wrong; without ``collect`` the first fault is raised.
        follow: wraps the tasks while they are read.

    Raises:
        FileNotFoundError: no such file, or no such picture.
        ValueError: naming the file, the task and what is wrong with it.
    """
    tasks = read_json(path)
    if not isinstance(tasks, list) or not tasks:
        raise ValueError(f"{path}: expected a list of tasks, as Label Studio's JSON export writes it")
    files: dict[str, list[Path]] = defaultdict(list)
    for file in pictures_below(pictures):
        files[file.name].append(file)
    found: dict[Path, LabelledPicture] = {}
    kinds: set[str] = set()
    skipped = 0
    for number, task in enumerate(follow(tasks)):
        with faults.catch():
            where = f"{path}: tasks[{number}]"
            try:
                result = _chosen_result(as_mapping(task, "task"))
                if result is None:
                    skipped += 1
                    continue
                image_path = _find_picture(task, files, pictures)
                if image_path in found:
                    raise ValueError(f"a second task of {image_path}, expected one")
                size_px = picture_size(image_path)
                boats = _read_boats(result, size_px, kinds)
            except (ValueError, FileNotFoundError) as error:
                raise type(error)(f"{where}: {error}") from None
            name = image_path.relative_to(pictures).as_posix()
            found[image_path] = LabelledPicture(image_path, name, None, None, size_px, Labels.of(boats))
    with faults.catch():
        if len(kinds) > 1:
            raise ValueError(f"{path}: rectangles are labelled {', '.join(sorted(kinds))}, expected one label")
        if skipped == len(tasks):
            raise ValueError(f"{path}: none of the {len(tasks)} tasks has an annotation")
    return Export(
        list(found.values()), [f"{counted(skipped, 'task')} without an annotation left out"] if skipped else []
    )


def _chosen_result(task: Mapping) -> list[Mapping] | None:
    """The regions of the task's annotation; None where nobody has labelled it yet."""
    if not isinstance(task.get("annotations"), list):
        raise ValueError("no list of annotations, expected the JSON export (JSON-MIN leaves out what is needed)")
    kept = [as_mapping(each, "annotation") for each in task["annotations"]]
    kept = [each for each in kept if not each.get("was_cancelled")]
    if len(kept) > 1:
        kept = [each for each in kept if each.get("ground_truth")] or kept
    if not kept:
        return None
    if len(kept) > 1:
        raise ValueError(f"{len(kept)} annotations, expected one, or one that is marked as ground truth")
    result = require(kept[0], "result", "annotation")
    if not isinstance(result, list):
        raise ValueError(f"result is {short(result)}, expected a list of regions")
    return [as_mapping(region, "region") for region in result]


def _find_picture(task: Mapping, files: dict[str, list[Path]], folder: Path) -> Path:
    """The picture of a task: ``/data/upload/...``, ``/data/local-files/?d=...`` or an address, by its name."""
    for value in as_mapping(task.get("data"), "data").values():
        if not isinstance(value, str):
            continue
        address = urlsplit(value)
        place = PurePosixPath(parse_qs(address.query).get("d", [unquote(address.path)])[0])
        if place.suffix.lower() not in PICTURE_SUFFIXES:
            continue
        upload = UPLOAD.fullmatch(place.name)
        candidates = files.get(place.name) or (files.get(upload[1], []) if upload else [])
        if len(candidates) > 1:  # of several pictures of that name, the one that lies in the same folders
            called, tail = len(candidates), place.as_posix().lstrip("/")
            candidates = [path for path in candidates if f"/{tail}".endswith(f"/{path.relative_to(folder).as_posix()}")]
            if len(candidates) != 1:
                raise ValueError(f"{called} pictures below {folder} could be {place.name}, expected one")
        if not candidates:
            raise FileNotFoundError(f"no picture {short(place.name)} below {folder}")
        return candidates[0]
    raise ValueError(f"data names no picture, expected a name that ends in one of {', '.join(PICTURE_SUFFIXES)}")


def _read_boats(result: list[Mapping], size_px: tuple[int, int], kinds: set[str]) -> list[Labels]:
    """Put rectangles and keypoints together; the rectangles' labels are added to ``kinds``."""
    rectangles: dict[str, NDArray[np.float64]] = {}
    keypoints: list[Mapping] = []
    parents: dict[str, str] = {}
    hidden: set[str] = set()
    for region in result:
        kind, key = region.get("type"), str(region.get("id"))
        if kind == "rectanglelabels":
            if key in rectangles:
                raise ValueError(f"a second rectangle with the id {key}")
            rectangles[key] = _box(_value(region, size_px, key), size_px, key)
            kinds.add(_label(region, "rectanglelabels", key))
        elif kind == "keypointlabels":
            keypoints.append(region)
        elif kind == "relation":
            ends = str(region.get("from_id")), str(region.get("to_id"))
            parents |= {ends[0]: ends[1], ends[1]: ends[0]}
        if _says_hidden(region):
            hidden.add(key)
    points = {key: np.zeros((NUM_KEYPOINTS, 3)) for key in rectangles}
    for region in keypoints:
        key = str(region.get("id"))
        value = _value(region, size_px, key)
        name = re.sub(r"[\s-]+", "_", _label(region, "keypointlabels", key).strip().lower())
        if name not in KEYPOINT_NAMES:
            raise ValueError(f"{key}: keypoint {short(name)}, expected one of {', '.join(KEYPOINT_NAMES)}")
        place = np.array([as_number(require(value, axis, key), f"{key}: {axis}") / 100 for axis in ("x", "y")])
        parent = str(region["parentID"]) if region.get("parentID") else parents.get(key)
        boat = points[_rectangle_of(key, name, place, parent, rectangles)]
        if boat[KEYPOINT_NAMES.index(name), 2]:
            raise ValueError(f"{key}: a second {name} of one rectangle")
        boat[KEYPOINT_NAMES.index(name)] = (*place, 1 if key in hidden else 2)
    return [to_boat(*keep_inside(box, points[key]), size_px) for key, box in rectangles.items()]


def _value(region: Mapping, size_px: tuple[int, int], key: str) -> Mapping:
    """The numbers of a region, once its picture is known to be the one that lies here."""
    found = tuple(region.get(name) for name in ("original_width", "original_height"))
    if found != size_px:
        raise ValueError(f"{key}: original size is {short(found)}, but the picture is {size_px[0]} x {size_px[1]}")
    if region.get("image_rotation"):
        turned = short(region["image_rotation"])
        raise ValueError(f"{key}: image_rotation is {turned}, expected 0: the picture as it comes")
    return as_mapping(region.get("value"), f"{key}: value")


def _label(region: Mapping, kind: str, key: str) -> str:
    names: Any = region["value"].get(kind)
    if not isinstance(names, list) or len(names) != 1 or not isinstance(names[0], str):
        raise ValueError(f"{key}: {kind} is {short(names)}, expected one label")
    return names[0]


def _says_hidden(region: Mapping) -> bool:
    """Whether a choice or a note of the region says so."""
    value, meta = region.get("value"), region.get("meta")
    chosen = value.get("choices") if region.get("type") == "choices" and isinstance(value, dict) else None
    noted = meta.get("text") if isinstance(meta, dict) else None
    said = [words for some in (chosen, noted) for words in (some if isinstance(some, list) else [some])]
    return any(isinstance(words, str) and words.strip().lower() == HIDDEN for words in said)


def _box(value: Mapping, size_px: tuple[int, int], key: str) -> NDArray[np.float64]:
    """The upright box (4,) around a turned rectangle, as fractions: centre x, centre y, width, height."""
    names = ("x", "y", "width", "height")
    x, y, width, height = (as_number(require(value, name, key), f"{key}: {name}") for name in names)
    if width <= 0 or height <= 0:
        raise ValueError(f"{key}: rectangle of {width:g} x {height:g} %, expected a width and a height above 0")
    angle_rad = math.radians(as_number(value.get("rotation", 0), f"{key}: rotation"))
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    size = np.array(size_px) / 100
    sides_px = np.array([(0, 0), (width, 0), (width, height), (0, height)]) * size
    corners = (sides_px @ np.array([(cos, sin), (-sin, cos)]) + np.array((x, y)) * size) / np.array(size_px)
    low, high = corners.min(0), corners.max(0)
    return np.concatenate(((low + high) / 2, high - low))


def _rectangle_of(
    key: str, name: str, place: NDArray[np.float64], parent: str | None, rectangles: dict[str, NDArray[np.float64]]
) -> str:
    """The rectangle that a keypoint (2,) belongs to."""
    if parent is not None:
        if parent not in rectangles:
            raise ValueError(f"{key}: {name} belongs to {short(parent)}, expected a rectangle of the same annotation")
        return parent
    around = [other for other, box in rectangles.items() if (np.abs(place - box[:2]) <= box[2:] / 2 + TOLERANCE).all()]
    if len(around) != 1:
        advice = "drag it onto its rectangle in the list of regions"
        raise ValueError(f"{key}: {name} lies in {len(around)} rectangles, expected one: {advice}")
    return around[0]
