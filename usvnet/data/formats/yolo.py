"""Ultralytics YOLO-pose: ``data.yaml`` and one text file of boats per picture.

A line is ``class cx cy w h`` and seven times ``x y v``, as fractions of the picture
(:mod:`usvnet.data.formats.fractions`).
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import yaml

from usvnet.data.formats.fractions import from_boat, to_boat
from usvnet.data.records import SPLITS, Faults, Frame, Labels
from usvnet.files import atomic_write
from usvnet.geometry.yaml_files import read_mapping, short
from usvnet.types import FLIP_INDEX, KEYPOINT_NAMES, NUM_KEYPOINTS

VALUES_A_LINE = 5 + 3 * NUM_KEYPOINTS


def read_data_yaml(path: Path) -> dict[str, str]:
    """Read where each split lies, relative to data.yaml: a folder below ``images/`` or a COCO file ``*.json``.

    Keys that have no meaning here (``path``, ``nc``, ...) are left alone.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a key is missing or says that keypoints, their order or the classes are not ours.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file, expected a dataset folder with a data.yaml")
    content = read_mapping(path)
    expected: dict[str, object] = {"kpt_shape": [NUM_KEYPOINTS, 3]}
    if "flip_idx" in content:
        expected["flip_idx"] = list(FLIP_INDEX)
    if "kpt_names" in content:
        expected["kpt_names"] = {0: list(KEYPOINT_NAMES)}
    for key, value in expected.items():
        if content.get(key) != value:
            raise ValueError(f"{path}: {key} is {short(content.get(key))}, expected {value}")
    names = content.get("names")
    if not isinstance(names, dict | list) or len(names) != 1:
        raise ValueError(f"{path}: names is {short(names)}, expected one class, for instance {{0: usv}}")
    splits = {split: content[split] for split in SPLITS if content.get(split) is not None}
    for split, place in splits.items():
        if not isinstance(place, str) or not (place.endswith(".json") or Path(place).parts[:1] == ("images",)):
            found = place if isinstance(place, str) else short(place)
            raise ValueError(f"{path}: {split} is {found}, expected a folder below images/ or a COCO file *.json")
    return splits


def write_data_yaml(path: Path, splits: dict[str, str]) -> None:
    """Write the data.yaml that :func:`read_data_yaml` and Ultralytics read."""
    content = {
        **splits,
        "names": {0: "usv"},
        "kpt_shape": [NUM_KEYPOINTS, 3],
        "flip_idx": list(FLIP_INDEX),
        "kpt_names": {0: list(KEYPOINT_NAMES)},
    }
    with atomic_write(path) as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None), encoding="utf-8")


def parse_line(line: str, size_px: tuple[int, int]) -> Labels:
    """Turn one line into the labels of one boat.

    Raises:
        ValueError: without the file's name, which the caller knows.
    """
    words = line.split()
    if len(words) != VALUES_A_LINE:
        keypoints = (len(words) - 5) / 3
        found = f"{keypoints:.0f} keypoints" if keypoints >= 0 and keypoints.is_integer() else "a broken row"
        raise ValueError(f"{len(words)} values ({found}), expected {VALUES_A_LINE} ({NUM_KEYPOINTS} keypoints)")
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        raise ValueError(f"'{' '.join(words)}' holds something that is not a number") from None
    if values[0] != 0:
        raise ValueError(f"class {words[0]}, expected 0 (the only class)")
    return to_boat(values[1:5], values[5:].reshape(NUM_KEYPOINTS, 3), size_px)


def read_label(path: Path, size_px: tuple[int, int], faults: Faults) -> Labels:
    """Read the boats of one picture; a missing or empty file is a picture without boats.

    Raises:
        ValueError: naming file and line (or noted in ``faults``).
    """
    boats: list[Labels] = []
    if path.is_file():
        for number, line in enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), start=1):
            if line.strip():
                with faults.catch():
                    try:
                        boats.append(parse_line(line, size_px))
                    except ValueError as error:
                        raise ValueError(f"{path}:{number}: {error}") from None
    return Labels.of(boats)


def format_line(boat: Labels, size_px: tuple[int, int]) -> str:
    """Write the labels of one boat as a line: the inverse of :func:`parse_line`, to 1e-9 of the picture."""
    box, points = from_boat(boat, size_px)
    return " ".join(f"{value:.9f}".rstrip("0").rstrip(".") for value in (0, *box, *points.ravel()))


def label_text(labels: Labels, size_px: tuple[int, int]) -> str:
    """Write the boats of one picture: a line each, nothing where there is none."""
    return "".join(format_line(labels.boat(i), size_px) + "\n" for i in range(len(labels.boxes_px)))


def write_yolo(frames: Iterable[Frame], folder: Path) -> None:
    """Write ``folder/<name>.txt`` for each frame, an empty file for a frame without boats."""
    for frame in frames:
        with atomic_write((folder / frame.name).with_suffix(".txt")) as temporary:
            temporary.write_text(label_text(frame.labels, frame.size_px), encoding="utf-8")
