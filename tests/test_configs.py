"""Every configuration in the repository is understood, and a wrong one is answered in one line."""

import os
import subprocess
import sys

import pytest
import yaml

from usvnet.network.variants import VARIANTS
from usvnet.training_cli import OneLineParser, TrainingCLI


@pytest.fixture(autouse=True)
def in_repository(root, monkeypatch):
    monkeypatch.chdir(root)
    monkeypatch.setattr(sys, "argv", ["train.py"])


def files(folder):
    from pathlib import Path

    return sorted(Path(__file__).parents[1].glob(f"configs/{folder}/*.yaml"))


def build(tmp_path, *arguments):
    return TrainingCLI([*map(str, arguments), "--run_dir", str(tmp_path), "--trainer.accelerator", "cpu"])


@pytest.mark.parametrize("path", files("experiment"), ids=lambda path: path.stem)
def test_every_experiment_builds_what_it_says(path, tmp_path):
    cli = build(tmp_path, "--config", path)
    said = yaml.safe_load(path.read_text())
    assert cli.model.model.variant == said["model"]["variant"]
    assert cli.trainer.max_epochs == said["trainer"]["max_epochs"]
    assert cli.datamodule.image_size % cli.model.model.network.largest_stride_px == 0


@pytest.mark.parametrize("path", files("experiment"), ids=lambda path: path.stem)
def test_every_experiment_has_a_run_folder_of_its_own_name(path):
    assert yaml.safe_load(path.read_text())["run_dir"] == f"runs/{path.stem}"


@pytest.mark.parametrize("path", files("model"), ids=lambda path: path.stem)
def test_every_model_goes_over_an_experiment_and_leaves_the_rest(path, tmp_path):
    cli = build(tmp_path, "--config", "configs/experiment/quickstart.yaml", "--model", path)
    assert cli.config.model.variant == path.stem
    assert cli.config.model.optimiser.learning_rate == 0.002


@pytest.mark.parametrize("path", files("data"), ids=lambda path: path.stem)
def test_every_dataset_goes_over_an_experiment(path, tmp_path):
    cli = build(tmp_path, "--config", "configs/experiment/quickstart.yaml", "--data", path)
    assert str(cli.datamodule.root) == yaml.safe_load(path.read_text())["root"]


def test_the_paper_trains_by_its_table_1(tmp_path):
    config = build(tmp_path, "--config", "configs/experiment/paper.yaml").config
    loss, optimiser = config.model.loss_weights, config.model.optimiser
    assert (loss.box, loss.classification, loss.keypoint) == (7.5, 0.5, 12.0)
    assert (optimiser.name, optimiser.learning_rate, optimiser.momentum) == ("auto", 0.01, 0.937)
    assert optimiser.weight_decay == 0.0005
    assert (config.data.image_size, config.data.batch_size, config.trainer.max_epochs) == (640, 8, 100)


@pytest.mark.parametrize(
    ("argument", "named"),
    [
        ("--model.widht=3", "widht"),
        ("--model.optimiser.learning_rate=fast", "learning_rate"),
        ("--model.loss_weights.range=-1", "range"),
        ("--data.image_size=333", "333"),
        ("--model.variant=q", "q"),
        ("--model.refine=sonar", "sonar"),
        ("--model.refine=native", r"needs data\.native_size"),
        ("--data.native_size=1920", r"needs model\.refine"),
        ("--data.native_size=64", "native_size is 64, expected at least"),
    ],
)
def test_a_wrong_setting_is_named(argument, named, tmp_path):
    with pytest.raises(ValueError, match=named):
        build(tmp_path, "--config", "configs/experiment/quickstart.yaml", argument)


@pytest.mark.parametrize("key", ["image_size", "eval_image_size"])
def test_pictures_too_small_for_the_network_are_named(key, tmp_path):
    arguments = ["--config", "configs/experiment/quickstart.yaml", "--model", "configs/model/v8n-p6.yaml"]
    with pytest.raises(ValueError, match=rf"data\.{key} is 96, expected a multiple of 64"):
        build(tmp_path, *arguments, f"--data.{key}=96")


def test_weights_alone_are_no_run_to_continue(untrained, tmp_path):
    cli = build(tmp_path, "--config", "configs/experiment/quickstart.yaml", "--ckpt_path", untrained)
    with pytest.raises(ValueError, match=r"best\.ckpt: got weights alone, .* --model\.initial_weights"):
        cli.start_checkpoint()


def test_every_variant_has_a_file():
    assert {path.stem for path in files("model")} == VARIANTS.keys()


def test_a_wrong_key_in_a_file_is_named(tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text("model: {variant: n, widht: 3}\n")
    with pytest.raises(ValueError, match="widht"):
        build(tmp_path, "--config", path, "--data.root", "data/sample")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--config", "configs/experiment/quickstart.yaml", "--model.widht", "3"], "widht"),
        (["--config", "configs/experiment/quickstart.yaml", "--data.root", "no/such/folder"], "no/such/folder"),
        (["--config", "configs/experiment/quickstart.yaml", "--ckpt_path", "none.ckpt"], "none.ckpt"),
        (["--config", "none.yaml"], "none.yaml"),
    ],
)
def test_train_py_answers_in_one_line_with_exit_code_2(arguments, named, root, tmp_path):
    command = [sys.executable, "train.py", *arguments, "--run_dir", str(tmp_path), "--trainer.accelerator", "cpu"]
    result = subprocess.run(command, cwd=root, capture_output=True, text=True)
    assert result.returncode == 2
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert named in result.stderr


def test_the_parser_raises_instead_of_leaving():
    with pytest.raises(ValueError, match="speed"):
        OneLineParser().parse_args(["--speed", "3"])


def test_a_fresh_start_over_another_run_is_told(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("lightning.pytorch.Trainer.fit", lambda *_, **__: None)
    build(tmp_path, "--config", "configs/experiment/quickstart.yaml").fit()
    assert capsys.readouterr().err == ""
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints" / "last.ckpt").write_bytes(b"")
    build(tmp_path, "--config", "configs/experiment/quickstart.yaml").fit()
    told = capsys.readouterr().err
    assert told.startswith(f"note: {tmp_path} holds a run already")
    assert "--resume true" in told


@pytest.mark.parametrize("validated", [False, True])
def test_the_best_checkpoint_of_an_earlier_run_is_not_taken_for_this_one_s(tmp_path, monkeypatch, validated):
    folder = tmp_path / "checkpoints"
    folder.mkdir()
    (folder / "best.ckpt").write_bytes(b"of an earlier run")
    (folder / "last.ckpt").write_bytes(b"of an earlier run")
    os.utime(folder / "best.ckpt", (0, 0))

    def fit(*_, **__):
        for name in ("last", "best") if validated else ("last",):
            (folder / f"{name}.ckpt").write_bytes(b"of this run")

    monkeypatch.setattr("lightning.pytorch.Trainer.fit", fit)
    found = build(tmp_path, "--config", "configs/experiment/quickstart.yaml").fit()
    assert found == folder / ("best.ckpt" if validated else "last.ckpt")
    assert {path.read_bytes() for path in folder.iterdir()} == {b"of this run"}
