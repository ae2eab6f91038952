"""``usvnet simulate`` as it is typed, with a renderer of milliseconds."""

import subprocess
import sys

import cv2
import pytest

from usvnet import cli
from usvnet.commands import simulate as command
from usvnet.commands.check_data import check_data


@pytest.fixture
def config(root, tmp_path, monkeypatch):
    """Settings of a small dataset, and the fake renderer in place of the real one."""
    monkeypatch.syspath_prepend(str(root / "tests" / "simulator"))
    from small_dataset import write_settings

    monkeypatch.setattr(command, "RENDERER", "fake_renderer.render_frame")
    monkeypatch.setattr(command, "check_installed", lambda: None)
    monkeypatch.setattr(command, "choose_engine", lambda: "scalar_rgb")
    return str(write_settings(tmp_path / "settings"))


def run(*arguments):
    cli.run(["simulate", *map(str, arguments)])


def test_a_sample_is_rendered_told_and_passes_check_data(config, tmp_path, capsys):
    out = tmp_path / "set"
    run("--config", config, "--out", out, "--frames", 6, "--quality", "preview", "--workers", 1)
    said = capsys.readouterr().out
    assert "scalar_rgb, about half as fast" in said
    assert "6 of 6 frames rendered" in said
    assert "processor seconds a frame: 0.0 (drawing 0.00)" in said
    sheet = cv2.imread(str(out / "contact_sheet.png"))
    assert sheet.shape[0] > 2 * 320  # six pictures in two rows
    assert sheet.shape[1] > 4 * 480
    assert sheet.std() > 20
    check_data(str(out), output=str(tmp_path / "labels.png"))


def test_failed_frames_are_the_end(config, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("FAKE_FAILS", "1")
    with pytest.raises(ValueError, match=r"^1 of 2 frames failed \(1\): the same command tries them again"):
        run("--config", config, "--out", tmp_path / "set", "--only", "1,2", "--workers", 1)
    assert "frame 1 (seed 7) failed: RuntimeError" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "x"], "--config is missing"),
        (["--config", "CONFIG"], "--out is missing"),
        (["--config", "none.yaml", "--out", "x"], "none.yaml: no such file"),
        (["--config", "CONFIG", "--out", "x", "--scale", "0"], "--scale is 0, expected above 0"),
        (["--config", "CONFIG", "--out", "x", "--scale", "0.1"], "--scale is 0.1: mast-0 has 6 x 6 px"),
        (["--config", "CONFIG", "--out", "x", "--workers", "0"], "--workers is 0"),
        (["--config", "CONFIG", "--out", "x", "--frames", "0"], "--frames is 0"),
        (["--config", "CONFIG", "--out", "x", "--only", "99"], "--only names frames 99, expected 0 to 23"),
        (["--config", "CONFIG", "--out", "x", "--only", "1", "--frames", "2"], "exclude each other"),
        (["--config", "CONFIG", "--out", "x", "--quality", "best"], "quality.*best"),
        (["--config", "CONFIG", "--out", "CONFIG"], "is a file, expected a folder"),
    ],
)
def test_a_wrong_option_is_one_sentence_and_writes_nothing(config, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((ValueError, OSError), match=f"(?s){words}"):
        run(*(config if argument == "CONFIG" else argument for argument in arguments))
    assert not (tmp_path / "x").exists()


def test_without_the_extra_it_says_what_to_install(config, tmp_path, monkeypatch):
    monkeypatch.undo()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"pip install '?\"?usvnet\[sim\]"):
        command.simulate(config=config, out=str(tmp_path / "x"))


def test_the_doctor_needs_no_other_option(monkeypatch, capsys):
    monkeypatch.setattr(command, "examine_machine", lambda: ["mitsuba 3.8.0", "rendering uses llvm_ad_rgb"])
    run("--doctor")
    assert capsys.readouterr().out == "mitsuba 3.8.0\nrendering uses llvm_ad_rgb\n"


def test_the_real_program_needs_one_line_for_an_error():
    wrong = subprocess.run(
        [sys.executable, "-m", "usvnet.cli", "simulate", "--out", "x"], capture_output=True, text=True
    )
    assert wrong.returncode == 2
    assert wrong.stderr == "error: --config is missing (see usvnet simulate --help)\n"
