"""A run that was stopped, inside an epoch or between two, ends with the weights of one that was not."""

from pathlib import Path

import pytest
import torch
from lightning.pytorch import Callback, Trainer

from usvnet.callbacks import LastCheckpoint, StepSeed
from usvnet.config import OptimiserConfig
from usvnet.data.datamodule import BoatDataModule
from usvnet.training import USVModule

STEPS_PER_EPOCH = 3


class StopBefore(Callback):
    """Ctrl-C before a step."""

    def __init__(self, step: int) -> None:
        self.step = step

    def on_train_batch_start(self, trainer: Trainer, *_: object) -> None:
        if trainer.global_step == self.step:
            raise KeyboardInterrupt


def train(folder: Path, dataset: Path, stop_before: int = -1, resume: bool = False) -> dict[str, torch.Tensor]:
    """Train two epochs from seed 0, as a process of its own would, and return the averaged weights."""
    torch.manual_seed(0)
    data = BoatDataModule(str(dataset), image_size=32, batch_size=40)
    module = USVModule(optimiser=OptimiserConfig(name="AdamW", learning_rate=0.01), ema_decay=0.5, ema_ramp_steps=1)
    trainer = Trainer(
        accelerator="cpu",
        max_epochs=2,
        limit_val_batches=0,
        logger=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        callbacks=[LastCheckpoint(folder), StepSeed(), StopBefore(stop_before)],
    )
    last = folder / "last.ckpt"
    trainer.fit(module, data, ckpt_path=last if resume else None, weights_only=True)
    return torch.load(last, weights_only=True)["state_dict"]


@pytest.fixture(scope="module")
def straight(root, tmp_path_factory):
    return train(tmp_path_factory.mktemp("straight"), root / "data" / "sample")


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("step", [STEPS_PER_EPOCH - 1, STEPS_PER_EPOCH, STEPS_PER_EPOCH + 1])
def test_a_stopped_run_ends_with_the_same_weights(root, straight, tmp_path, step):
    with pytest.raises(SystemExit):
        train(tmp_path, root / "data" / "sample", stop_before=step)
    resumed = train(tmp_path, root / "data" / "sample", resume=True)
    assert all(torch.equal(resumed[name], value) for name, value in straight.items())
