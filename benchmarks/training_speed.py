"""Training images per second, beside another program's on the same machine in the same run.

    python benchmarks/training_speed.py --root datasets/sixscenes-v0 --peer_command "COMMAND"

COMMAND trains the peer on the same data and prints a line ``RESULT {json}`` with ``train_img_per_s``, for instance
``PEER/bin/python benchmarks/peer/train.py --data data.yaml --model yolo11n-pose.yaml --batch 16 --workers 2 --epochs 1
--fresh --out FOLDER`` in an environment as ``peer/environment.py`` describes it. The two take
turns ``--rounds`` times, because a shared machine's speed drifts: only the ratio of neighbours means anything. What
counts is a training epoch: loading, augmentation, forward pass, losses, backward pass, optimiser, weight average.
"""

import json
import shlex
import statistics
import subprocess
import time
from pathlib import Path

import torch
from jsonargparse import auto_cli
from lightning.pytorch import Callback, LightningModule, Trainer

from usvnet.config import OptimiserConfig
from usvnet.data.datamodule import BoatDataModule
from usvnet.files import atomic_write
from usvnet.training import USVModule


class EpochClock(Callback):
    """Seconds of each training epoch."""

    def __init__(self) -> None:
        self.seconds: list[float] = []

    def on_train_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Start the clock."""
        self.started = time.perf_counter()

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Stop the clock."""
        self.seconds.append(time.perf_counter() - self.started)


def ours(data: BoatDataModule, variant: str) -> float:
    """Images per second of one training epoch, every loss switched on."""
    clock = EpochClock()
    module = USVModule(variant, optimiser=OptimiserConfig(name="AdamW", learning_rate=0.002), range_loss_start_epoch=0)
    trainer = Trainer(
        max_epochs=1,
        limit_val_batches=0,
        logger=False,
        enable_checkpointing=False,
        enable_model_summary=False,
        gradient_clip_val=10.0,
        callbacks=[clock],
    )
    trainer.fit(module, data)
    return len(data.frames("train")) / clock.seconds[0]


def peer(command: str) -> float:
    """Images per second that the peer's own program reports."""
    output = subprocess.run(shlex.split(command), capture_output=True, text=True, check=True).stdout
    result = next(line for line in output.splitlines() if line.startswith("RESULT "))
    return float(json.loads(result.removeprefix("RESULT "))["train_img_per_s"])


def main(
    root: str,
    peer_command: str | None = None,
    variant: str = "n",
    image_size: int = 320,
    batch_size: int = 16,
    rounds: int = 1,
    output: str = "runs/training_speed.json",
) -> None:
    """Measure and print.

    Args:
        root: dataset folder.
        peer_command: the peer's training program; without it only ours is timed.
        variant: size of the network.
        image_size: side of the training picture.
        batch_size: pictures a batch.
        rounds: how often the two take turns.
        output: JSON file of the figures.
    """
    rows = []
    for _ in range(rounds):
        row = {"ours_img_per_s": ours(BoatDataModule(root, image_size=image_size, batch_size=batch_size), variant)}
        if peer_command:
            row["peer_img_per_s"] = peer(peer_command)
            row["ratio"] = row["ours_img_per_s"] / row["peer_img_per_s"]
        print("  ".join(f"{name} {value:.2f}" for name, value in row.items()), flush=True)
        rows.append(row)
    medians = {name: statistics.median(row[name] for row in rows) for name in rows[0]}
    settings = {"variant": variant, "image_size": image_size, "batch_size": batch_size, "torch": torch.__version__}
    with atomic_write(Path(output)) as temporary:
        temporary.write_text(json.dumps({"settings": settings, "rounds": rows, "median": medians}, indent=1))


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
