"""CVAT's export "Ultralytics YOLO Pose 1.0" with its pictures: the zip, or the folder that it unpacks to.

- ``data.yaml``: ``kpt_shape`` (number of points in the skeleton, 3 for x, y, visibility), ``names`` (number to label,
  of the whole task, in use or not), and for each split the name of a list: ``train: train.txt``.
- ``train.txt``: a picture a line, ``images/train/<name>``, in some versions with ``data/`` before it.
- ``images/train/<name>.jpg`` ("Save images" must be ticked) and ``labels/train/<name>.txt``; tools that CVAT keeps
  apart from write ``train/images`` and ``train/labels``.

Coordinates are fractions of the picture, and may lie outside it where the skeleton does. The export does not name the
points: they stand in the order in which the skeleton was drawn, which must be that of
:data:`usvnet.types.KEYPOINT_NAMES`.
"""

import contextlib
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

from usvnet.data.formats.exports import (
    KEYPOINT_ORDER_NOTE,
    Export,
    Follow,
    LabelledPicture,
    picture_size,
    read_text_labels,
    refuse_several_classes,
)
from usvnet.data.records import SPLITS, Faults
from usvnet.geometry.yaml_files import read_mapping, short
from usvnet.types import NUM_KEYPOINTS

ZIP_FAILURES = (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError, ValueError, LookupError)
"""What zipfile raises for an archive that is damaged, cut short, locked or packed in an unknown way."""


@contextlib.contextmanager
def unpacked(path: Path, faults: Faults) -> Iterator[Path]:
    """Yield the folder that holds data.yaml: ``path`` itself, or where a zip is unpacked until the block ends.

    Sentences about a file in the zip (raised, or noted in ``faults``) name it below ``path``.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the zip is damaged, or larger than the space left for it.
    """
    if path.is_dir():
        yield path
        return
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file, expected a zip or a folder")
    with tempfile.TemporaryDirectory(prefix="usvnet-") as name:
        folder = Path(name)
        _unpack(path, folder)
        children = [child for child in folder.iterdir() if child.name != "__MACOSX" and child.name[0] != "."]
        root = children[0] if len(children) == 1 and children[0].is_dir() else folder
        try:
            yield root
        except (ValueError, OSError) as error:
            raise ValueError(str(error).replace(str(root), str(path))) from None
        finally:
            faults.sentences[:] = [sentence.replace(str(root), str(path)) for sentence in faults.sentences]


def _unpack(path: Path, folder: Path) -> None:
    try:
        with zipfile.ZipFile(path) as archive:
            size_bytes = sum(member.file_size for member in archive.infolist())
            free_bytes = shutil.disk_usage(folder).free
            if size_bytes < free_bytes:
                archive.extractall(folder)
    except (*ZIP_FAILURES, OSError) as error:
        raise ValueError(f"{path}: not a zip that can be unpacked: {error}") from error
    if size_bytes >= free_bytes:
        needed = f"unpacks to {size_bytes / 1e9:.1f} GB"
        raise ValueError(f"{path}: {needed}, but only {free_bytes / 1e9:.1f} GB are free in {folder.parent}")


def read_cvat(folder: Path, faults: Faults, follow: Follow = iter) -> Export:
    """Read the pictures of an unpacked export.

    Args:
        folder: holds data.yaml.
        faults: where to note what is wrong; without ``collect`` the first fault is raised.
        follow: wraps the pictures while they are read.

    Raises:
        FileNotFoundError: no data.yaml, list or picture.
        ValueError: naming file and line or key.
    """
    path = folder / "data.yaml"
    content = read_mapping(path)
    shape = content.get("kpt_shape")
    if shape not in ([NUM_KEYPOINTS, 3], [NUM_KEYPOINTS, 2]):
        expected = f"[{NUM_KEYPOINTS}, 3]: one skeleton of {NUM_KEYPOINTS} points"
        raise ValueError(f"{path}: kpt_shape is {short(shape)}, expected {expected}")
    names = _class_names(content.get("names"), path)
    listed = [entry for split in SPLITS if split in content for entry in _listed(folder, split, content[split], faults)]
    if not listed:
        raise ValueError(f"{path}: no pictures listed, expected a line such as 'train: train.txt'")
    pictures: list[LabelledPicture] = []
    classes: set[int] = set()
    labelled = False
    for split, where, line in follow(listed):
        with faults.catch():
            image_path = _find_picture(folder, where, line)
            relative = image_path.relative_to(folder)
            label_path = (folder / _swap(relative, "images", "labels")).with_suffix(".txt")
            labelled |= label_path.is_file()
            size_px = picture_size(image_path)
            noted = len(faults.sentences)
            labels, kinds = read_text_labels(label_path, size_px, faults)
            classes |= kinds
            name = PurePosixPath(*(part for part in relative.parts if part not in ("images", split)))
            if len(faults.sentences) == noted:
                pictures.append(LabelledPicture(image_path, str(name), split, None, size_px, labels))
    with faults.catch():
        refuse_several_classes(f"{path}", classes, names)
        if not labelled:
            raise ValueError(f"{folder}: no labels/*/*.txt, expected CVAT's export 'Ultralytics YOLO Pose 1.0'")
    return Export(pictures, [KEYPOINT_ORDER_NOTE])


def _class_names(names: Any, path: Path) -> dict[int, str]:
    """Labels by number; a list counts from 0."""
    pairs = enumerate(names) if isinstance(names, list) else names.items() if isinstance(names, dict) else ()
    found = {number: short(name).strip("'") for number, name in pairs if isinstance(number, int)}
    if not found:
        raise ValueError(f"{path}: names is {short(names)}, expected labels by number, for instance {{0: usv}}")
    return found


def _listed(folder: Path, split: str, place: Any, faults: Faults) -> list[tuple[str, str, str]]:
    """The split, the place for messages and the text of every line of a list of pictures."""
    path = folder / place if isinstance(place, str) and place.endswith(".txt") else None
    if path is None or ".." in path.parts:
        raise ValueError(f"{folder / 'data.yaml'}: {split} is {short(place)}, expected a list such as {split}.txt")
    if not path.is_file():
        with faults.catch():
            raise FileNotFoundError(f"{path}: no such file, but {folder / 'data.yaml'} names it")
        return []
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    return [(split, f"{path}:{number}", line.strip()) for number, line in enumerate(lines, start=1) if line.strip()]


def _find_picture(folder: Path, where: str, line: str) -> Path:
    """The picture that a line of a list names."""
    name = PurePosixPath(line)
    if name.is_absolute() or ".." in name.parts:
        raise ValueError(f"{where}: {short(line)}, expected a picture inside the export")
    parts = name.parts[1:] if name.parts[:1] == ("data",) and not (folder / name).is_file() else name.parts
    path = folder.joinpath(*parts)
    if "images" not in parts[:-1]:
        raise ValueError(f"{where}: {short(line)}, expected a picture below images/")
    if not path.is_file():
        raise FileNotFoundError(f"{where}: no picture {path}, export again with 'Save images'")
    return path


def _swap(path: Path, old: str, new: str) -> Path:
    """Put another name in the place of the first folder called ``old``."""
    at = path.parts.index(old)
    return Path(*path.parts[:at], new, *path.parts[at + 1 :])
