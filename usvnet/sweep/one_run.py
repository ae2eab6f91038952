"""One run of a sweep in a process of its own: ``python -m usvnet.sweep.one_run FOLDER``.

It trains with the folder's configuration, as train.py does, from the last epoch that was finished, and scores the best
checkpoint on the test split. It ends when its standard input does, which is when the sweep that started it ends: a run
may be killed at any moment, because everything it keeps is written in one piece.
"""

import hashlib
import json
import os
import shutil
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path

import torch
from lightning.pytorch import Callback, LightningModule, Trainer

from usvnet import __version__
from usvnet.callbacks import CHECKPOINT_FOLDER
from usvnet.checkpoints import read_checkpoint
from usvnet.evaluation.calibrator import calibrate_checkpoint
from usvnet.evaluation.evaluator import evaluate_checkpoint
from usvnet.evaluation.scores import finite
from usvnet.files import run_program
from usvnet.sweep.cost import device_name
from usvnet.sweep.plan import CONFIGURATION
from usvnet.sweep.progress import Progress, Result, read_progress, write_progress, write_result
from usvnet.training_cli import TrainingCLI


class EpochLog(Callback):
    """Keeps ``progress.json`` up to date.

    Args:
        folder: of the run.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Start the clock."""
        before = read_progress(self.folder)
        self.training_s = before.training_s if before and trainer.current_epoch else 0.0
        self.since_s = time.monotonic()
        self._write(trainer, trainer.current_epoch)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Count an epoch."""
        now_s = time.monotonic()
        self.training_s, self.since_s = self.training_s + now_s - self.since_s, now_s
        self._write(trainer, trainer.current_epoch + 1)

    def _write(self, trainer: Trainer, epochs_done: int) -> None:
        if trainer.is_global_zero:
            write_progress(self.folder, Progress("training", epochs_done, self.training_s))


def main() -> None:
    """Train what is left to train, then score."""
    threading.Thread(target=_end_with_standard_input, daemon=True).start()
    folder = Path(sys.argv[1])
    configuration = folder / CONFIGURATION
    resume = prepare_resume(folder)
    cli = TrainingCLI(["--config", str(configuration), f"--run_dir={folder}", f"--resume={json.dumps(resume)}"])
    test = cli.datamodule.dataset("test")  # before hours of training: is it there?
    cli.trainer.callbacks.append(EpochLog(folder))  # type: ignore[attr-defined]
    checkpoint = cli.fit()
    if not cli.trainer.is_global_zero:
        return
    trained = read_progress(folder) or Progress("training", cli.trainer.current_epoch, 0.0)
    write_progress(folder, Progress("scoring", trained.epochs_done, trained.training_s))
    calibrate_checkpoint(checkpoint, cli.datamodule.dataset("val"), "val", cli.datamodule.batch_size)
    scores = evaluate_checkpoint(checkpoint, test, "test", batch_size=cli.datamodule.batch_size, overwrite=True)
    result = Result(
        configuration_sha256=hashlib.sha256(configuration.read_bytes()).hexdigest(),
        metrics=finite(asdict(scores)),
        training_s=trained.training_s,
        device=device_name(cli.trainer.strategy.root_device),
        versions={"usvnet": __version__, "torch": torch.__version__},
    )
    write_result(folder, result)


def prepare_resume(folder: Path) -> bool:
    """Say whether training can go on from ``last.ckpt``; where it cannot, clear away what a lost start has left."""
    checkpoints = folder / CHECKPOINT_FOLDER
    try:
        read_checkpoint(checkpoints / "last.ckpt")
    except (OSError, ValueError):
        if os.environ.get("LOCAL_RANK", "0") == "0":
            shutil.rmtree(checkpoints, ignore_errors=True)
        return False
    return True


def _end_with_standard_input() -> None:
    while os.read(0, 1024):  # not sys.stdin, which Python could not close at exit while it is being read
        pass
    os._exit(1)


if __name__ == "__main__":
    run_program(main)
