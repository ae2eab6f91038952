"""What each augmentation, the curriculum and the range loss are worth: each switched off in turn, all else the same.

    python benchmarks/ablation.py --root datasets/sixscenes-v0 --epochs 20

Every row of the table is a run of train.py in a folder of its own, one after another. Stopped and started again, it
goes on where it was; a row that is finished is not trained again. The result: ``ablation.md`` and ``ablation.json``.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from jsonargparse import auto_cli

from usvnet.files import atomic_write

ROWS = {
    "everything": [],
    "no mosaic": ["--data.augmentation.mosaic=0"],
    "mosaic to the end": ["--data.augmentation.closing=0"],
    "no pasted boats": ["--data.augmentation.paste=0"],
    "no turns": ["--data.augmentation.roll_deg=0"],
    "no mirror": ["--data.augmentation.mirror=0"],
    "no fog": ["--data.augmentation.fog=0"],
    "no dusk": ["--data.augmentation.dim=0"],
    "no glare": ["--data.augmentation.glare=0"],
    "no noise nor blur": ["--data.augmentation.noise=0", "--data.augmentation.blur=0"],
    "no change of colours": [f"--data.augmentation.{name}=0" for name in ("hue", "saturation", "value")],
    "ranges teach from the start": ["--model.range_loss_error=null"],
    "ranges teach nothing": ["--model.loss_weights.range=0"],
}
"""Name -> what differs from the experiment."""

COLUMNS = {
    "mAP50-95 (1/7)": ("pose", "map50_95"),
    "strict mAP50-95": ("pose_strict", "map50_95"),
    "keypoint median px": ("keypoints", "overall", "median_px"),
    "keypoint p95 px": ("keypoints", "overall", "p95_px"),
    "waterline RMSE m": ("ranges", "overall", "waterline", "rmse_m"),
    "waterline MAE m": ("ranges", "overall", "waterline", "mae_m"),
}
"""Heading -> where the figure stands in metrics.json."""


def metrics_of(run_dir: Path) -> dict[str, Any] | None:
    """What evaluation wrote, None while the run is not finished."""
    found = sorted(run_dir.glob("**/metrics.json"))
    return json.loads(found[0].read_text()) if found else None


def train(run_dir: Path, arguments: list[str]) -> None:
    """Run train.py to its end, from its last checkpoint where there is one.

    Raises:
        subprocess.CalledProcessError: it failed; its own line on stderr says why.
    """
    resume = (run_dir / "checkpoints" / "last.ckpt").is_file()
    command = [sys.executable, "train.py", *arguments, f"--run_dir={run_dir}", f"--resume={json.dumps(resume)}"]
    subprocess.run([*command, "--evaluate_after=true", "--export_after=false"], check=True)


def figure(metrics: dict[str, Any], path: tuple[str, ...]) -> float | None:
    """One figure of metrics.json."""
    value: Any = metrics
    for key in path:
        value = value[key]
    return value


def table(results: dict[str, dict[str, float | None]]) -> str:
    """Rows of the runs that are finished, as Markdown."""
    lines = [f"| | {' | '.join(COLUMNS)} |", f"| :--- |{' ---: |' * len(COLUMNS)}"]
    for row, figures in results.items():
        cells = ["-" if value is None else f"{value:.3f}" for value in figures.values()]
        lines.append(f"| {row} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main(
    root: str,
    epochs: int = 20,
    seed: int = 0,
    experiment: str = "configs/experiment/sixscenes.yaml",
    out: str = "runs/ablation",
    rows: list[str] | None = None,
    options: list[str] | None = None,
) -> None:
    """Train, score and print the table, row by row.

    Args:
        root: dataset folder.
        epochs: of every run.
        seed: of every run.
        experiment: what every run has in common.
        out: folder of the runs and of the table.
        rows: names of the rows to run, all by default.
        options: further options of train.py for every run, as in ``'["--data.image_size=224"]'``.

    Raises:
        ValueError: a row is not known.
    """
    for row in rows or []:
        if row not in ROWS:
            raise ValueError(f"rows: got {row!r}, expected some of {', '.join(ROWS)}")
    results = {}
    for row in rows or ROWS:
        run_dir = Path(out) / row.replace(" ", "-")
        if metrics_of(run_dir) is None:
            common = [f"--config={experiment}", f"--data.root={root}", f"--seed_everything={seed}"]
            length = [f"--trainer.max_epochs={epochs}", f"--trainer.check_val_every_n_epoch={epochs}"]
            train(run_dir, [*common, *length, "--model.range_loss_start_epoch=0", *(options or []), *ROWS[row]])
        metrics = metrics_of(run_dir)
        assert metrics is not None, f"{run_dir}: train.py has written no metrics.json"
        results[row] = {heading: figure(metrics, path) for heading, path in COLUMNS.items()}
        for name, text in (("ablation.md", table(results)), ("ablation.json", json.dumps(results, indent=1))):
            with atomic_write(Path(out) / name) as temporary:
                temporary.write_text(text)
        print(table(results), flush=True)


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
