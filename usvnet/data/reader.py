"""Reading a dataset folder into frames: pictures, labels, cameras, attitudes and laser ranges put together.

- ``data.yaml``: train, val, test, each a folder below ``images/`` or a COCO file ``*.json``.
- ``images/<split>/*.jpg`` and, unless COCO, ``labels/<split>/*.txt``.
- ``cameras/*.yaml``: one for all pictures, or several and a column ``camera`` in frames.csv.
- ``ranges.csv``, optional: what the laser read.
- ``frames.csv``, optional: camera, hull, scene, time and measured attitude of each picture.
- ``imu.csv``, optional: the measured attitude by time.
- ``hulls/*.yaml``, optional: one for all pictures, or several and a column ``hull`` in frames.csv. A picture without
  gets a generic hull.
"""

from pathlib import Path

import numpy as np

from usvnet.data.attitudes import FROM_FILES, AttitudeConfig, fill_from_imu, noted_camera
from usvnet.data.formats.coco import read_coco
from usvnet.data.formats.ranges import FrameNotes, read_tables
from usvnet.data.formats.yolo import read_data_yaml, read_label
from usvnet.data.picture_files import PICTURE_SUFFIXES, pictures_below
from usvnet.data.records import SPLITS, Faults, Frame, Labels
from usvnet.geometry.camera_files import load_camera
from usvnet.geometry.hull_files import load_hull
from usvnet.geometry.hull_model import generic_hull
from usvnet.types import NEAREST_WATERLINE, Camera, Hull


def read_dataset(
    root: Path | str, split: str, faults: Faults | None = None, attitude: AttitudeConfig = FROM_FILES
) -> list[Frame]:
    """Read the frames of one split, in the order of their names.

    Pictures are not opened: their size is their camera's, and is checked when they are decoded.

    Args:
        root: the folder that holds data.yaml.
        split: ``train``, ``val`` or ``test``.
        faults: where to note what is wrong; by default the first fault is raised.
        attitude: where pitch and roll come from; the horizon is looked for later
            (:func:`usvnet.data.attitudes.see_horizons`).

    Raises:
        FileNotFoundError: no data.yaml, or no such folder.
        ValueError: naming the file and the line that is wrong.
    """
    root = Path(root)
    faults = Faults() if faults is None else faults
    splits = read_data_yaml(root / "data.yaml")
    if split not in splits:
        raise ValueError(f"{root / 'data.yaml'}: no split '{split}', expected one of {', '.join(splits or SPLITS)}")
    cameras = read_cameras(root / "cameras", faults)
    hulls = read_hulls(root / "hulls", faults)
    notes = read_tables(root, faults)
    with faults.catch():
        fill_from_imu(root, notes, attitude)
    for name, picture in notes.items():
        with faults.catch():
            if not (root / "images" / name).is_file():
                raise FileNotFoundError(f"{picture.line}: no picture {root / 'images' / name}")
    place = root / splits[split]
    coco = read_coco(place, faults) if place.suffix == ".json" else None
    names = sorted(coco) if coco is not None else _picture_names(root, place, faults)
    if not names:
        raise ValueError(f"{place}: no pictures, expected some {', '.join(PICTURE_SUFFIXES)}")
    frames: list[Frame] = []
    for name in names:
        with faults.catch():
            image_path = root / "images" / name
            if not image_path.is_file():
                raise FileNotFoundError(f"{place}: no picture {image_path}")
            note = notes.get(name, FrameNotes())
            camera = _camera_of(root, name, note, cameras)
            if attitude.source != "mount":
                camera = noted_camera(camera, note)
            hull = _hull_of(root, note, hulls)
            width, height = camera.size_px[0].round().int().tolist()
            noted = len(faults.sentences)
            if coco is None:
                label_path = (root / "labels" / name).with_suffix(".txt")
                labels = read_label(label_path, (width, height), faults)
            else:
                label_path = place
                labels, size_px = coco[name]
                if size_px != (width, height):
                    expected = f"{width} x {height} as its camera"
                    raise ValueError(f"{place}: {name} is {size_px[0]} x {size_px[1]}, expected {expected}")
            if len(faults.sentences) == noted:
                frames.append(_frame(image_path, name, note, camera, hull, labels, label_path))
    return frames


def read_cameras(folder: Path, faults: Faults) -> dict[str, Camera]:
    """Read every camera file of a folder, by file name without its ending.

    Raises:
        ValueError: there is none, or one cannot be read.
    """
    paths = sorted(path for path in folder.glob("*") if path.suffix in (".yaml", ".yml"))
    if not paths:
        raise FileNotFoundError(f"{folder}: no camera file, expected at least one *.yaml")
    cameras = {}
    for path in paths:
        with faults.catch():
            cameras[path.stem] = load_camera(path)
    return cameras


def read_hulls(folder: Path, faults: Faults) -> dict[str, Hull]:
    """Read every hull file of a folder, if there are any, by file name without its ending."""
    hulls = {}
    for path in sorted(path for path in folder.glob("*") if path.suffix in (".yaml", ".yml")):
        with faults.catch():
            hulls[path.stem] = load_hull(path)
    return hulls


def _picture_names(root: Path, folder: Path, faults: Faults) -> list[str]:
    """List the pictures of a folder by their path below images/, and complain of labels without a picture."""
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder, named in {root / 'data.yaml'}")
    images = root / "images"
    paths = [path.relative_to(images) for path in pictures_below(folder)]
    stems = {path.with_suffix("") for path in paths}
    labels = root / "labels"
    for path in sorted((labels / folder.relative_to(images)).rglob("*.txt")):
        with faults.catch():
            if path.relative_to(labels).with_suffix("") not in stems:
                raise FileNotFoundError(f"{path}: a label without its picture below {folder}")
    return sorted(path.as_posix() for path in paths)


def _camera_of(root: Path, name: str, note: FrameNotes, cameras: dict[str, Camera]) -> Camera:
    """Choose the picture's camera, as it is mounted."""
    known = f"expected one of {', '.join(cameras)} (the files in {root / 'cameras'})"
    table = root / "frames.csv"
    if note.camera is None and len(cameras) != 1:
        if not table.is_file():  # one sentence for all pictures
            raise FileNotFoundError(f"{table}: no such file, which names the camera of every picture, {known}")
        raise ValueError(f"{table}: no camera for {name}, {known}")
    key = note.camera or next(iter(cameras))
    if key not in cameras:
        raise ValueError(f"{table}: camera {key} is named, {known}")
    return cameras[key]


def _hull_of(root: Path, note: FrameNotes, hulls: dict[str, Hull]) -> Hull:
    """Choose the picture's hull: the one named, else the only one there is, else a generic one."""
    if note.hull is None:
        return next(iter(hulls.values())) if len(hulls) == 1 else generic_hull()
    if note.hull not in hulls:
        known = f"expected one of {', '.join(hulls)}" if hulls else "but there is no hull file"
        raise ValueError(f"{root / 'frames.csv'}: hull {note.hull} is named, {known} (in {root / 'hulls'})")
    return hulls[note.hull]


def _frame(
    image_path: Path, name: str, note: FrameNotes, camera: Camera, hull: Hull, labels: Labels, label_path: Path
) -> Frame:
    """Put the laser's readings beside the boats they belong to."""
    boats = len(labels.boxes_px)
    range_m, range_std_m = np.zeros(boats), np.zeros(boats)
    reference = np.full(boats, NEAREST_WATERLINE, np.int64)
    for i, reading in note.readings.items():
        if i >= boats:
            raise ValueError(f"{note.line}: a range for instance {i}, but {label_path} has {boats} boats in {name}")
        range_m[i], range_std_m[i], reference[i] = reading.range_m, reading.range_std_m, reading.reference
    return Frame(image_path, name, note.scene, camera, *labels, range_m, range_std_m, reference, hull)
