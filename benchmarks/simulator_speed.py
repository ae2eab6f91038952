"""Processor seconds and peak memory of a rendered picture, step by step.

    OMP_NUM_THREADS=1 python benchmarks/simulator_speed.py --settings configs/simulator/paper.yaml

Renders a spread of a configuration's frames in this one process, as a worker of ``usvnet simulate`` does, and prints
the mean of each step. The first frame also compiles the renderer's kernels; it is told apart.
"""

import json
import resource
import time
from pathlib import Path

from jsonargparse import auto_cli
from rich.console import Console
from rich.progress import track
from rich.table import Table

from usvnet.files import atomic_write
from usvnet.simulator.engine import start_engine
from usvnet.simulator.frame import render_frame
from usvnet.simulator.scenario import Scenario
from usvnet.simulator.settings import load_settings


def main(settings: Path, frames: int = 12, quality: str = "standard", output: Path | None = None) -> None:
    """Render and measure.

    Args:
        settings: a configuration of the simulator.
        frames: how many of its frames, spread evenly; one more is rendered first.
        quality: preview, standard or high.
        output: a JSON file for the figures.
    """
    console = Console()
    engine = start_engine()
    scenario = Scenario(load_settings(settings))
    numbers = [round(k * (scenario.total - 1) / max(frames - 1, 1)) for k in range(frames)]
    seconds, steps = [], []
    for number in track([numbers[0], *numbers], description="frames", console=console):
        start = time.process_time()
        steps.append(render_frame(scenario.frame(number), quality).seconds)
        seconds.append(time.process_time() - start)
    mean = {step: sum(frame.get(step, 0.0) for frame in steps[1:]) / frames for step in steps[0]}
    result = {
        "engine": engine,
        "config": settings.name,
        "quality": quality,
        "frames": frames,
        "first_frame_cpu_s": seconds[0],
        "mean_cpu_s": sum(seconds[1:]) / frames,
        "most_cpu_s": max(seconds[1:]),
        "peak_memory_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        "steps_cpu_s": mean,
    }
    table = Table("step", "CPU seconds a picture", title=f"{settings.name}, {quality}, {engine}")
    for step, value in mean.items():
        table.add_row(step, f"{value:.2f}")
    table.add_section()
    table.add_row("all", f"{result['mean_cpu_s']:.2f} (most {result['most_cpu_s']:.2f}, first {seconds[0]:.2f})")
    console.print(table)
    console.print(f"peak memory {result['peak_memory_gb']:.2f} GB")
    if output is not None:
        with atomic_write(output) as temporary:
            temporary.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
