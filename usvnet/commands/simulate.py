"""``usvnet simulate``: a dataset of rendered boats on water with exact labels."""

from pathlib import Path
from typing import Literal

from rich.console import Console

from usvnet.commands.simulated_dataset import write_dataset_files
from usvnet.commands.simulation_sheet import draw_contact_sheet
from usvnet.simulator.engine import check_installed, choose_engine, slow_engine_notice
from usvnet.simulator.engine import doctor as examine_machine
from usvnet.simulator.run import RENDERER, Summary, simulate_dataset
from usvnet.types import Camera
from usvnet.wording import counted

SHEET = "contact_sheet.png"
SHOWN_FAILURES = 8


def simulate(
    *,
    config: str = "",
    out: str = "",
    workers: int | None = None,
    quality: Literal["preview", "standard", "high"] = "standard",
    frames: int | None = None,
    only: str | None = None,
    scale: float = 1.0,
    doctor: bool = False,
) -> None:
    """Render a dataset: pictures, labels, cameras, hulls, laser ranges and everything else that is true of them.

    A run that was stopped, by Ctrl-C or otherwise, goes on when the same command is given again, and ends with the
    same files as one that was not.

    Args:
        config: Settings of the dataset, such as one of configs/simulator/.
        out: Folder to write, new or of an earlier run with the same settings.
        workers: Processes that render, one thread and about 1.5 GB of memory each; one for each processor if left out.
        quality: preview is for looking at scenes, standard for training, high for figures.
        frames: Render a sample of so many frames, evenly over splits and scenes; a later run can add to it.
        only: Render these frames again, by their numbers, e.g. 17 or 3,17,20-25.
        scale: Make pictures smaller (0.5 is half as wide and high) or larger; the cameras are changed with them.
        doctor: Say what rendering uses on this machine and how it can be made faster, and do nothing else.

    Raises:
        ValueError: an option or a setting is wrong, a package is missing, or a frame could not be rendered.
        FileNotFoundError: no such settings file.
    """
    console = Console(soft_wrap=True, highlight=False, markup=False)
    if doctor:
        for line in examine_machine():
            console.print(line)
        return
    for name, value in (("--config", config), ("--out", out)):
        if not value:
            raise ValueError(f"{name} is missing (see usvnet simulate --help)")
    check_installed()
    engine = choose_engine()
    if notice := slow_engine_notice(engine):
        console.print(f"note: {notice}")
    summary = simulate_dataset(
        Path(config),
        Path(out),
        finish_dataset,
        engine=engine,
        quality=quality,
        scale=scale,
        workers=workers,
        frames=frames,
        only=only,
        render=RENDERER,
        console=console,
    )
    _tell(console, summary, out)
    if summary.failed:
        shown = ", ".join(str(number) for number in sorted(summary.failed)[:SHOWN_FAILURES])
        more = " ..." if len(summary.failed) > SHOWN_FAILURES else ""
        failed = f"{len(summary.failed)} of {counted(summary.asked, 'frame')} failed"
        raise ValueError(f"{failed} ({shown}{more}): the same command tries them again, the others are in {out}")


def finish_dataset(root: Path, cameras: dict[str, Camera]) -> None:
    """Make a dataset of the frames that are whole, with a picture of it."""
    write_dataset_files(root, cameras)
    draw_contact_sheet(root, root / SHEET)


def _tell(console: Console, summary: Summary, out: str) -> None:
    before = f", {counted(summary.whole, 'was', 'were')} there before" if summary.whole else ""
    console.print(f"{summary.rendered} of {counted(summary.asked, 'frame')} rendered{before}")
    if summary.rendered and summary.seconds:
        steps = ", ".join(f"{step} {seconds / summary.rendered:.2f}" for step, seconds in summary.seconds.items())
        console.print(f"processor seconds a frame: {sum(summary.seconds.values()) / summary.rendered:.1f} ({steps})")
    console.print(f"look at {Path(out) / SHEET}; usvnet check-data {out} counts and checks it")
