"""From another tool's export to a dataset folder of ours: recognise it, share it out to splits, write it.

What is written is what :mod:`usvnet.data.reader` reads: ``images/``, ``labels/``, ``data.yaml``, and where there is
something to say ``cameras/``, ``ranges.csv`` and ``frames.csv`` (the scenes).
"""

import contextlib
import csv
import shutil
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from usvnet.data.formats.cvat import read_cvat, unpacked
from usvnet.data.formats.exports import Export, Follow, LabelledPicture
from usvnet.data.formats.label_studio import read_label_studio
from usvnet.data.formats.ranges import REFERENCES
from usvnet.data.formats.scene_folder import read_scene_folder
from usvnet.data.formats.yolo import label_text, write_data_yaml
from usvnet.data.picture_files import pictures_below
from usvnet.data.records import SPLITS, Faults
from usvnet.files import atomic_folder
from usvnet.geometry.camera_files import load_camera
from usvnet.geometry.yaml_files import read_mapping

Format = Literal["cvat", "labelstudio", "folder"]
TITLES: dict[Format, str] = {
    "cvat": "CVAT's Ultralytics YOLO Pose export",
    "labelstudio": "Label Studio's JSON export",
    "folder": "a folder of pictures by scene",
}


def detect_format(source: Path) -> Format | None:
    """Say which tool's export a path is; None for a dataset of ours, and for what nobody knows.

    Raises:
        ValueError: a data.yaml that cannot be read.
    """
    if source.is_file():
        return {".zip": "cvat", ".json": "labelstudio"}.get(source.suffix.lower())  # type: ignore[return-value]
    if (source / "data.yaml").is_file():
        content = read_mapping(source / "data.yaml")
        return "cvat" if any(str(content.get(split)).endswith(".txt") for split in SPLITS) else None
    return "folder" if pictures_below(source) else None


@contextlib.contextmanager
def open_export(
    source: Path, kind: Format, faults: Faults, follow: Follow = iter, pictures: Path | None = None
) -> Iterator[Export]:
    """Read an export; the pictures of a zip are on disk until the block ends.

    Args:
        source: the file or folder.
        kind: which tool wrote it.
        faults: where to note what is wrong; without ``collect`` the first fault is raised.
        follow: wraps the pictures while they are read.
        pictures: where the pictures of Label Studio lie; by default beside the JSON file.

    Raises:
        FileNotFoundError: no such file, or no such picture.
        ValueError: naming file and line or key.
    """
    if kind == "cvat":
        with unpacked(source, faults) as folder:
            yield read_cvat(folder, faults, follow)
    elif kind == "labelstudio":
        yield read_label_studio(source, pictures or source.parent, faults, follow)
    else:
        yield read_scene_folder(source, faults, follow)


def share_out(
    pictures: Sequence[LabelledPicture], shares: Sequence[float], seed: int
) -> dict[str, list[LabelledPicture]]:
    """Deal pictures to train, val and test by their shares, each scene for itself, drawn from ``seed``.

    Consecutive frames of one video resemble each other: where they fall into several splits, a network is judged on
    what it has nearly seen. Give such data its splits by folder (``train``, ``val``, ``test``) instead.
    """
    scenes: dict[str | None, list[LabelledPicture]] = defaultdict(list)
    for picture in sorted(pictures, key=lambda picture: picture.name):
        scenes[picture.scene].append(picture)
    generator = np.random.default_rng(seed)
    splits: dict[str, list[LabelledPicture]] = {split: [] for split in SPLITS}
    for members in scenes.values():
        order = generator.permutation(len(members))
        ends = np.round(np.cumsum(shares) / np.sum(shares) * len(members)).astype(int)
        for split, chosen in zip(SPLITS, np.split(order, ends[:-1])):
            splits[split] += [members[i] for i in sorted(chosen)]
    return splits


def keep_splits(pictures: Sequence[LabelledPicture]) -> dict[str, list[LabelledPicture]] | None:
    """The splits that the export has; None where it has fewer than two, or pictures of none."""
    splits: dict[str, list[LabelledPicture]] = {split: [] for split in SPLITS}
    for picture in pictures:
        if picture.split is None:
            return None
        splits[picture.split].append(picture)
    return splits if sum(map(bool, splits.values())) > 1 else None


def write_dataset(
    splits: dict[str, list[LabelledPicture]], output: Path, camera: Path | None = None, follow: Follow = iter
) -> None:
    """Write a dataset folder, whole or not at all; pictures are copied, not decoded again.

    Args:
        splits: by name; an empty one is left out.
        output: the folder to be.
        camera: the camera file of all pictures.
        follow: wraps the pictures while they are copied.

    Raises:
        ValueError: there is something at ``output``, two pictures of one name, or one that is not of the camera's size.
    """
    splits = {split: members for split, members in splits.items() if members}
    named = [(f"{split}/{picture.name}", picture) for split, members in splits.items() for picture in members]
    _refuse_clashes(named)
    if camera is not None:
        _refuse_other_sizes(named, camera)
    with atomic_folder(output) as folder:
        for name, picture in follow(named):
            for target in (folder / "images" / name, (folder / "labels" / name).with_suffix(".txt")):
                target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(picture.path, folder / "images" / name)
            text = label_text(picture.labels, picture.size_px)
            (folder / "labels" / name).with_suffix(".txt").write_text(text, encoding="utf-8")
        write_data_yaml(folder / "data.yaml", {split: f"images/{split}" for split in splits})
        if camera is not None:
            (folder / "cameras").mkdir()
            shutil.copyfile(camera, folder / "cameras" / camera.with_suffix(".yaml").name)
        references = {number: name for name, number in REFERENCES.items()}
        ranges = [
            (name, reading.range_m, reading.range_std_m or "", reading.instance, references[reading.reference])
            for name, picture in named
            for reading in picture.readings
        ]
        scenes = [(name, picture.scene) for name, picture in named if picture.scene is not None]
        _write_table(folder / "ranges.csv", ("image", "range_m", "range_std_m", "instance", "reference"), ranges)
        _write_table(folder / "frames.csv", ("image", "scene"), scenes)


def _refuse_clashes(named: list[tuple[str, LabelledPicture]]) -> None:
    """Insist that every picture has a name, and a label file, of its own."""
    known: dict[str, LabelledPicture] = {}
    for name, picture in named:
        other = known.setdefault(Path(name).with_suffix("").as_posix(), picture)
        if other is not picture:
            raise ValueError(f"{picture.path}: would share the label file of {other.path}, expected another name")


def _refuse_other_sizes(named: list[tuple[str, LabelledPicture]], camera: Path) -> None:
    width, height = (int(size) for size in load_camera(camera).size_px[0])
    for _, picture in named:
        if picture.size_px != (width, height):
            found = f"{picture.size_px[0]} x {picture.size_px[1]}"
            raise ValueError(f"{picture.path}: picture of {found}, expected {width} x {height} as {camera} says")


def _write_table(path: Path, header: tuple[str, ...], rows: Sequence[tuple[str | float | None, ...]]) -> None:
    """Write a table that has rows."""
    if rows:
        with path.open("w", newline="", encoding="utf-8") as stream:
            csv.writer(stream).writerows([header, *rows])
