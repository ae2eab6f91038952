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
            (["calibrate", "here", "--square-mm", "wide"], "square_mm.*wide.*usvnet calibrate --help"),
            (["calibrate", "here", "--square-mm", "1", "--squares", "1"], "--squares"),
            (["calibrate", "here", "--square", "1"], "--square 1"),
            (["calibrat"], "calibrat.*check-data"),
            ([], "subcommand"),
        ],
    )
    def test_a_wrong_option_is_named(self, arguments, message):
        with pytest.raises(ValueError, match=f"(?s){message}"):
            cli.run(arguments)


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_has_help_for_every_option(name, capsys):
    with pytest.raises(SystemExit) as stop:
        cli.run([name, "--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert cli.COMMANDS[name].split()[0] in text
    assert "_" not in "".join(word for word in text.split() if word.startswith("--"))


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
