"""``usvnet check-data``: what is in a dataset, and every fault in it."""

from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import track

from usvnet.commands.dataset_report import Splits, camera_table, draw_labels, scene_table, size_table, split_table
from usvnet.data.check import check_dataset, check_export
from usvnet.data.conversion import TITLES, detect_format
from usvnet.data.formats.ranges import FrameNotes, read_tables
from usvnet.data.reader import read_cameras
from usvnet.data.records import Faults, Frame
from usvnet.wording import counted


def check_data(directory: str, *, output: str = "labels.png") -> None:
    """Count a dataset, draw its statistics and name every fault with file and line.

    Also takes what usvnet convert reads, an export of CVAT or Label Studio or a folder of pictures by scene, to look at
    before it is converted.

    Args:
        directory: the folder that holds data.yaml, or an export.
        output: the picture of the label statistics to write (a PNG).

    Raises:
        ValueError: there are faults; each has been printed.
        FileNotFoundError: no such dataset.
    """
    console = Console()
    if Path(output).suffix != ".png":
        raise ValueError(f"--output is {output}, expected a file name that ends in .png")
    root, follow = Path(directory), partial(track, description="pictures", console=console)
    kind = detect_format(root)
    splits: Splits
    if kind is None:
        frames, faults = check_dataset(root, follow)
        splits = frames
        names = camera_names(root, frames)
        tables = [split_table(frames), scene_table(frames), camera_table(frames, names), size_table(frames)]
    else:
        splits, faults = check_export(root, kind, follow)
        console.print(f"{TITLES[kind]}: turn it into a dataset with usvnet convert")
        tables = [split_table(splits), scene_table(splits), size_table(splits)]
    if any(splits.values()):
        for table in tables:
            console.print(table)
        draw_labels([picture for members in splits.values() for picture in members], Path(output))
        console.print(f"label statistics: {output}", markup=False, soft_wrap=True)
    for fault in faults:
        console.print(f"fault: {fault}", markup=False, highlight=False, soft_wrap=True)
    if faults:
        raise ValueError(f"{counted(len(faults), 'fault')} in {directory}")


def camera_names(root: Path, frames: dict[str, list[Frame]]) -> dict[str, str]:
    """The name of the camera by the name of the picture: what frames.csv says, or that of the only camera file."""
    known = Faults(collect=True)  # they have been told already
    notes, cameras = read_tables(root, known), read_cameras(root / "cameras", known)
    names = [frame.name for members in frames.values() for frame in members]
    return {name: notes.get(name, FrameNotes()).camera or next(iter(cameras)) for name in names}
