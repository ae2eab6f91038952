"""A real sweep, killed again and again, ends with the very files of one that was left alone."""

import json
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
import yaml
from small_sample import write_small_sample

from usvnet.sweep.one_run import prepare_resume

SAME = ("runs.csv", "table_2.csv")


@pytest.fixture(scope="module")
def config(root, tmp_path_factory):
    """Two runs of three epochs on a few pictures of the sample set."""
    folder = tmp_path_factory.mktemp("tiny")
    write_small_sample(root / "data" / "sample", folder, {"train": 16, "val": 4, "test": 4})
    settings = {
        "data.root": str(folder),
        "data.image_size": 64,
        "data.eval_image_size": 64,
        "data.batch_size": 4,
        "trainer.accelerator": "cpu",
        "trainer.check_val_every_n_epoch": 1,
    }
    experiment = str(root / "configs" / "experiment" / "quickstart.yaml")
    grid = {"model.variant": ["n"], "trainer.max_epochs": [3], "seed_everything": [0, 1]}
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump({"experiment": experiment, "settings": settings, "grid": grid}, sort_keys=False))
    return path


def start(config: Path, out: Path) -> subprocess.Popen:
    command = [sys.executable, "-m", "usvnet.cli", "sweep", "--config", str(config), "--out", str(out)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def epochs_done(out: Path) -> int:
    return sum(json.loads(path.read_text())["epochs_done"] for path in out.glob("*/progress.json"))


def kill_at_random(sweep: subprocess.Popen, out: Path, rng: random.Random) -> bool:
    """Kill a sweep some moment after it has finished an epoch; False where it ends before."""
    before, delay_s = epochs_done(out), rng.uniform(0, 4)
    while sweep.poll() is None:
        if epochs_done(out) > before:
            time.sleep(delay_s)
            sweep.kill()
            return sweep.wait() != 0
        time.sleep(0.02)
    assert sweep.returncode == 0
    return False


@pytest.mark.slow
def test_killed_at_random_it_ends_with_the_same_files(config, tmp_path):
    straight, stopped = tmp_path / "straight", tmp_path / "stopped"
    assert start(config, straight).wait(300) == 0
    rng, kills = random.Random(4), 0
    while kill_at_random(start(config, stopped), stopped, rng):
        kills += 1
    assert kills >= 2
    for name in SAME:
        assert (stopped / name).read_text() == (straight / name).read_text()
    for run in ("n_3-epochs_seed-0", "n_3-epochs_seed-1"):
        for checkpoint in ("best.ckpt", "last.ckpt"):
            first, second = (
                torch.load(out / run / "checkpoints" / checkpoint, weights_only=True)["state_dict"]
                for out in (straight, stopped)
            )
            assert all(torch.equal(first[name], second[name]) for name in first)
        results = [json.loads((out / run / "result.json").read_text()) for out in (straight, stopped)]
        assert results[0]["metrics"] == results[1]["metrics"]


@pytest.mark.slow
def test_a_killed_sweep_leaves_no_process_behind(config, tmp_path):
    out = tmp_path / "out"
    sweep = start(config, out)
    progress = out / "n_3-epochs_seed-0" / "progress.json"
    while not progress.is_file():
        assert sweep.poll() is None
        time.sleep(0.1)
    sweep.kill()
    sweep.wait()
    time.sleep(3)  # for what it had begun to write
    before = sorted(out.rglob("*")), progress.read_text()
    time.sleep(5)
    assert (sorted(out.rglob("*")), progress.read_text()) == before
    assert not (out / "n_3-epochs_seed-0" / "result.json").exists()


def test_a_torn_checkpoint_is_cleared_away_and_a_whole_one_kept(untrained, tmp_path):
    checkpoints = tmp_path / "checkpoints"
    assert not prepare_resume(tmp_path)
    checkpoints.mkdir()
    whole = untrained.read_bytes()
    (checkpoints / "last.ckpt").write_bytes(whole)
    (checkpoints / "best.ckpt").write_bytes(whole)
    assert prepare_resume(tmp_path)
    (checkpoints / "last.ckpt").write_bytes(whole[: len(whole) // 2])
    assert not prepare_resume(tmp_path)
    assert not checkpoints.exists()  # its best.ckpt would pass for the fresh start's
