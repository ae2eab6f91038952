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
from numpy.typing import NDArray

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

    What a split is owed of one scene, for there are no halves of pictures, it gets of the next. Of three pictures or
    more, every split with a share gets one.

    Consecutive frames of one video resemble each other: where they fall into several splits, a network is judged on
    what it has nearly seen. Give such data its splits by folder (``train``, ``val``, ``test``) instead.
    """
    scenes: dict[str | None, list[LabelledPicture]] = defaultdict(list)
    for picture in sorted(pictures, key=lambda picture: picture.name):
        scenes[picture.scene].append(picture)
    generator = np.random.default_rng(seed)
    splits: dict[str, list[LabelledPicture]] = {split: [] for split in SPLITS}
    parts = np.asarray(shares) / np.sum(shares)
    dealt = np.zeros(len(SPLITS), int)
    for members in scenes.values():
        order = generator.permutation(len(members))
        got = _portions(parts * (dealt.sum() + len(members)) - dealt, len(members))
        dealt += got
        for split, chosen in zip(SPLITS, np.split(order, np.cumsum(got)[:-1])):
            splits[split] += [members[i] for i in sorted(chosen)]
    for split, part in zip(SPLITS, parts):
        if part > 0 and not splits[split] and len(pictures) >= len(SPLITS):
            splits[split].append(max(splits.values(), key=len).pop())
    return splits


def _portions(owed: NDArray[np.float64], pictures: int) -> NDArray[np.int64]:
    """Whole numbers of pictures for the splits: one after another to whom most is owed."""
    got = np.zeros(len(owed), np.int64)
    for _ in range(pictures):
        got[np.argmax((owed - got).round(9))] += 1  # rounded: of two that are owed the same, the first
    return got


def keep_splits(pictures: Sequence[LabelledPicture]) -> dict[str, list[LabelledPicture]] | None:
    """The splits that the export has; None where it has fewer than two.

    Raises:
        ValueError: it has several, and a picture of none.
    """
    splits: dict[str, list[LabelledPicture]] = {split: [] for split in SPLITS}
    for picture in pictures:
        if picture.split is not None:
            splits[picture.split].append(picture)
    named = [split for split, members in splits.items() if members]
    if len(named) < 2:
        return None
    for picture in pictures:
        if picture.split is None:
            raise ValueError(
                f"{picture.path}: in no split, while other pictures are in {' and '.join(named)}: expected one of "
                f"{', '.join(SPLITS)}, or deal all anew with --split"
            )
    return splits


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
