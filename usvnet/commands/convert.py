"""``usvnet convert``: what labelling tools export, as a dataset folder."""

from functools import partial
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.progress import track

from usvnet.commands.dataset_report import scene_table, split_table
from usvnet.data.conversion import TITLES, detect_format, keep_splits, open_export, share_out, write_dataset
from usvnet.data.records import SPLITS, Faults
from usvnet.files import expect_new_folder

DEFAULT_SPLIT = "0.7,0.2,0.1"


def convert(
    source: Path,
    *,
    output: Path,
    camera: Path | None = None,
    pictures: Path | None = None,
    format: Literal["auto", "cvat", "labelstudio", "folder"] = "auto",
    split: str | None = None,
    seed: int = 0,
) -> None:
    """Turn an export of CVAT or Label Studio, or a folder of pictures by scene, into a dataset folder.

    Reads CVAT's "Ultralytics YOLO Pose" with its pictures (the zip, or unpacked), Label Studio's JSON export with
    rectangles and keypoints, and a folder of pictures with YOLO-pose text files and a table of laser ranges. The
    dataset appears when all of it is sound; pictures are copied.

    Args:
        source: Zip, JSON file or folder.
        output: Dataset folder to write; there must be nothing yet.
        camera: Camera file of usvnet calibrate, if all pictures are of one camera.
        pictures: Folder of Label Studio's pictures, if they do not lie beside the JSON file.
        format: Which tool it comes from, where that cannot be seen.
        split: Shares of train, val and test; by default the splits of the source, or 0.7,0.2,0.1 where it has none.
        seed: Of the draw of the pictures to splits.

    Raises:
        FileNotFoundError: no such file, or one that it names.
        ValueError: something in it is not as expected; nothing is written.
    """
    shares = _shares(split or DEFAULT_SPLIT)
    expect_new_folder(output)
    if not source.exists():
        raise FileNotFoundError(f"{source}: no such file or folder")
    kind = detect_format(source) if format == "auto" else format
    if kind is None:
        what = "a dataset already" if (source / "data.yaml").is_file() else "nothing that is known"
        raise ValueError(f"{source}: {what}, expected {', '.join(TITLES.values())}")
    if pictures is not None and kind != "labelstudio":
        raise ValueError(f"--pictures is {pictures}, but {TITLES[kind]} says itself where its pictures lie")
    console = Console(stderr=True)
    follow = partial(track, description="reading", console=console)
    with open_export(source, kind, Faults(), follow, pictures) as export:
        kept = keep_splits(export.pictures) if split is None else None
        splits = kept or share_out(export.pictures, shares, seed)
        write_dataset(splits, output, camera, partial(track, description="copying", console=console))
    printed = Console()
    for table in (split_table(splits), scene_table(splits)):
        printed.print(table)
    for note in export.notes:
        print(f"note: {note}")
    print(f"wrote {output} from {TITLES[kind]}")
    if camera is None:
        print(f"next: make the folder {output / 'cameras'} with the camera file in it, then usvnet check-data {output}")
    else:
        print(f"next: usvnet check-data {output}")


def _shares(text: str) -> list[float]:
    """Read ``0.7,0.2,0.1``."""
    try:
        shares = [float(word) for word in text.strip("[]").split(",")]
    except ValueError:
        shares = []
    if len(shares) != len(SPLITS) or not all(0 <= share <= 1 for share in shares) or abs(sum(shares) - 1) > 1e-6:
        raise ValueError(f"--split is {text}, expected three shares that add up to 1, such as {DEFAULT_SPLIT}")
    return shares
