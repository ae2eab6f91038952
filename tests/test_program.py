"""How programs end: whole files or none, one sentence, and an exit code that says what happened."""

import os
import signal
import subprocess
import sys

import pytest

from usvnet.files import atomic_folder, atomic_write, run_program

WRITING = """
import sys, time
from pathlib import Path
from usvnet.deploy.export import draft_of
from usvnet.files import atomic_folder, atomic_write, run_program

def write():
    a, b, c = (Path(sys.argv[1]) / name for name in ("a.onnx", "b.json", "c"))
    with draft_of(a) as model, atomic_write(b) as file, atomic_folder(c) as folder:
        for path in (model, file, folder / "d"):
            path.write_text("half")
        print("writing", flush=True)
        time.sleep(60)

run_program(write)
"""


def end(number):
    os.kill(os.getpid(), number)


def exit_code(main, capsys):
    with pytest.raises(SystemExit) as ended:
        run_program(main)
    return ended.value.code, capsys.readouterr().err


def test_sigterm_leaves_no_half_written_files(tmp_path, root):
    process = subprocess.Popen(
        [sys.executable, "-c", WRITING, str(tmp_path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=root
    )
    assert process.stdout.readline() == b"writing\n"
    assert len(list(tmp_path.iterdir())) == 3
    process.send_signal(signal.SIGTERM)
    _, told = process.communicate(timeout=30)
    assert (process.returncode, told) == (143, b"terminated\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("number", "code", "told"), [(signal.SIGTERM, 143, "terminated\n"), (signal.SIGINT, 130, "interrupted\n")]
)
def test_the_exit_code_tells_the_signal(number, code, told, capsys):
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell lets its background jobs ignore
    try:
        assert exit_code(lambda: end(number), capsys) == (code, told)
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_second_sigterm_does_not_disturb_the_cleaning_up(capsys):
    cleaned = []

    def main():
        try:
            end(signal.SIGTERM)
        finally:
            end(signal.SIGTERM)
            cleaned.append(True)

    before = signal.getsignal(signal.SIGTERM)
    assert exit_code(main, capsys) == (143, "terminated\n")
    assert cleaned == [True]
    assert signal.getsignal(signal.SIGTERM) is before


def test_sigterm_is_told_also_where_something_else_was_raised_on_the_way(capsys):
    def main():
        try:
            end(signal.SIGTERM)
        except KeyboardInterrupt:
            raise KeyboardInterrupt from None  # as after Lightning's own way out

    assert exit_code(main, capsys) == (143, "terminated\n")


def test_what_the_system_says_is_a_sentence_too(tmp_path, capsys):
    def refuse():
        raise PermissionError(13, "Permission denied", "model.ts")

    assert exit_code(refuse, capsys) == (2, "error: model.ts: permission denied\n")
    (tmp_path / "out").write_text("")

    for writing in (atomic_write, atomic_folder):
        for place in (tmp_path / "out" / "a.csv", tmp_path / "out" / "deeper" / "a.csv"):

            def write(writing=writing, place=place):
                with writing(place):
                    pass

            code, told = exit_code(write, capsys)
            assert (code, told) == (2, f"error: {place.parent}: expected a folder, but there is a file in its place\n")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_bad_input_is_one_sentence(capsys):
    def main():
        raise ValueError("camera.yaml:3: got\n  nothing")

    assert exit_code(main, capsys) == (2, "error: camera.yaml:3: got nothing\n")
