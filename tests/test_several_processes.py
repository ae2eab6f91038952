"""Training on two processes of this machine: the same scores of the whole set, and one of them alone writes."""

import subprocess
import sys
from pathlib import Path

import pytest
from small_sample import write_small_sample
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

DDP = ["--trainer.devices", "2", "--trainer.strategy", "ddp"]
TORCHRUN = ["-m", "torch.distributed.run", "--standalone", "--nproc_per_node", "2"]


def train(root: Path, data: Path, run: Path, *options: str, launcher: tuple[str, ...] = ()) -> str:
    command = [
        *(sys.executable, *launcher, "train.py", "--config", "configs/experiment/quickstart.yaml"),
        *("--run_dir", str(run), "--trainer.accelerator", "cpu", "--trainer.max_epochs", "1"),
        *("--trainer.check_val_every_n_epoch", "1", "--data.image_size", "64", "--data.eval_image_size", "64"),
        *(
            "--data.batch_size",
            "4",
            "--data.root",
            str(data),
            "--evaluate_after",
            "true",
            "--export_after",
            "false",
            *options,
        ),
    ]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("launcher", [(), tuple(TORCHRUN)], ids=["lightning", "torchrun"])
def test_two_processes_train_one_network(root, tmp_path, launcher):
    data, run = tmp_path / "data", tmp_path / "run"
    data.mkdir()
    write_small_sample(root / "data" / "sample", data, {"train": 15, "val": 5, "test": 3})
    said = train(root, data, run, *DDP, launcher=launcher)
    assert said.count("epoch 1/1") == said.count("trained: ") == said.count("written to ") == 1
    assert len(list(run.glob("events.out.tfevents.*"))) == 1
    assert sorted(path.name for path in (run / "checkpoints").iterdir()) == ["best.ckpt", "last.ckpt"]
    missed = EventAccumulator(str(run)).Reload().Scalars("val/missed")
    assert [event.value for event in missed] == [5]  # a network that finds nothing yet misses each of the five once
