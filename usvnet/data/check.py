"""Reading a whole dataset with open eyes: every frame that is sound, and every fault."""

from collections.abc import Callable, Iterable
from pathlib import Path

from usvnet.data.conversion import Format, open_export
from usvnet.data.formats.exports import Follow, LabelledPicture
from usvnet.data.formats.yolo import read_data_yaml
from usvnet.data.pictures import PictureCache
from usvnet.data.reader import read_dataset
from usvnet.data.records import Faults, Frame


def check_dataset(
    root: Path, follow: Callable[[list[Frame]], Iterable[Frame]] = iter
) -> tuple[dict[str, list[Frame]], list[str]]:
    """Read every split of a dataset and decode every picture of it.

    Args:
        root: the folder that holds data.yaml.
        follow: wraps the frames whose pictures are being decoded, to show how far it is.

    Returns:
        The sound frames by split, and one sentence for each fault.

    Raises:
        FileNotFoundError: no data.yaml.
        ValueError: data.yaml itself is faulty, or names no split.
    """
    faults = Faults(collect=True)
    splits = read_data_yaml(root / "data.yaml")
    if not splits:
        raise ValueError(f"{root / 'data.yaml'}: no split, expected train, val or test")
    frames: dict[str, list[Frame]] = {split: [] for split in splits}
    for split in splits:
        with faults.catch():
            frames[split] = read_dataset(root, split, faults)
    decoder = PictureCache(budget_mb=0, longest_px=2**16)
    for frame in follow([frame for split in splits for frame in frames[split]]):
        with faults.catch():
            decoder.read(frame.image_path, frame.size_px)
    return frames, faults.sentences


def check_export(
    source: Path, kind: Format, follow: Follow = iter
) -> tuple[dict[str, list[LabelledPicture]], list[str]]:
    """Read another tool's export and decode every picture of it.

    Args:
        source: the file or folder.
        kind: which tool wrote it.
        follow: wraps the pictures while they are read, to show how far it is.

    Returns:
        The sound pictures by split ("none" where the export says none), and one sentence for each fault.
    """
    faults = Faults(collect=True)
    splits: dict[str, list[LabelledPicture]] = {}
    with faults.catch(), open_export(source, kind, faults, follow) as export:
        for picture in export.pictures:
            splits.setdefault(picture.split or "none", []).append(picture)
    return splits, faults.sentences
