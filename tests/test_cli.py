"""The ``usvnet`` command: its options are its functions' signatures, and a wrong one costs one line."""

import subprocess
import sys

import pytest

from usvnet import __version__, cli


def measure(folder: str, *, square_mm: float, sizes: list[int] | None = None) -> None:
    """Stand in for a command.

    Args:
        folder: where the pictures lie.
        square_mm: side of a square.
        sizes: a list.
    """
    raise ValueError(f"{folder} {square_mm} {sizes}")


@pytest.fixture
def one_command(monkeypatch):
    monkeypatch.setattr(cli, "command_function", lambda name: measure)


@pytest.mark.usefixtures("one_command")
class TestParsing:
    def test_positional_and_dashed_options_reach_the_function(self):
        with pytest.raises(ValueError, match=r"^here 2\.5 \[1, 2\]$"):
            cli.run(["calibrate", "here", "--square-mm", "2.5", "--sizes", "[1, 2]"])

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["calibrate", "here"], "square-mm.*usvnet calibrate"),
            (
                ["calibrate", "here", "--square-mm", "wide"],
                "--square-mm: got wide, expected a number .see usvnet cal.* --help",
            ),
            (["calibrate", "here", "--square-mm", "1", "--squares", "1"], "--squares"),
            (["calibrate", "here", "--square", "1"], "--square 1"),
            (["calibrat"], "^got the command 'calibrat', expected one of calibrate, .*check-data, .*usvnet --help"),
            (["--loud"], "--loud"),
        ],
    )
    def test_a_wrong_option_is_named(self, arguments, message):
        with pytest.raises(ValueError, match=f"(?s){message}"):
            cli.run(arguments)


def test_nothing_asked_is_answered_by_the_help(capsys):
    cli.run([])
    bare = capsys.readouterr().out
    with pytest.raises(SystemExit) as stop:
        cli.run(["--help"])
    assert stop.value.code == 0
    assert bare == capsys.readouterr().out
    lines = bare.splitlines()
    assert lines[0] == "usage: usvnet COMMAND ..."
    assert [line.split()[0] for line in lines if line[:4].isspace() and line[4:5].isalpha()] == list(cli.COMMANDS)
    assert "train.py" in bare


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_has_help_for_every_option(name, capsys):
    with pytest.raises(SystemExit) as stop:
        cli.run([name, "--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert cli.COMMANDS[name].split()[0] in text
    assert "_" not in "".join(word for word in text.split() if word.startswith("--"))
    assert text.startswith(f"usage: usvnet {name} ")
    assert not {"<class", "type:", "null"} & set(text.replace("(", " ").replace(")", " ").split())


def test_version_help_and_errors_of_the_real_program():
    def usvnet(*arguments):
        return subprocess.run([sys.executable, "-m", "usvnet.cli", *arguments], capture_output=True, text=True)

    assert usvnet("--version").stdout.split() == ["usvnet", __version__]
    wrong = usvnet("fly")
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("error: ")
    assert len(wrong.stderr.splitlines()) == 1


def test_help_does_not_wait_for_torch():
    tell = "atexit.register(lambda: print('torch' in sys.modules))"
    code = f"import atexit, sys, usvnet.cli; {tell}; usvnet.cli.run(['--help'])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.endswith("False\n")
