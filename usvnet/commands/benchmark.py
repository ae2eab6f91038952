"""``usvnet benchmark``: every format side by side, on the user's machine."""

import json
import platform
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import torch
from rich.console import Console
from rich.progress import Progress

from usvnet import __version__
from usvnet.checkpoints import STAMP, load_model, read_checkpoint
from usvnet.deploy.benchmark import STAGES, Job, frame_inputs, median_times_ms, stage_jobs, stage_times_ms
from usvnet.deploy.deployed import DeployedUSVNet
from usvnet.deploy.export import export_model
from usvnet.deploy.exported import ExportedModel
from usvnet.deploy.formats import FORMATS, format_of
from usvnet.deploy.predictor import DEFAULT_IMAGE_SIZE_PX, default_checkpoint
from usvnet.deploy.runtimes import open_runtime
from usvnet.files import atomic_write
from usvnet.wording import counted

EAGER = "PyTorch"
SUFFIXES = (".ts", ".pt2", ".onnx", ".xml")


class Row(NamedTuple):
    """One line of the table."""

    format: str
    suffix: str | None
    megabytes: float | None
    max_px: float | None
    """Greatest difference from the checkpoint; None of the checkpoint itself and of files that were there before."""
    max_m_at_10_m: float | None
    median_ms: float
    ratio: float
    """Of the time to that of eager PyTorch."""


def benchmark(
    *,
    checkpoint: Path | None = None,
    image_size: int | None = None,
    formats: list[str] = list(SUFFIXES),  # noqa: B006 (a default on the command line)
    models: list[Path] = [],  # noqa: B006
    rounds: int = 5,
    calls: int = 5,
    threads: int | None = None,
    output: Path | None = None,
) -> None:
    """Compare the formats that a model can be exported to on this machine, and say which is the fastest.

    Exports to every format whose libraries are installed, compares what each says with the checkpoint, and times it
    from one picture in memory to its ranges, on the processor; the formats take turns.

    Args:
        checkpoint: Weights written by train.py; checkpoints/usvnet-n.pt where none is named.
        image_size: Side of the square picture, pixels; the size it was trained on where none is named.
        formats: Suffixes to try; those whose library is missing are passed over.
        models: Exported files to time as well, such as one in int8; what they differ by is in their descriptions.
        rounds: Turns of each format.
        calls: Pictures a turn.
        threads: Threads of the processor to use; as many as PyTorch takes where none is named.
        output: JSON file of the table.

    Raises:
        FileNotFoundError: there is no such checkpoint or exported file.
        ValueError: it is not one of usvnet, or an option out of range.
    """
    checkpoint = checkpoint or default_checkpoint()
    for name, number in (("rounds", rounds), ("calls", calls), ("threads", threads), ("image_size", image_size)):
        if number is not None and number < 1:
            raise ValueError(f"{name}: got {number}, expected at least 1")
    unknown = [suffix for suffix in formats if suffix not in FORMATS]
    if unknown:
        raise ValueError(f"formats: got {unknown[0]!r}, expected some of {', '.join(FORMATS)}")
    if threads:
        torch.set_num_threads(threads)
    size = image_size or read_checkpoint(checkpoint)[STAMP].get("image_size") or DEFAULT_IMAGE_SIZE_PX
    model = load_model(checkpoint)
    if model.refiner is not None:
        raise ValueError(
            f"{checkpoint}: has a second look at native pictures (refine: native), which only TorchScript takes: "
            "expected a checkpoint without one to compare formats with"
        )
    stride_px = model.network.largest_stride_px
    if size % stride_px:
        raise ValueError(f"image_size: got {size}, expected a multiple of {stride_px}")
    deployed = DeployedUSVNet(model).eval()
    inputs = frame_inputs(size)
    console = Console(stderr=True, soft_wrap=True, markup=False, highlight=False)
    jobs: dict[str, Job] = {EAGER: lambda: deployed(*inputs)}
    jobs |= {str(path): _call(ExportedModel(path).runtime, inputs) for path in models}
    parities, sizes_mb = {}, {str(path): _megabytes(path) for path in models}
    with tempfile.TemporaryDirectory() as folder, Progress(console=console, transient=True) as progress:
        task = progress.add_task("exporting", total=len(formats))
        for suffix in formats:
            kind = FORMATS[suffix]
            missing = [package for package in kind.packages if find_spec(package) is None]
            if missing:
                console.print(f"passed over {kind.title}: {missing[0]} is not installed (pip install usvnet[export])")
            else:
                progress.update(task, description=f"exporting to {kind.title}")
                path = Path(folder) / f"model{suffix}"
                try:
                    parities[suffix] = export_model(model, path, image_size=size)
                except ValueError as error:
                    console.print(f"passed over {kind.title}: {error}")
                else:
                    sizes_mb[suffix] = _megabytes(path)
                    jobs[suffix] = _call(open_runtime(path), inputs)
            progress.advance(task)
        stages = {EAGER: stage_jobs(deployed, size, False), "TorchScript": stage_jobs(deployed, size, True)}
        turns = len(jobs) + sum(map(len, stages.values()))
        task = progress.add_task("timing", total=rounds * turns)
        advance = lambda: progress.advance(task)  # noqa: E731
        times_ms = median_times_ms(jobs, rounds, calls, advance)
        split_ms = {
            name: stage_times_ms(median_times_ms(parts, rounds, calls, advance)) for name, parts in stages.items()
        }
    rows = [Row(EAGER, None, None, None, None, times_ms[EAGER], 1.0)]
    for suffix, parity in parities.items():
        figures = (sizes_mb[suffix], parity.px, parity.m_at_10_m, times_ms[suffix], times_ms[suffix] / times_ms[EAGER])
        rows.append(Row(FORMATS[suffix].title, suffix, *figures))
    for name in map(str, models):
        rows.append(Row(name, None, sizes_mb[name], None, None, times_ms[name], times_ms[name] / times_ms[EAGER]))
    best = min(rows, key=lambda row: row.median_ms)
    _tell(rows, split_ms, size)
    of_itself = "the checkpoint as it is" if best.format == EAGER else "that file"
    how = f"usvnet export --checkpoint {checkpoint} --output model{best.suffix}" if best.suffix else of_itself
    print(f"\nfastest here: {best.format} ({1000 / best.median_ms:.1f} pictures per second): {how}")
    if output:
        table: dict[str, Any] = {
            "usvnet": __version__,
            "torch": torch.__version__,
            "machine": platform.processor() or platform.machine(),
            "threads": torch.get_num_threads(),
            "checkpoint": str(checkpoint),
            "variant": model.variant,
            "image_size": size,
            "rows": [row._asdict() for row in rows],
            "stages_ms": split_ms,
            "fastest": best.format,
        }
        with atomic_write(output) as temporary:
            temporary.write_text(json.dumps(table, indent=2) + "\n")
        print(f"wrote {output}")


def _megabytes(path: Path) -> float:
    files = [path, *(path.with_suffix(companion) for companion in format_of(path).companions)]
    return sum(file.stat().st_size for file in files) / 1e6


def _call(runtime: Callable[..., object], inputs: tuple[torch.Tensor, ...]) -> Job:
    return lambda: runtime(*inputs)


def _tell(rows: list[Row], split_ms: dict[str, dict[str, float]], size: int) -> None:
    """Print both tables, as Markdown."""
    print(f"One picture of {size} x {size}, {counted(torch.get_num_threads(), 'thread')}:\n")
    print("| Format | MB | Greatest difference, px | mm at 10 m | Median ms | Of PyTorch's time |")
    print("|---|---|---|---|---|---|")
    for row in rows:
        size_mb = "" if row.megabytes is None else f"{row.megabytes:.1f}"
        differences = " | " if row.max_px is None else f"{row.max_px:.1e} | {1000 * (row.max_m_at_10_m or 0):.1e}"
        print(f"| {row.format} | {size_mb} | {differences} | {row.median_ms:.1f} | {row.ratio:.2f} |")
    print(f"\n| Milliseconds in | {' | '.join(STAGES)} |")
    print("|---" * (1 + len(STAGES)) + "|")
    for name, stages in split_ms.items():
        print(f"| {name} | {' | '.join(f'{stages[stage]:.1f}' for stage in STAGES)} |")
