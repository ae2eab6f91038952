"""``usvnet benchmark``: what it times, what it prints and what it refuses. Nothing here depends on how long it took."""

import json
import sys
from types import SimpleNamespace

import pytest

from usvnet.commands import benchmark as command
from usvnet.deploy.benchmark import STAGES, frame_inputs, median_times_ms, stage_times_ms
from usvnet.deploy.parity import Parity


def test_formats_take_turns():
    order = []
    jobs = {name: lambda name=name: order.append(name) for name in "ab"}
    turns = []
    times_ms = median_times_ms(jobs, rounds=2, calls=2, watch=lambda: turns.append(1))
    assert "".join(order) == "aaaaa" + "bbbbb" + "aaa" + "bbb"  # three calls that do not count, then one
    assert len(turns) == 4
    assert times_ms.keys() == {"a", "b"}


def test_the_fit_is_what_ranging_takes_beyond_geometry():
    times_ms = {"network": 30.0, "suppression": 1.0, "heatmaps": 2.0, "geometry": 1.5, "ranging": 9.0}
    stages = stage_times_ms(times_ms)
    assert tuple(stages) == STAGES
    assert stages["hull fit"] == 7.5
    assert sum(stages.values()) == 42.0


def test_the_picture_has_the_size_asked_for():
    assert frame_inputs(96)[0].shape == (1, 3, 96, 96)


def test_the_table_and_what_was_passed_over(untrained, tmp_path, monkeypatch, capsys):
    seen = []

    def export(model, path, image_size):
        seen.append((path.name, image_size))
        if path.suffix == ".onnx":
            raise ValueError("the exported model differs")
        path.write_bytes(b"x" * 2_000_000)
        return Parity(0.001, 0.0002, 0.0)

    monkeypatch.setattr(command, "export_model", export)
    monkeypatch.setattr(command, "open_runtime", lambda path: lambda *inputs: path)
    monkeypatch.setattr(command, "stage_jobs", lambda *_: dict.fromkeys((*STAGES, "ranging"), lambda: None))
    quick = {".ts": 2.0, "TorchScript": 2.0}
    monkeypatch.setattr(command, "median_times_ms", lambda jobs, *_: {name: quick.get(name, 4.0) for name in jobs})
    monkeypatch.setattr(command, "find_spec", lambda package: None if package == "openvino" else sys)
    there = tmp_path / "int8.xml"
    there.write_bytes(b"x" * 3_000_000)
    there.with_suffix(".bin").write_bytes(b"x" * 1_000_000)
    monkeypatch.setattr(command, "ExportedModel", lambda path: SimpleNamespace(runtime=lambda *inputs: path))
    options = {"rounds": 1, "calls": 1, "models": [there], "output": tmp_path / "table.json"}
    command.benchmark(checkpoint=untrained, image_size=64, **options)
    assert seen == [("model.ts", 64), ("model.pt2", 64), ("model.onnx", 64)]
    said = capsys.readouterr()
    assert "passed over ONNX: the exported model differs" in said.err
    assert "passed over OpenVINO: openvino is not installed (pip install usvnet[export])" in said.err
    assert "| TorchScript | 2.0 | 1.0e-03 | 2.0e-01 |" in said.out
    table = json.loads((tmp_path / "table.json").read_text())
    assert [row["suffix"] for row in table["rows"]] == [None, ".ts", ".pt2", None]
    assert [row["format"] for row in table["rows"]][::3] == ["PyTorch", str(there)]
    assert f"| {there} | 4.0 | | |" in " ".join(said.out.split())
    assert table["fastest"] == "TorchScript"
    assert f"fastest here: TorchScript (500.0 pictures per second): usvnet export --checkpoint {untrained} " in said.out
    assert table["stages_ms"].keys() == {"PyTorch", "TorchScript"}
    for row in table["rows"]:
        assert row["ratio"] == pytest.approx(row["median_ms"] / table["rows"][0]["median_ms"])


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"rounds": 0}, "rounds: got 0, expected at least 1"),
        ({"formats": [".tflite"]}, r"formats: got '\.tflite', expected some of \.ts"),
        ({"image_size": 100}, "image_size: got 100, expected a multiple of 32"),
    ],
)
def test_what_cannot_be_is_refused(untrained, options, reason):
    with pytest.raises(ValueError, match=reason):
        command.benchmark(checkpoint=untrained, **options)
