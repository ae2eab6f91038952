"""The runs of a sweep with everything they train with, and the folder that holds them to it."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from usvnet import __version__
from usvnet.files import atomic_write
from usvnet.network.variants import VARIANTS
from usvnet.sweep.grid import EPOCHS, OF_THE_SWEEP, SEED, VARIANT, Sweep
from usvnet.training_cli import TrainingConfiguration

CONFIGURATION = "configuration.yaml"
"""In a run's folder: every key that it trains with."""
MANIFEST = "sweep.json"


@dataclass(frozen=True)
class Run:
    """One training run."""

    name: str
    folder: Path
    choices: dict[str, Any]
    """What it has of the grid."""
    configuration: dict[str, Any]
    """Dotted key -> value, every one that train.py knows."""
    text: str
    """The same as YAML, as train.py reads it."""

    @property
    def variant(self) -> str:
        """Which network."""
        return str(self.configuration[VARIANT])

    @property
    def epochs(self) -> int:
        """For how long it trains."""
        return int(self.configuration[EPOCHS])

    @property
    def seed(self) -> Any:
        """Of everything random."""
        return self.configuration[SEED]

    @property
    def eval_size_px(self) -> int:
        """Side of the square picture that it is scored on."""
        return int(self.configuration["data.eval_image_size"] or self.configuration["data.image_size"])

    @property
    def sha256(self) -> str:
        """Of the configuration."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def plan_runs(sweep: Sweep, out: Path, data: str | None = None) -> list[Run]:
    """Resolve every run's configuration: the experiment, the sweep's settings, the run's choices.

    Args:
        sweep: what to run.
        out: folder of the sweep; each run gets one in it.
        data: dataset folder in the place of the experiment's.

    Raises:
        ValueError: a key is unknown or a value does not fit.
    """
    given = sweep.settings | ({"data.root": data} if data else {})
    command_line = ["--config", str(sweep.experiment), *(_option(key, value) for key, value in given.items())]
    parser = TrainingConfiguration(command_line)
    runs = []
    for name, choices in sweep.runs().items():
        options = [_option(key, value) for key, value in choices.items()]
        content = {
            key: value for key, value in parser.resolve([*command_line, *options]).items() if key not in OF_THE_SWEEP
        }
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
        run = Run(name, out / name, choices, dict(_flat(content)), text)
        if run.variant not in VARIANTS:
            raise ValueError(f"{VARIANT}: got {run.variant!r}, expected one of {', '.join(VARIANTS)}")
        runs.append(run)
    return runs


def claim_folder(out: Path, runs: list[Run], config: Path) -> None:
    """Put every run's configuration in its folder, or insist that it is the one that the run was begun with.

    Raises:
        ValueError: a run was begun with another value of some key, or the folder holds something else.
    """
    if out.is_dir() and not (out / MANIFEST).is_file() and any(out.iterdir()):
        raise ValueError(f"{out} holds other files and no {MANIFEST}: choose another folder")
    for run in runs:
        path = run.folder / CONFIGURATION
        if path.is_file():
            _insist(path, dict(_flat(yaml.safe_load(path.read_text(encoding="utf-8")))), run.configuration)
    manifest = {
        "usvnet": __version__,
        "config": config.read_text(encoding="utf-8"),
        "configuration_sha256": {run.name: run.sha256 for run in runs},
    }
    with atomic_write(out / MANIFEST) as temporary:
        temporary.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    for run in runs:
        if not (run.folder / CONFIGURATION).is_file():
            with atomic_write(run.folder / CONFIGURATION) as temporary:
                temporary.write_text(run.text, encoding="utf-8")


def _insist(path: Path, begun: dict[str, Any], now: dict[str, Any]) -> None:
    for key in sorted(begun.keys() | now.keys()):
        if begun.get(key) != now.get(key):
            raise ValueError(
                f"{path}: the run was begun with {key} {begun.get(key)!r}, now it is {now.get(key)!r}: "
                "undo the change, delete the run's folder, or choose another --out"
            )


def _option(key: str, value: Any) -> str:
    return f"--{key}={value if isinstance(value, str) else json.dumps(value)}"


def _flat(content: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in content.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
