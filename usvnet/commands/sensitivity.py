"""``usvnet sensitivity``: what an error of camera, keypoints or water costs in range."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from usvnet.evaluation.disturbances import DISTURBANCES
from usvnet.evaluation.records import ESTIMATORS
from usvnet.evaluation.sensitivity import SetErrors, Study
from usvnet.evaluation.sensitivity_of_predictions import predictions_errors
from usvnet.evaluation.sensitivity_report import (
    budget_sentences,
    budget_table,
    cost_csv,
    draw_budget,
    draw_curves,
    error_csv,
    error_table,
)
from usvnet.evaluation.sensitivity_settings import SensitivitySettings, load_sensitivity
from usvnet.evaluation.tables import Table
from usvnet.files import atomic_write
from usvnet.geometry.camera_files import load_camera
from usvnet.geometry.hull_files import load_hull
from usvnet.geometry.hull_model import generic_hull

TERMINAL_COLUMNS = 150


def sensitivity(
    *,
    config: Path,
    output: Path = Path("sensitivity"),
    camera: Path | None = None,
    predictions: Path | None = None,
    data: Path | None = None,
    split: str = "test",
) -> None:
    """Say what an error in focal length, attitude, height, lens, keypoints or water does to the range.

    Of a camera file it makes the error budget by distance: the share of the range that each thing costs which is not
    known exactly. Of the predictions that evaluate.py wrote it makes the paper's Table 5: the same keypoints, ranged
    anew with a camera that is wrong by so much.

    Args:
        config: Settings, such as one of configs/sensitivity/.
        output: Folder of the tables and plots.
        camera: Camera file to use in the place of the settings' one.
        predictions: The predictions.jsonl of an evaluation; with --data, and then no camera file is looked at.
        data: The dataset that was predicted, the folder that holds data.yaml.
        split: The split that was predicted.

    Raises:
        ValueError: a setting or an option is wrong, or the predictions are of something else.
        FileNotFoundError: no such file.
    """
    settings = load_sensitivity(config)
    if not settings.disturbances:
        raise ValueError(f"{config}: disturbances: expected at least one of {', '.join(DISTURBANCES)}")
    if camera is not None:
        settings = replace(settings, camera=camera)
    console = Console(highlight=False, markup=False, width=max(Console().width, TERMINAL_COLUMNS))
    if (predictions is None) != (data is None):
        raise ValueError("--predictions and --data are only of use together")
    if predictions is not None and data is not None:
        errors = predictions_errors(predictions, data, split, settings)
        tables = [error_table(errors, f"{split} split of {data}")]
        _write(output, tables, [], errors)
        tables[0].print(console)
    else:
        study_camera(settings, config, output, console)
    console.print(f"written to {output}", soft_wrap=True)


def study_camera(settings: SensitivitySettings, config: Path, output: Path, console: Console) -> None:
    """Budget, curves and table of a camera file."""
    if settings.camera is None:
        raise ValueError(f"{config}: camera is missing: name it there or with --camera")
    hull = generic_hull() if settings.hull is None else load_hull(settings.hull)
    study = Study(settings, load_camera(settings.camera), hull)
    budget, curves, errors = study.budget(), study.curves(), study.table()
    distances = ", ".join(f"{distance:g}" for distance in settings.distances_m)
    tables = [budget_table(budget), error_table(errors, f"boats at {distances} m")]
    sentences = budget_sentences(budget)
    cost_csv(budget).write_csv(output / "budget.csv")
    cost_csv(curves).write_csv(output / "curves.csv")
    draw_budget(budget, output / "budget.png")
    for estimator in ESTIMATORS:
        draw_curves(curves, estimator, output / f"curves_{estimator}.png")
    _write(output, tables, sentences, errors)
    for table in tables:
        table.print(console)
    for sentence in sentences:
        console.print(sentence, soft_wrap=True)


def _write(output: Path, tables: Sequence[Table], sentences: Sequence[str], errors: Sequence[SetErrors]) -> None:
    """Write sensitivity.md and errors.csv."""
    text = ["# Sensitivity of the range", "", *(table.to_markdown() for table in tables)]
    text += [f"- {sentence}" for sentence in sentences]
    pictures = [name for name in ("budget", *(f"curves_{e}" for e in ESTIMATORS)) if (output / f"{name}.png").is_file()]
    text += ["", *(f"![{name}]({name}.png)\n" for name in pictures if sentences)]
    with atomic_write(output / "sensitivity.md") as temporary:
        temporary.write_text("\n".join(text), encoding="utf-8")
    error_csv(errors).write_csv(output / "errors.csv")
