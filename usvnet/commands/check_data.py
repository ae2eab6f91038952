"""``usvnet check-data``: what is in a dataset, and every fault in it."""

from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import track

from usvnet.commands.dataset_report import camera_table, draw_labels, scene_table, size_table, split_table
from usvnet.data.check import check_dataset


def check_data(directory: str, *, output: str = "labels.png") -> None:
    """Count a dataset, draw its statistics and name every fault with file and line.

    Args:
        directory: the folder that holds data.yaml.
        output: the picture of the label statistics to write (a PNG).

    Raises:
        ValueError: there are faults; each has been printed.
        FileNotFoundError: no such dataset.
    """
    console = Console()
    if Path(output).suffix != ".png":
        raise ValueError(f"--output is {output}, expected a file name that ends in .png")
    frames, faults = check_dataset(Path(directory), partial(track, description="pictures", console=console))
    for table in (split_table(frames), scene_table(frames), camera_table(frames), size_table(frames)):
        console.print(table)
    if any(frames.values()):
        draw_labels([frame for split in frames.values() for frame in split], Path(output))
        console.print(f"label statistics: {output}", markup=False, soft_wrap=True)
    for fault in faults:
        console.print(f"fault: {fault}", markup=False, highlight=False, soft_wrap=True)
    if faults:
        raise ValueError(f"{len(faults)} {'fault' if len(faults) == 1 else 'faults'} in {directory}")
