"""What watches a training run: checkpoints, the curves and pictures of TensorBoard, and a line for the terminal."""

from pathlib import Path

from lightning.pytorch import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import LearningRateMonitor, ModelCheckpoint

MONITOR = "val/strict_mAP50-95"
"""The score that chooses the best checkpoint."""
CHECKPOINT_FOLDER = "checkpoints"


def run_callbacks(run_dir: Path | str) -> list[Callback]:
    """Everything that a run in ``run_dir`` wants: ``checkpoints/{best,last}.ckpt``, learning rate, status lines."""
    folder = Path(run_dir) / CHECKPOINT_FOLDER
    return [
        ModelCheckpoint(folder, filename="best", monitor=MONITOR, mode="max", enable_version_counter=False),
        LastCheckpoint(folder),
        LearningRateMonitor(logging_interval="step"),
        StatusLine(),
    ]


class LastCheckpoint(ModelCheckpoint):
    """``last.ckpt`` after every epoch, and once more when the user stops the run."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, filename="last", save_on_train_epoch_end=True, enable_version_counter=False)

    def on_exception(self, trainer: Trainer, pl_module: LightningModule, exception: BaseException) -> None:
        """Save on Ctrl-C, except while validating, when the averaged weights stand in for the raw ones."""
        if isinstance(exception, KeyboardInterrupt) and trainer.training and trainer.global_step > 0:
            trainer.save_checkpoint(Path(self.dirpath or ".") / "last.ckpt")


class StatusLine(Callback):
    """One line in the terminal after each validation."""

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Print the scores of this epoch."""
        if not trainer.is_global_zero or trainer.sanity_checking:
            return
        score = {name.removeprefix("val/"): float(value) for name, value in trainer.callback_metrics.items()}
        print(
            f"epoch {trainer.current_epoch + 1}/{trainer.max_epochs}"
            f"  mAP50 {score['mAP50']:.3f}  mAP50-95 {score['mAP50-95']:.3f}"
            f"  strict {score['strict_mAP50-95']:.3f}  keypoints {score['keypoint_median_px']:.2f} px"
            f"  range RMSE {score['range_rmse_m']:.3f} m ({score['missed']:.0f} missed)",
            flush=True,
        )
