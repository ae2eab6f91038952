"""The ``usvnet`` command: each subcommand is a plain function in :mod:`usvnet.commands`.

The function's signature is its options and its docstring their help. Only the command that was asked for is imported,
so that ``usvnet --help`` does not wait for PyTorch.
"""

import re
import sys
from argparse import SUPPRESS, Action
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, NoReturn

from jsonargparse import ArgumentParser, DefaultHelpFormatter

from usvnet import __version__
from usvnet.files import run_program
from usvnet.wording import did_you_mean, in_plain_words

COMMANDS = {
    "calibrate": "find a camera's focal length and distortion from pictures of a chessboard",
    "calibrate-mount": "find a camera's height, pitch and roll from points at known places",
    "convert": "turn an export of CVAT or Label Studio, or a folder of pictures by scene, into a dataset",
    "simulate": "render pictures of boats on water with exact labels",
    "check-data": "count a dataset and name every fault in it",
    "import-weights": "start from weights that Ultralytics trained (YOLO11, YOLOv8, YOLOv8-P6)",
    "sweep": "train a grid of networks and settings, and compare them",
    "predict": "find boats in pictures, a video, a webcam or a stream, and say how far away they are",
    "sensitivity": "say what an error of camera, keypoints or water costs in range",
    "export": "write a trained model as TorchScript, torch.export, ONNX or OpenVINO, for programs without usvnet",
    "benchmark": "compare the formats that a model can be exported to on this machine, and say which to use",
}
"""In the order in which a person comes to need them."""

ABOUT = f"usvnet {__version__}: how far away is that boat, from one camera, and how sure are we?"
SCRIPTS = "Training and evaluation are scripts of the repository: python train.py --help, python evaluate.py --help."
EACH = "each tells its options: usvnet COMMAND --help"
UNKNOWN = re.compile(r"argument COMMAND: invalid choice: (.+?) \(choose from")
MISSING = "the following arguments are required: "


class PlainHelp(DefaultHelpFormatter):
    """Help without the types of Python, and with a default only where there is one."""

    def _get_help_string(self, action: Action) -> str:
        told = action.help or ""
        told = told[:1].upper() + told[1:] if action.option_strings else told
        if action.dest == "subcommand":
            return ""
        if action.required:
            return f"{told} (required)"
        nothing = action.default is None or action.default is False or action.default in (SUPPRESS, [])
        return told if nothing else f"{told} (default: %(default)s)"

    def _format_action_invocation(self, action: Action) -> str:
        return EACH if action.dest == "subcommand" else super()._format_action_invocation(action)


class CommandParser(ArgumentParser):
    """Options with dashes and in full, and one line when they are wrong."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, formatter_class=PlainHelp, **settings)

    def add_argument(self, *names: Any, **settings: Any) -> Any:
        """Spell ``--board_size`` as ``--board-size``, and let ``--doctor`` stand for ``--doctor true``."""
        dashed = [name.replace("_", "-") if name.startswith("--") else name for name in names]
        if settings.get("type") is bool:  # a switch alone means true
            settings |= {"nargs": "?", "const": True}
        return super().add_argument(*dashed, **settings)

    def error(self, message: str, ex: Exception | None = None) -> NoReturn:
        """Leave the one line to :func:`usvnet.files.run_program`."""
        parser = getattr(ex, "subcommand_parser", None) or self
        asked = parser.prog
        if MISSING in message:  # jsonargparse names them as keys of the whole: predict.camera
            command, *_ = message.removeprefix(MISSING).split(".")
            needs = message.removeprefix(MISSING).replace(f"{command}.", "").replace("_", "-")
            asked, message = f"{asked} {command}", f"{command} needs {needs}"
        if unknown := UNKNOWN.match(message):
            message = f"got the command {unknown[1]}, expected one of {', '.join(COMMANDS)}"
        message = did_you_mean(in_plain_words(message, "-"), parser.get_defaults(skip_validation=True).keys(), "-")
        raise ValueError(f"{message} (see {asked} --help)") from ex


def command_function(name: str) -> Callable[..., object]:
    """The function behind ``usvnet <name>``, e.g. ``usvnet.commands.check_data.check_data``."""
    module = name.replace("-", "_")
    function: Callable[..., object] = getattr(import_module(f"usvnet.commands.{module}"), module)
    return function


def build_parser(needed: Sequence[str] = tuple(COMMANDS)) -> ArgumentParser:
    """The parser of ``usvnet``, with the options of the ``needed`` commands only."""
    parser = CommandParser(prog="usvnet", description=ABOUT, epilog=SCRIPTS, version=__version__)
    subcommands = parser.add_subcommands(required=True, title="commands", metavar="COMMAND", description=None)
    for name, summary in COMMANDS.items():
        command = CommandParser(description=summary)
        if name in needed:
            command.add_function_arguments(command_function(name), as_positional=True)
        subcommands.add_subcommand(name, command, help=summary)
        command.prog = f"usvnet {name}"
    return parser


def run(arguments: Sequence[str] | None = None) -> None:
    """Parse ``arguments`` (the command line by default) and call the chosen command; without any print the help.

    Raises:
        ValueError: an unknown command or option, or a value of the wrong type.
    """
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    parser = build_parser(needed=arguments)
    if not arguments:
        parser.print_help()
        return
    settings = parser.instantiate(parser.parse_args(arguments))
    name: str = settings.subcommand
    command_function(name)(**vars(settings[name]))


def main() -> None:
    """Entry point of the ``usvnet`` script."""
    run_program(run)


if __name__ == "__main__":
    main()
