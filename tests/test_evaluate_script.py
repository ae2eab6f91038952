"""The command ``python evaluate.py``: reads training's configurations and says in one line what is wrong."""

import json
import runpy
import shutil
import sys

import pytest
import torch

from usvnet.model import USVNet


@pytest.fixture
def run(monkeypatch, root):
    """Run the script with arguments from the repository's root."""

    def run(*arguments):
        monkeypatch.chdir(root)
        monkeypatch.setattr(sys, "argv", ["evaluate.py", *map(str, arguments)])
        runpy.run_path(str(root / "evaluate.py"), run_name="__main__")

    return run


@pytest.fixture(scope="module")
def checkpoint(untrained, tmp_path_factory):
    """A network that has learnt nothing, in a run's folder."""
    path = tmp_path_factory.mktemp("run") / "checkpoints" / "best.ckpt"
    path.parent.mkdir()
    shutil.copy(untrained, path)
    return path


def test_a_training_configuration_evaluates_a_checkpoint(run, root, checkpoint, capsys):
    config = root / "configs" / "experiment" / "sixscenes.yaml"
    arguments = ["--config", config, "--checkpoint", checkpoint, "--data.root", root / "data" / "sample"]
    run(*arguments, "--data.eval_image_size", 64, "--report")
    output = checkpoint.parents[1] / "evaluation" / "best_test"
    metrics = json.loads((output / "metrics.json").read_text())
    assert metrics["pictures"] == 24
    assert metrics["ranges"]["overall"]["waterline"]["n"] + metrics["ranges"]["overall"]["waterline"]["missed"] == 24
    assert len(list((output / "overlays").iterdir())) == 6
    shown = capsys.readouterr().out
    assert "None of the 24 labelled boats was found" in " ".join(shown.split())  # by a network that is hardly trained
    assert "paper: YOLO11m-pose" in shown
    assert f"open {output / 'report.html'} in a browser" in shown
    report = (output / "report.html").read_text()
    assert str(checkpoint) in report
    assert "eval_image_size: 64" in report

    with pytest.raises(SystemExit) as stopped:  # another size is another prediction
        run(*arguments, "--data.eval_image_size", 96)
    assert stopped.value.code == 2
    assert "made with image_size [64, 64], not [96, 96]" in capsys.readouterr().err


def test_without_a_checkpoint_the_shipped_one_is_scored_and_nothing_is_written_beside_it(
    run, root, checkpoint, capsys, tmp_path, monkeypatch
):
    scored = []
    monkeypatch.setattr("usvnet.deploy.predictor.default_checkpoint", lambda: checkpoint)
    monkeypatch.setattr("usvnet.evaluation.evaluator.evaluate_checkpoint", lambda *a, **k: scored.append((a, k)))
    run("--data.root", root / "data" / "sample", "--report", tmp_path / "page.html")
    ((path, _, split, output), more) = scored[0]
    assert (path, split, output) == (checkpoint, "test", "runs/best/evaluation/test")
    assert more["report"] == str(tmp_path / "page.html")
    with pytest.raises(SystemExit):
        run("--data.root", root / "data" / "sample", "--calibrate_intervals", "val")
    assert f"name a copy of {checkpoint}" in capsys.readouterr().err


def test_where_no_network_was_shipped_one_must_be_named(run, root, capsys, monkeypatch):
    monkeypatch.setattr("usvnet.deploy.predictor.SHIPPED", {False: "none.pt"})
    with pytest.raises(SystemExit) as stopped:
        run("--data.root", root / "data" / "sample")
    assert stopped.value.code == 2
    error = capsys.readouterr().err
    assert error == "error: no trained weights came with this usvnet: name some with --checkpoint, e.g. a best.ckpt\n"


def test_what_is_shown_otherwise_than_in_training_is_told(run, root, checkpoint, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("usvnet.evaluation.evaluator.evaluate_checkpoint", lambda *a, **k: None)
    saved = torch.load(checkpoint, weights_only=True)
    saved["usvnet"] |= {"image_size": 64, "refine": "native"}
    torch.save(saved, tmp_path / "refined.ckpt")
    arguments = ["--checkpoint", tmp_path / "refined.ckpt", "--data.root", root / "data" / "sample"]
    run(*arguments, "--data.image_size", 96)
    assert capsys.readouterr().err.splitlines() == [
        f"note: {tmp_path}/refined.ckpt was trained for pictures of 64 px and is shown 96: data.eval_image_size",
        f"note: {tmp_path}/refined.ckpt has a second look, which is left out: data.native_size, the longer side of the "
        "pictures",
    ]
    run(*arguments, "--data.image_size", 96, "--data.eval_image_size", 64, "--data.native_size", 320)
    assert capsys.readouterr().err == ""
    with pytest.raises(SystemExit):
        run(*arguments, "--data.image_size", 64, "--calibrate_intervals", "val")
    assert "calibrate_intervals: expected data.native_size, too" in capsys.readouterr().err


def test_pictures_that_the_network_cannot_take_are_refused(run, root, capsys, tmp_path):
    weights = {f"model.{name}": value for name, value in USVNet("v8n-p6").state_dict().items()}
    torch.save({"usvnet": {"variant": "v8n-p6", "curved_water": False}, "state_dict": weights}, tmp_path / "p6.ckpt")
    with pytest.raises(SystemExit):
        run("--checkpoint", tmp_path / "p6.ckpt", "--data.root", root / "data" / "sample", "--data.image_size", 96)
    assert "image_size is 96, expected a multiple of 64" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["--checkpoint", "none.ckpt"], "none.ckpt: no such checkpoint file"),
        (["--split", "holiday"], "no split 'holiday'"),
        (["--data.rot", "x"], "rot"),
        (["--data.image_size", "100"], "image_size is 100, expected a multiple of 32"),
        (["--data.root", "nowhere"], "nowhere"),
        (["--range_confidence", "25"], "range_confidence: got 25"),
        (["--config", "none.yaml"], "none.yaml"),
        (["--calibrate_intervals", "test"], "the split that is scored"),
        (["--calibrate_intervals", "holiday"], "no split 'holiday'"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(run, root, checkpoint, capsys, tmp_path, changes, message):
    with pytest.raises(SystemExit) as stopped:
        run("--checkpoint", checkpoint, "--data.root", root / "data" / "sample", "--output", tmp_path, *changes)
    assert stopped.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert message in error
    assert error.count("\n") == 1


def test_every_experiment_is_understood(run, root, capsys):
    experiments = sorted((root / "configs" / "experiment").glob("*.yaml"))
    assert experiments
    for config in experiments:
        with pytest.raises(SystemExit):
            run("--config", config, "--checkpoint", "none.ckpt", "--data.root", root / "data" / "sample")
        assert "no such checkpoint" in capsys.readouterr().err
