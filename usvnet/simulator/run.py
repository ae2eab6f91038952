"""Rendering a dataset, or going on where an earlier run was stopped."""

import math
import os
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from rich.console import Console

from usvnet.files import alone_in
from usvnet.geometry.camera import scale_camera
from usvnet.simulator.dataset_writer import remove_leftovers, whole_frames
from usvnet.simulator.hulls.hull import build_hull
from usvnet.simulator.manifest import claim_folder, make_manifest
from usvnet.simulator.progress import FrameProgress
from usvnet.simulator.scenario import Scenario
from usvnet.simulator.selection import parse_numbers, spread_sample
from usvnet.simulator.settings import load_settings
from usvnet.simulator.workers import Job, Outcome, render_frames, scaled_size
from usvnet.types import Camera

Quality = Literal["preview", "standard", "high"]

RENDERER = "usvnet.simulator.frame.render_frame"
SMALLEST_PX = 32
LARGEST_SCALE = 4.0


@dataclass
class Summary:
    """What a run did."""

    asked: int
    """Frames that were asked for."""
    whole: int
    """Those of them that were whole before."""
    rendered: int = 0
    failed: list[int] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    """Processor time of each step, of all rendered frames together."""


Finish = Callable[[Path, dict[str, Camera]], object]
"""Makes a dataset of the whole frames in a folder, given the cameras by name as they are mounted."""


def simulate_dataset(
    config: Path,
    root: Path,
    finish: Finish,
    *,
    engine: str,
    quality: Quality = "standard",
    scale: float = 1.0,
    workers: int | None = None,
    frames: int | None = None,
    only: str | None = None,
    render: str = RENDERER,
    console: Console | None = None,
) -> Summary:
    """Render what is missing of a dataset's frames. A frame that fails is named, and the others go on.

    Args:
        config: the simulator's settings file.
        root: the folder of the dataset, new or of an earlier run.
        finish: is called when the frames are there, while no other run may touch the folder.
        engine: Mitsuba's variant for every worker.
        quality: how much work a picture is worth.
        scale: renders every camera's picture larger or smaller.
        workers: processes of one thread each; None is one for each processor.
        frames: render only so many, evenly over splits and scenes.
        only: render these frames, whole or not: ``17`` or ``3,17,20-25``.
        render: dotted name of the function (FrameSpec, quality) -> RenderedFrame.
        console: where progress is shown.

    Raises:
        FileNotFoundError: no such settings file.
        ValueError: settings, options or a boat's files are wrong, or the folder holds something else or is in use.
        OSError: a file cannot be written.
    """
    if not (math.isfinite(scale) and 0 < scale <= LARGEST_SCALE):
        raise ValueError(f"--scale is {scale:g}, expected above 0 and at most {LARGEST_SCALE:g}")
    if workers is not None and workers < 1:
        raise ValueError(f"--workers is {workers}, expected at least 1")
    if frames is not None and only is not None:
        raise ValueError("--frames and --only exclude each other")
    console = console or Console()
    settings = load_settings(config)
    scenario = Scenario(settings)
    cameras = {name: _scaled(name, camera, scale) for name, camera in scenario.cameras().items()}
    if only is not None:
        numbers = parse_numbers(only, scenario.total)
    elif frames is not None:
        numbers = spread_sample(scenario, frames)
    else:
        numbers = list(range(scenario.total))

    for hull in scenario.hulls().values():
        if hull.mesh_file is not None:
            build_hull(hull, 0)  # a file that cannot be used is told before the folder is bound to it
    for notice in claim_folder(root, make_manifest(config, settings, quality, scale, engine)):
        console.print(f"note: {notice}", markup=False, highlight=False, soft_wrap=True)
    with alone_in(root):
        remove_leftovers(root)
        whole = set() if only is not None else whole_frames(root)
        missing = [number for number in numbers if number not in whole]
        summary = Summary(asked=len(numbers), whole=len(numbers) - len(missing))
        if missing:
            (root / "data.yaml").unlink(missing_ok=True)  # no dataset until it is finished again
            job = Job(settings, root, quality, scale, engine, render)
            try:
                _render_aloud(job, missing, workers or _processors(), summary, console)
            except KeyboardInterrupt:
                there = summary.whole + summary.rendered
                console.print(f"{there} of {len(numbers)} frames are there, the same command goes on", soft_wrap=True)
                raise
            remove_leftovers(root)  # of workers that were ended with one that died
        finish(root, cameras)
    return summary


def _render_aloud(job: Job, numbers: list[int], workers: int, summary: Summary, console: Console) -> None:
    """Render, and say how far it is and which frames failed."""
    with FrameProgress(console, len(numbers)) as progress:

        def tell(outcome: Outcome) -> None:
            if outcome.error:
                summary.failed.append(outcome.number)
                progress.say(f"frame {outcome.number} (seed {job.settings.seed}) failed: {outcome.error}")
            else:
                summary.rendered += 1
                for step, seconds in outcome.seconds.items():
                    summary.seconds[step] += seconds
            progress.advance()

        render_frames(job, numbers, workers, tell)


def _scaled(name: str, camera: Camera, scale: float) -> Camera:
    size_px = scaled_size(camera, scale)
    if min(size_px) < SMALLEST_PX:
        raise ValueError(f"--scale is {scale:g}: {name} has {size_px[0]} x {size_px[1]} px, expected {SMALLEST_PX}")
    return camera if scale == 1 else scale_camera(camera, size_px)


def _processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
