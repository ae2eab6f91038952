"""A sweep's YAML: one experiment, keys changed in every run, and keys with several values each.

For example::

    experiment: ../experiment/quickstart.yaml # relative to this file
    settings:
      data.image_size: 128
    grid:
      model.variant: [n, s, m]
      trainer.max_epochs: [50, 100]
      seed_everything: [0, 1, 2]
      model.loss_weights.range: [0.0, 1.0]

Keys are those of train.py's command line. A run is one choice of every grid key; its name tells them.
"""

import itertools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usvnet.geometry.yaml_files import as_mapping, read_mapping, refuse_unknown, require

VARIANT, EPOCHS, SEED = "model.variant", "trainer.max_epochs", "seed_everything"
OF_THE_SWEEP = ("run_dir", "resume", "ckpt_path", "evaluate_after", "export_after", "config")
"""Keys that the sweep itself decides for every run."""


@dataclass(frozen=True)
class Sweep:
    """What a sweep's YAML says."""

    experiment: Path
    settings: dict[str, Any]
    """Key -> value of every run."""
    grid: dict[str, list[Any]]
    """Key -> values, each a run of its own."""

    def runs(self) -> dict[str, dict[str, Any]]:
        """Name -> what the run has of the grid, the last key's values changing fastest.

        Raises:
            ValueError: two runs would have the same name.
        """
        found: dict[str, dict[str, Any]] = {}
        for values in itertools.product(*self.grid.values()):
            choices = dict(zip(self.grid, values))
            name = run_name(choices)
            if name in found:
                raise ValueError(f"grid: two runs would be called {name}: expected values that differ")
            found[name] = choices
        return found


def load_sweep(path: Path) -> Sweep:
    """Read a sweep's YAML.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a key is unknown, missing or not as expected.
    """
    content = read_mapping(path)
    refuse_unknown(content, ("experiment", "settings", "grid"), str(path))
    experiment = path.parent / str(require(content, "experiment", str(path)))
    if not experiment.is_file():
        raise FileNotFoundError(f"{path}: experiment: {experiment}: no such file")
    grid = as_mapping(require(content, "grid", str(path)), f"{path}: grid")
    settings = as_mapping(content.get("settings") or {}, f"{path}: settings")
    for section, keys in (("grid", grid), ("settings", settings)):
        for key in keys:
            if key in OF_THE_SWEEP:
                raise ValueError(f"{path}: {section}: {key} is decided by the sweep for each run: leave it out")
    for key, values in grid.items():
        if not isinstance(values, list) or not values:
            raise ValueError(f"{path}: grid: {key}: expected a list of values, got {values!r}")
        if key in settings:
            raise ValueError(f"{path}: {key} stands under settings and under grid: expected one of the two")
    return Sweep(experiment, settings, grid)


def run_name(choices: dict[str, Any]) -> str:
    """Name a run by its choices, in whatever order they stand: ``m_100-epochs_range-1.0_seed-0``, fit for a folder."""
    if not choices:
        return "run"
    others = sorted(choices.keys() - {VARIANT, EPOCHS, SEED})
    return "_".join(_part(key, choices[key]) for key in (VARIANT, EPOCHS, *others, SEED) if key in choices)


def _part(key: str, value: Any) -> str:
    if key == VARIANT:
        text = str(value)
    elif key == EPOCHS:
        text = f"{value}-epochs"
    elif key == SEED:
        text = f"seed-{value}"
    else:
        text = f"{key.rsplit('.', 1)[-1]}-{value}"
    return re.sub(r"[^\w.+-]+", "-", text).strip("-.")
