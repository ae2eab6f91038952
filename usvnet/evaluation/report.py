"""Scores as people read them: the paper's two tables with its figures beside ours, in terminal, Markdown and CSV."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from rich.console import Console

from usvnet.evaluation.paper_tables import SCENE_TITLES, SOURCE, TABLE_2, TABLE_3
from usvnet.evaluation.pose_metrics import PoseScores
from usvnet.evaluation.range_metrics import RangeErrors
from usvnet.evaluation.records import ESTIMATORS
from usvnet.evaluation.scores import Scores
from usvnet.evaluation.tables import Cell, Column, Table
from usvnet.evaluation.uncertainty_report import floor_csv, floor_table, interval_csv, interval_table
from usvnet.files import atomic_write
from usvnet.wording import counted

ALL = "all"
TERMINAL_COLUMNS = 96
"""What the widest table needs; a narrower terminal wraps its lines and a log file keeps them whole."""


def pose_table(scores: Scores, model: str) -> Table:
    """Precision, recall and AP at both OKS sigmas, above the rows of the paper's Table 2."""

    def ours(pose: PoseScores, sigma: str) -> list[Cell]:
        return [model, sigma, pose.precision, pose.recall, pose.map50, pose.map50_95]

    paper: list[list[Cell]] = [
        [f"paper: {p.model}", "1/7", p.precision, p.recall, p.map50, p.map50_95] for p in TABLE_2
    ]
    return Table(
        title="Pose",
        columns=[Column(name) for name in ("Model", "OKS sigma", "Precision", "Recall", "mAP50", "mAP50-95")],
        rows=[
            ours(scores.pose, "1/7"),
            ours(scores.pose_strict, "0.025"),
            *paper,
        ],
        strong=frozenset({0, 1}),
        rules=frozenset({1}),
        note="Precision and recall at the score of best F1, matched at OKS 0.5. "
        "The paper's rows were measured on its own photographs.",
    )


def range_table(scores: Scores) -> Table:
    """Range errors by scene and estimator, beside the paper's Table 3."""
    rows: list[list[Cell]] = []
    for scene, estimator, errors in _groups(scores.ranges.by_scene, scores.ranges.overall):
        paper = TABLE_3.get(estimator, {}).get(scene)
        shown = [errors.n, errors.missed, errors.mse_m2, errors.rmse_m, errors.mae_m]
        rows.append([scene, estimator, *shown, *(paper or (None, None, None))])
    names = ("Scene", "Estimator", "n", "missed", "MSE", "RMSE", "MAE", "paper MSE", "paper RMSE", "paper MAE")
    scenes = "; ".join(f"{scene} {title}" for scene, title in SCENE_TITLES.items() if scene in scores.ranges.by_scene)
    return Table(
        title="Slant range by scene, metres",
        columns=[Column(name) for name in names],
        rows=rows,
        strong=_last_group(rows),
        rules=_group_ends(rows),
        note=f"{_missed_note(scores)} {scenes}".strip(),
    )


def distance_table(scores: Scores) -> Table:
    """Range errors by distance."""
    rows: list[list[Cell]] = [
        [distance, estimator, e.n, e.missed, e.rmse_m, e.mae_m, e.median_relative_error, e.bias_m]
        for distance, estimator, e in _groups(scores.ranges.by_distance, scores.ranges.overall)
    ]  # fmt: skip
    return Table(
        title="Slant range by distance, metres",
        columns=[
            *(Column(name) for name in ("Distance", "Estimator", "n", "missed", "RMSE", "MAE")),
            Column("rel. error", digits=1, percent=True),
            Column("bias"),
        ],
        rows=rows,
        strong=_last_group(rows),
        rules=_group_ends(rows),
        note="rel. error: median of |error| / reading; bias above 0: placed too far away.",
    )


def keypoint_table(scores: Scores) -> Table:
    """Distance of each keypoint from its label."""
    errors = {**scores.keypoints.by_keypoint, ALL: scores.keypoints.overall}
    return Table(
        title="Keypoint error, pixels of the picture",
        columns=[Column("Keypoint"), Column("n"), Column("median", digits=2), Column("95th percentile", digits=2)],
        rows=[[name, e.n, e.median_px, e.p95_px] for name, e in errors.items()],
        strong=frozenset({len(errors) - 1}),
        note=f"{counted(scores.keypoints.matched, 'boat')} matched, {scores.keypoints.missed} missed; "
        "keypoints seen, or hidden inside the picture.",
    )


def write_report(
    scores: Scores, output_dir: Path | str, model: str, facts: Mapping[str, object], pictures: Sequence[Path] = ()
) -> None:
    """Write report.md, metrics.json, pose.csv, keypoints.csv, range_by_*.csv, intervals_by_*.csv, floor.csv.

    Args:
        scores: what to write.
        output_dir: folder, made if need be.
        model: our row's name in the pose table.
        facts: what was evaluated, listed at the top of the Markdown.
        pictures: pictures to show in the Markdown, in ``output_dir``.
    """
    output_dir = Path(output_dir)
    tables = report_tables(scores, model)
    lines = [f"# Evaluation of {model}", "", *(f"- {name}: {value}" for name, value in facts.items())]
    lines += [f"- paper: {SOURCE}", "", *(table.to_markdown() for table in tables)]
    lines += [f"{sentence}\n"] if (sentence := nothing_found(scores)) else []
    lines += [f"![{picture.stem}]({picture.relative_to(output_dir).as_posix()})\n" for picture in pictures]
    with atomic_write(output_dir / "report.md") as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")
    with atomic_write(output_dir / "metrics.json") as temporary:
        temporary.write_text(scores.to_json(), encoding="utf-8")
    pose_table(scores, model).write_csv(output_dir / "pose.csv")
    keypoint_table(scores).write_csv(output_dir / "keypoints.csv")
    for name, groups in (("scene", scores.ranges.by_scene), ("distance", scores.ranges.by_distance)):
        _range_csv(name, groups, scores.ranges.overall).write_csv(output_dir / f"range_by_{name}.csv")
        interval_csv(scores.intervals, name).write_csv(output_dir / f"intervals_by_{name}.csv")
    if scores.floor is not None:
        floor_csv(scores.floor).write_csv(output_dir / "floor.csv")


def print_report(scores: Scores, model: str, console: Console | None = None) -> None:
    """Show the tables in the terminal."""
    console = console or Console(width=max(Console().width, TERMINAL_COLUMNS))
    for table in report_tables(scores, model):
        table.print(console)
        console.print()
    if sentence := nothing_found(scores):
        console.print(sentence)


def report_tables(scores: Scores, model: str) -> list[Table]:
    """All tables in the order of the report; the range tables only where a laser reading exists.

    Where no boat was found, only that of the pose: in the others there is nothing to tell (:func:`nothing_found`).
    """
    if nothing_found(scores):
        return [pose_table(scores, model)]
    ranged = []
    if scores.ranges.by_distance:
        ranged = [range_table(scores), distance_table(scores)]
        ranged += [interval_table(scores.intervals, group) for group in ("scene", "distance")]
        ranged += [] if scores.floor is None else [floor_table(scores.floor)]
    return [pose_table(scores, model), *ranged, keypoint_table(scores)]


def nothing_found(scores: Scores) -> str:
    """One sentence where boats were labelled and none of them was found; else empty."""
    if scores.keypoints.matched or not scores.keypoints.missed:
        return ""
    return (
        f"None of the {scores.keypoints.missed} labelled boats was found with a score of {scores.range_confidence:g}, "
        "so there are no ranges and no keypoint errors to show."
    )


def _range_csv(group: str, groups: dict[str, dict[str, RangeErrors]], overall: dict[str, RangeErrors]) -> Table:
    names = [field.name for field in dataclasses.fields(RangeErrors)]
    return Table(
        title="",
        columns=[Column(name) for name in (group, "estimator", *names)],
        rows=[[key, estimator, *dataclasses.astuple(errors)] for key, estimator, errors in _groups(groups, overall)],
    )


def _groups(
    groups: dict[str, dict[str, RangeErrors]], overall: dict[str, RangeErrors]
) -> Iterator[tuple[str, str, RangeErrors]]:
    for key, by_estimator in [*groups.items(), (ALL, overall)]:
        for estimator, errors in by_estimator.items():
            yield key, estimator, errors


def _group_ends(rows: Sequence[Sequence[Cell]]) -> frozenset[int]:
    return frozenset(range(len(ESTIMATORS) - 1, len(rows), len(ESTIMATORS)))


def _last_group(rows: Sequence[Sequence[Cell]]) -> frozenset[int]:
    return frozenset(range(len(rows) - len(ESTIMATORS), len(rows)))


def _missed_note(scores: Scores) -> str:
    return (
        f"n: boats ranged, which the errors are over; missed: not found with a score of {scores.range_confidence:g}, "
        "or without a valid range."
    )
