"""What goes along with training: averaged weights, checkpoints, curves and pictures in TensorBoard, status lines."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import LearningRateMonitor, ModelCheckpoint, WeightAveraging
from lightning.pytorch.loggers import TensorBoardLogger
from torch import Tensor, nn

from usvnet.allocator import give_back_freed_memory, keep_freed_memory
from usvnet.evaluation.records import RANGE_CONFIDENCE, BoatRecord, TruthRecord, match_boats, to_records, to_truths
from usvnet.types import Batch
from usvnet.visualize import Picture, draw_boat, draw_boats, range_label

MONITOR = "val/fitness"
"""The score that chooses the best checkpoint, see :func:`usvnet.training.validation_scalars`."""
CHECKPOINT_FOLDER = "checkpoints"


def run_callbacks(run_dir: Path | str) -> list[Callback]:
    """Everything that a run in ``run_dir`` wants: ``checkpoints/{best,last}.ckpt``, learning rate, pictures, status."""
    folder = Path(run_dir) / CHECKPOINT_FOLDER
    return [
        ModelCheckpoint(folder, filename="best", monitor=MONITOR, mode="max", enable_version_counter=False),
        LastCheckpoint(folder),
        StepSeed(),
        FreedMemory(),
        LearningRateMonitor(logging_interval="step"),
        OverlayPictures(),
        StatusLine(),
    ]


class MovingAverage(WeightAveraging):
    """Exponential moving average of all weights and batch-norm statistics, updated after every optimiser step.

    The decay rises with the number n of updates, decay * (1 - exp(-n / ramp_steps)), so that the average forgets the
    random start. Validation sees the average, checkpoints carry it as their ``state_dict`` (the raw weights beside it,
    for resuming), and it is what the module holds when training ends.

    Args:
        decay: share of the old average that one update keeps, once the ramp is over, in [0, 1).
        ramp_steps: time constant of the ramp.

    Raises:
        ValueError: if the decay is outside [0, 1) or the ramp is not positive.
    """

    def __init__(self, decay: float, ramp_steps: float) -> None:
        if not 0 <= decay < 1:
            raise ValueError(f"ema_decay: got {decay}, expected a number in [0, 1)")
        if ramp_steps <= 0:
            raise ValueError(f"ema_ramp_steps: got {ramp_steps}, expected a number above 0")
        self.decay = decay
        self.ramp_steps = ramp_steps
        super().__init__()

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """List the tensors by type, for they stay the same: finding them takes four times as long as averaging them."""
        assert self._average_model is not None
        average = self._average_model.to(pl_module.device).module  # copied before the weights went to their device
        self.groups: dict[torch.dtype, tuple[list[Tensor], list[Tensor]]] = {}
        tensors = ((*module.parameters(), *module.buffers()) for module in (average, pl_module))
        for averaged, current in zip(*tensors, strict=True):
            averages, currents = self.groups.setdefault(averaged.dtype, ([], []))
            averages.append(averaged)
            currents.append(current)

    def on_train_batch_end(self, trainer: Trainer, pl_module: LightningModule, *_: Any) -> None:
        """Update the average where the batch has ended in a step."""
        assert self._average_model is not None
        if trainer.global_step > self._latest_update_step:
            for averages, currents in self.groups.values():
                self.update(averages, currents, int(self._average_model.n_averaged))
            self._average_model.n_averaged += 1
            self._latest_update_step = trainer.global_step

    @torch.no_grad()
    def update(self, averages: list[Tensor], currents: list[Tensor], updates: int) -> None:
        """Move each average towards its current value in place; integers (counters) are copied."""
        if averages[0].is_floating_point():
            decay = self.decay * (1 - math.exp(-updates / self.ramp_steps))
            torch._foreach_lerp_(averages, currents, 1 - decay)
        else:
            torch._foreach_copy_(averages, currents)


class NormWarmup(Callback):
    """Batch-norm statistics that look back over a twentieth of the steps so far, until their own momentum is slower.

    At a momentum of 0.03 they remember their arbitrary start, and the wild first steps, for some 200 steps: a network
    that has learnt long since looks dead in validation.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Note each layer's own momentum."""
        norms = [module for module in pl_module.modules() if isinstance(module, nn.BatchNorm2d)]
        self.own = {norm: norm.momentum for norm in norms if norm.momentum is not None}

    def on_train_batch_start(self, trainer: Trainer, pl_module: LightningModule, batch: Batch, batch_idx: int) -> None:
        """Set the momentum of this step."""
        warm = norm_momentum(trainer.global_step)
        for norm, own in self.own.items():
            norm.momentum = max(own, warm)
        self.own = {norm: own for norm, own in self.own.items() if warm > own}


def norm_momentum(step: int) -> float:
    """Momentum that looks back over a twentieth of the steps so far, and at least five."""
    return 1 / (5 + step / 20)


class LastCheckpoint(ModelCheckpoint):
    """``last.ckpt`` after every epoch, and once more when the user stops the run."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, filename="last", save_on_train_epoch_end=True, enable_version_counter=False)

    def on_exception(self, trainer: Trainer, pl_module: LightningModule, exception: BaseException) -> None:
        """Save on Ctrl-C, except while validating, when the averaged weights stand in for the raw ones."""
        if isinstance(exception, KeyboardInterrupt) and trainer.training and trainer.global_step > 0:
            trainer.save_checkpoint(Path(self.dirpath or ".") / "last.ckpt")


class StepSeed(Callback):
    """Seed torch anew before every step, so that a resumed run draws in its losses what an uninterrupted one draws."""

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Keep the seed of the run (``seed_everything``)."""
        self.seed = torch.initial_seed()

    def on_train_batch_start(self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int) -> None:
        """Derive the step's seed from the run's, the epoch, the batch and the process."""
        step = (self.seed, trainer.current_epoch, batch_idx, trainer.global_rank)
        torch.manual_seed(int(np.random.SeedSequence(step).generate_state(1)[0]))


class FreedMemory(Callback):
    """Keep the memory that a step frees for the next one, until the epoch ends."""

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Begin."""
        keep_freed_memory()

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Give back what it has come to, a validation's included."""
        give_back_freed_memory()


class OverlayPictures(Callback):
    """The first validation pictures in TensorBoard, with what was found on them and how far away it is.

    Args:
        pictures: how many at most.
    """

    def __init__(self, pictures: int = 8) -> None:
        self.pictures = pictures

    def on_validation_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Batch, batch_idx: int, *_: int
    ) -> None:
        """Draw on the first batch; ``outputs`` is what ``validation_step`` returned."""
        if batch_idx > 0 or not trainer.is_global_zero or not isinstance(trainer.logger, TensorBoardLogger):
            return
        images = (batch.image[: self.pictures].permute(0, 2, 3, 1) * 255).round().byte().cpu().numpy()
        for n, (image, boats, truths) in enumerate(
            zip(images, to_records(outputs["prediction"]), to_truths(batch.boats))
        ):
            picture = draw_result(image, boats, truths)
            trainer.logger.experiment.add_image(f"val/{n}", picture, trainer.global_step, dataformats="HWC")


def draw_result(picture: Picture, boats: list[BoatRecord], truths: list[TruthRecord]) -> Picture:
    """Draw the boats that score at least ``RANGE_CONFIDENCE`` with the ``waterline`` range, over the labels."""
    truth_of = {id(boat): truth for boat, truth in zip(match_boats(boats, truths), truths)}
    drawings = []
    for boat in boats:
        if boat.score >= RANGE_CONFIDENCE:
            truth, estimate = truth_of.get(id(boat)), boat.ranges["waterline"]
            laser_m = truth.range_m if truth is not None and truth.range_m > 0 else None
            drawings.append(draw_boat(boat, truth, range_label(estimate.slant_m, estimate.slant_std_m, laser_m)))
    return draw_boats(picture, drawings)


class StatusLine(Callback):
    """One line in the terminal after each validation."""

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Print the scores of this epoch."""
        if not trainer.is_global_zero or trainer.sanity_checking:
            return
        score = {name.removeprefix("val/"): float(value) for name, value in trainer.callback_metrics.items()}
        print(
            f"epoch {trainer.current_epoch + 1}/{trainer.max_epochs}"
            f"  loss {score['loss']:.2f}  mAP50 {score['mAP50']:.3f}  mAP50-95 {score['mAP50-95']:.3f}"
            f"  strict {score['strict_mAP50-95']:.3f}  keypoints {score['keypoint_median_px']:.2f} px"
            f"  range RMSE {score['range_rmse_m']:.3f} m ({score['missed']:.0f} missed)",
            flush=True,
        )
