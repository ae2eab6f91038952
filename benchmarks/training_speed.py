"""Training images per second, beside another program's on the same machine in the same run.

    python benchmarks/training_speed.py --root datasets/sixscenes-v0 --peer_command "COMMAND"

COMMAND trains the peer on the same data and prints a line ``RESULT {json}`` with ``train_img_per_s``, for instance
``PEER/bin/python benchmarks/peer/train.py --data data.yaml --model yolo11n-pose.yaml --batch 16 --workers 2 --epochs 2
--fresh --out FOLDER`` in an environment as ``peer/environment.py`` describes it. The two take
turns ``--rounds`` times, because a shared machine's speed drifts: only the ratio of neighbours means anything. What
counts is a training epoch: loading, augmentation, forward pass, losses, backward pass, optimiser, weight average; the
first one, in which a program fetches its memory from the system, is left out where there are several.
Ours is train.py with a process for each core (or graphics card), which share a batch (docs/scaling.md).
"""

import json
import os
import shlex
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import torch
from jsonargparse import auto_cli
from lightning.pytorch import Callback, LightningModule, Trainer

from usvnet.files import atomic_write

HERE = Path(__file__).resolve().parent


class EpochClock(Callback):
    """Says at the end how many pictures a second a training epoch took: not the first of several, nor validation."""

    def __init__(self) -> None:
        self.seconds: list[float] = []

    def on_train_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Start the clock."""
        self.started = time.perf_counter()

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Stop the clock."""
        self.seconds.append(time.perf_counter() - self.started)

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Print the result, once for all processes."""
        if trainer.is_global_zero:
            seconds = statistics.mean(self.seconds[1:] or self.seconds)
            pictures = len(trainer.datamodule.frames("train"))
            print("RESULT " + json.dumps({"train_img_per_s": pictures / seconds}), flush=True)


def our_command(settings: dict[str, object], processes: int, run_dir: str) -> list[str]:
    """The call of train.py, every loss switched on."""
    options = {
        **settings,
        "model.range_loss_start_epoch": 0,
        "trainer.devices": processes,
        "trainer.limit_val_batches": 0,
        "trainer.callbacks+": "training_speed.EpochClock",
        "trainer.strategy": "ddp" if processes > 1 else "auto",
        "run_dir": run_dir,
    }
    if not torch.cuda.is_available():
        options["trainer.accelerator"] = "cpu"
    command = [sys.executable, str(HERE.parent / "train.py"), "--config"]
    command.append(str(HERE.parent / "configs" / "experiment" / "sixscenes.yaml"))
    return command + [f"--{key}={value}" for key, value in options.items()]


def images_per_second(command: list[str]) -> float:
    """What a training program reports."""
    environment = {**os.environ, "OMP_WAIT_POLICY": "PASSIVE"}
    environment["PYTHONPATH"] = os.pathsep.join([str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])])
    output = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment).stdout
    result = next(line for line in output.splitlines() if line.startswith("RESULT "))
    return float(json.loads(result.removeprefix("RESULT "))["train_img_per_s"])


def main(
    root: str,
    peer_command: str | None = None,
    variant: str = "n",
    image_size: int = 320,
    batch_size: int = 16,
    epochs: int = 2,
    processes: int | None = None,
    rounds: int = 1,
    output: str = "runs/training_speed.json",
) -> None:
    """Measure and print.

    Args:
        root: dataset folder.
        peer_command: the peer's training program; without it only ours is timed.
        variant: size of the network.
        image_size: side of the training picture.
        batch_size: pictures a batch, which the processes share.
        epochs: epochs of ours in every round.
        processes: that train together; None for one on each graphics card, or else on each core.
        rounds: how often the two take turns.
        output: JSON file of the figures.
    """
    processes = processes or torch.cuda.device_count() or len(os.sched_getaffinity(0))
    settings: dict[str, object] = {
        "data.root": root,
        "data.image_size": image_size,
        "data.eval_image_size": image_size,
        "data.batch_size": batch_size // processes,
        "model.variant": variant,
        "trainer.max_epochs": epochs,
    }
    rows = []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as run_dir:
            row = {"ours_img_per_s": images_per_second(our_command(settings, processes, run_dir))}
        if peer_command:
            row["peer_img_per_s"] = images_per_second(shlex.split(peer_command))
            row["ratio"] = row["ours_img_per_s"] / row["peer_img_per_s"]
        print("  ".join(f"{name} {value:.2f}" for name, value in row.items()), flush=True)
        rows.append(row)
    medians = {name: statistics.median(row[name] for row in rows) for name in rows[0]}
    written = {**settings, "processes": processes, "peer": peer_command, "torch": torch.__version__}
    with atomic_write(Path(output)) as temporary:
        temporary.write_text(json.dumps({"settings": written, "rounds": rows, "median": medians}, indent=1))


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
