"""``usvnet import-weights``: from the peer's file to a checkpoint that every program of ours takes, and nothing run."""

import pytest
import torch

from tests.pretrained.peer_files import peer_model, write
from usvnet import cli
from usvnet.checkpoints import load_model
from usvnet.commands.export import export
from usvnet.training import USVModule


@pytest.fixture(scope="module")
def start(tmp_path_factory):
    """The peer's file and what the command made of it."""
    folder = tmp_path_factory.mktemp("import")
    path = write(folder / "peer.pt", {"model": peer_model("n").half(), "ema": None})
    cli.run(["import-weights", str(path), "--output", str(folder / "start.ckpt")])
    return path, folder / "start.ckpt"


def test_training_starts_from_it(start):
    module = USVModule("n", initial_weights=str(start[1]))
    for name, value in load_model(start[1]).state_dict().items():
        assert torch.equal(module.model.state_dict()[name], value), name
    with pytest.raises(ValueError, match="checkpoint of size 'n', expected size 'v8n'"):
        USVModule("v8n", initial_weights=str(start[1]))


def test_it_exports(start, tmp_path):
    export(checkpoint=start[1], output=tmp_path / "model.ts")
    assert (tmp_path / "model.ts").is_file()


def test_what_was_taken_and_what_was_left_is_said(tmp_path, capsys):
    path = write(tmp_path / "coco.pt", {"model": peer_model("s", 0, 80, "Detect"), "ema": None})
    cli.run(["import-weights", str(path), "--output", str(tmp_path / "start.ckpt")])
    said = capsys.readouterr().out
    assert "coco.pt: variant s, no keypoints, 80 classes" in said
    assert (
        "taken: backbone and neck (63 of 63 layers), box branch (9 of 9 layers), score branch (12 of 15 layers)" in said
    )
    assert "left as drawn, to be trained: score branch (3 layers), keypoint branch (9 layers), heatmap head" in said
    assert "AGPL-3.0" in said
    assert "--model.variant s --model.initial_weights" in said


def test_the_order_of_seven_keypoints_is_said(start, tmp_path, capsys):
    cli.run(["import-weights", str(start[0]), "--output", str(tmp_path / "again.ckpt")])
    assert "in their order for bow, bow_left" in capsys.readouterr().out


def test_the_file_itself_is_not_overwritten(start):
    before = start[0].read_bytes()
    with pytest.raises(ValueError, match="the output is the file itself"):
        cli.run(["import-weights", str(start[0]), "--output", str(start[0])])
    assert start[0].read_bytes() == before


def test_a_file_that_is_not_there_leaves_nothing(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.pt: no such file"):
        cli.run(["import-weights", str(tmp_path / "none.pt"), "--output", str(tmp_path / "start.ckpt")])
    assert list(tmp_path.iterdir()) == []
