"""README and docs are code: their commands are understood, their paths exist, and CI follows README's set-up."""

import re
import runpy
import shlex
import sys

import pytest

from usvnet import cli

SETUP = ["python3 -m venv .venv", ". .venv/bin/activate", 'pip install -c constraints.txt -e ".[dev]"']
TEST = "python -m pytest"


@pytest.fixture(scope="module")
def readme(root):
    return (root / "README.md").read_text()


@pytest.fixture(scope="module")
def pages(root, readme):
    """README and every page of docs, one after another."""
    return "\n".join([readme, *(path.read_text() for path in sorted((root / "docs").rglob("*.md")))])


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def commands(text: str, program: str) -> list[list[str]]:
    """The arguments of every line in a shell block that begins with ``program``."""
    shown = [block.replace("\\\n", " ") for block in blocks(text, "bash")]
    lines = [line for block in shown for line in block.splitlines() if line.startswith(program + " ")]
    assert lines, f"no page shows `{program}`"
    return [shlex.split(line.removeprefix(program), comments=True) for line in lines]


def test_ci_follows_the_readme(root, readme):
    shown = [step for block in blocks(readme, "bash") for line in block.splitlines() for step in line.split(" && ")]
    assert shown[: len(SETUP)] == SETUP
    assert TEST in shown
    ci = (root / ".ci" / "run").read_text()
    assert "python3 -m venv" in ci
    assert SETUP[-1].removeprefix("pip install") in ci
    assert f"step {TEST}\n" in ci


def test_usvnet_commands_are_understood(readme, pages):
    assert {words[0] for words in commands(readme, "usvnet")} == set(cli.COMMANDS)
    for words in commands(pages, "usvnet"):
        cli.build_parser(needed=words).parse_args(words)


def test_training_commands_are_understood(root, pages, monkeypatch, capsys):
    monkeypatch.chdir(root)
    for words in commands(pages, "python train.py"):
        monkeypatch.setattr(sys, "argv", ["train.py", *words, "--print_config"])
        with pytest.raises(SystemExit) as stopped:
            runpy.run_path("train.py", run_name="__main__")
        assert stopped.value.code == 0
        assert "model:" in capsys.readouterr().out


def test_evaluation_commands_are_understood(root, pages, monkeypatch, capsys):
    monkeypatch.chdir(root)
    for words in commands(pages, "python evaluate.py"):
        checkpoint = words[words.index("--checkpoint") + 1]
        there = ["--data.root", "data/sample", "--checkpoint", f"no/{checkpoint}"]
        monkeypatch.setattr(sys, "argv", ["evaluate.py", *words, *there])
        with pytest.raises(SystemExit):
            runpy.run_path("evaluate.py", run_name="__main__")
        assert capsys.readouterr().err == f"error: no/{checkpoint}: no such checkpoint file\n"


def test_python_examples_run(root, readme, monkeypatch, capsys):
    monkeypatch.chdir(root)
    for example in blocks(readme, "python"):
        exec(compile(example, "README.md", "exec"), {})
    assert capsys.readouterr().out.count("tensor(") == 3


def test_every_path_exists(root, readme, pages):
    text = re.sub(r"<!--.*?-->", "", readme, flags=re.DOTALL)
    links = [link for link in re.findall(r"\]\((.*?)\)", text) if "://" not in link]
    names = re.findall(r"(?<![\w/-])((?:benchmarks|configs|data|scripts|usvnet|tests|\.ci)/[\w./-]*\w)", pages)
    assert len(links) >= 6
    assert len(names) >= 6
    missing = [name for name in {*links, *names} if not (root / name).exists()]
    assert missing == []
