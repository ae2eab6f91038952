"""Runs as trials of Ray Tune on this machine."""

import csv

import pytest
import yaml

from usvnet.commands.sweep import sweep
from usvnet.sweep import local


@pytest.fixture
def config(root, tmp_path):
    path = tmp_path / "tiny.yaml"
    experiment = str(root / "configs" / "experiment" / "quickstart.yaml")
    settings = {"data.root": str(root / "data" / "sample"), "data.image_size": 64, "data.eval_image_size": 64}
    grid = {"model.variant": ["n"], "seed_everything": [0, 1]}
    path.write_text(yaml.safe_dump({"experiment": experiment, "settings": settings, "grid": grid}, sort_keys=False))
    return path


@pytest.mark.slow
def test_every_run_is_a_trial_and_failures_are_named(root, config, tmp_path, monkeypatch):
    pytest.importorskip("ray", reason="the extra `ray` is not installed")
    fake = str(root / "tests" / "sweep" / "fake_run.py")
    monkeypatch.setattr(local, "COMMAND", (fake,))
    sweep(config=config, out=str(tmp_path / "out"), ray=True)
    assert [row["seed"] for row in csv.DictReader((tmp_path / "out" / "runs.csv").open())] == ["0", "1"]


def test_without_ray_one_sentence_says_what_to_install(config, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(ValueError, match=r"--ray needs Ray: pip install .*\[ray\]"):
        sweep(config=config, out=str(tmp_path / "out"), ray=True)
