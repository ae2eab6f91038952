"""How far the stated uncertainty can be believed, as people read it: intervals, reliability curve, floor."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usvnet.evaluation.floor import FloorScores
from usvnet.evaluation.interval_metrics import Honesty, IntervalErrors, IntervalScores, reliability
from usvnet.evaluation.range_metrics import RangedBoat
from usvnet.evaluation.records import ESTIMATORS, FloatArray
from usvnet.evaluation.tables import Cell, Column, Table
from usvnet.files import atomic_write
from usvnet.intervals import Z_90
from usvnet.wording import counted

ALL = "all"
BEFORE, AFTER = "before", "calibrated"


def interval_table(scores: IntervalScores, group: str) -> Table:
    """Coverage, width and likelihood before and after calibration, by ``scene`` or by ``distance``."""
    rows: list[list[Cell]] = []
    for key, estimator, errors in _groups(scores, group):
        for when, honesty in _halves(scores, estimator, errors):
            rows.append(
                [key, estimator, when, errors.n, honesty.coverage_68, honesty.width_68_m, honesty.coverage_90,
                 honesty.width_90_m, honesty.negative_log_likelihood]
            )  # fmt: skip
    return Table(
        title=f"Intervals by {group}, metres",
        columns=[
            *(Column(name) for name in (group.capitalize(), "Estimator", "sigma", "n")),
            Column("68 % hit", digits=0, percent=True),
            Column("68 % width", digits=2),
            Column("90 % hit", digits=0, percent=True),
            Column("90 % width", digits=2),
            Column("NLL", digits=2),
        ],
        rows=rows,
        strong=frozenset(n for n, row in enumerate(rows) if row[0] == ALL),
        rules=frozenset(n for n in range(len(rows) - 1) if rows[n][0] != rows[n + 1][0]),
        note=f"hit: share of readings inside the interval; NLL: mean negative log likelihood. {_calibration(scores)}",
    )


def floor_table(scores: FloorScores) -> Table:
    """RMSE beside the least that the network's own pixel noise allows."""
    rows: list[list[Cell]] = []
    for key, by_estimator in [*scores.by_distance.items(), (ALL, scores.overall)]:
        for estimator, floor in by_estimator.items():
            noise_px = scores.waterline_noise_px.get(key)
            rows.append([key, estimator, floor.n, noise_px, floor.rmse_m, floor.floor_m, floor.ratio])
    return Table(
        title="RMSE and Cramer-Rao floor, metres",
        columns=[
            *(Column(name) for name in ("Distance", "Estimator", "n")),
            Column("noise px", digits=2),
            *(Column(name) for name in ("RMSE", "floor")),
            Column("ratio", digits=2),
        ],
        rows=rows,
        strong=frozenset(range(len(rows) - len(ESTIMATORS), len(rows))),
        rules=frozenset(range(len(ESTIMATORS) - 1, len(rows), len(ESTIMATORS))),
        note="floor: the keypoints' measured errors (robust, by distance bin) and the camera file's sigmas carried "
        "through the geometry; noise: vertical, of the waterline keypoints.",
    )


def draw_reliability(ranged: Sequence[RangedBoat], scores: IntervalScores, path: Path) -> None:
    """Write a PNG: for every nominal coverage the share of readings that are inside, one panel for each estimator."""
    figure = Figure(figsize=(3.8 * len(ESTIMATORS) + 0.6, 4.6), layout="constrained")
    panels = figure.subplots(1, len(ESTIMATORS), sharey=True, squeeze=False)[0]
    for panel, estimator in zip(panels, ESTIMATORS):
        draw_reliability_panel(panel, ranged, scores, estimator)
    panels[0].set_ylabel("readings inside the interval, %")
    handles, labels = panels[0].get_legend_handles_labels()
    if handles:
        panels[0].legend(handles, labels, loc="upper left", fontsize="small")
    figure.suptitle("Reliability of the range intervals")
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=120)


def draw_reliability_panel(panel: Axes, ranged: Sequence[RangedBoat], scores: IntervalScores, estimator: str) -> None:
    """Draw the reliability of one estimator, with labelled lines."""
    errors = scores.overall[estimator]
    panel.plot([0, 100], [0, 100], color="0.5", linewidth=1)
    panel.set(
        title=f"{estimator}, {counted(errors.n, 'boat')}", xlabel="nominal coverage, %", xlim=(0, 100), ylim=(0, 100)
    )
    panel.set_box_aspect(1)
    panel.grid(alpha=0.3)
    if errors.n:
        _draw_curves(panel, ranged, scores, estimator, np.linspace(0.02, 0.98, 49))


def interval_csv(scores: IntervalScores, group: str) -> Table:
    """The table of :func:`interval_table` with plain names."""
    table = interval_table(scores, group)
    names = (group, "estimator", "sigma", "n", "coverage_68", "width_68_m", "coverage_90", "width_90_m",
             "negative_log_likelihood")  # fmt: skip
    return Table("", [Column(name) for name in names], table.rows)


def floor_csv(scores: FloorScores) -> Table:
    """The table of :func:`floor_table` with plain names."""
    names = ("distance", "estimator", "n", "waterline_noise_px", "rmse_m", "floor_m", "ratio")
    return Table("", [Column(name) for name in names], floor_table(scores).rows)


def _draw_curves(
    panel: Axes, ranged: Sequence[RangedBoat], scores: IntervalScores, estimator: str, nominal: FloatArray
) -> None:
    errors = scores.overall[estimator]
    chance = 100 * Z_90 * np.sqrt(nominal * (1 - nominal) / errors.n)
    panel.fill_between(
        100 * nominal, 100 * nominal - chance, 100 * nominal + chance, color="0.85", label="90 % by chance"
    )
    raw, calibrated = reliability(ranged, estimator, nominal)
    panel.plot(100 * nominal, 100 * raw, color="tab:red", label="raw sigma")
    if scores.calibration_boats[estimator]:
        panel.plot(100 * nominal, 100 * calibrated, color="tab:blue", label="calibrated sigma")
        reached = [100 * errors.after.coverage_68, 100 * errors.after.coverage_90]
        panel.plot([68, 90], reached, "o", color="tab:blue", label="68 % and 90 % intervals")


def _groups(scores: IntervalScores, group: str) -> Iterator[tuple[str, str, IntervalErrors]]:
    groups = scores.by_scene if group == "scene" else scores.by_distance
    for key, by_estimator in [*groups.items(), (ALL, scores.overall)]:
        for estimator, errors in by_estimator.items():
            yield key, estimator, errors


def _halves(scores: IntervalScores, estimator: str, errors: IntervalErrors) -> list[tuple[str, Honesty]]:
    """Both halves where there was a calibration between them."""
    if not scores.calibration_boats[estimator]:
        return [("raw", errors.before)]
    return [(BEFORE, errors.before), (AFTER, errors.after)]


def _calibration(scores: IntervalScores) -> str:
    known = {name: boats for name, boats in scores.calibration_boats.items() if boats}
    missing = [name for name in ESTIMATORS if name not in known]
    counts = ", ".join(f"{counted(boats, 'boat')} ({name})" for name, boats in known.items())
    told = f"Calibrated on {counts}. " if known else ""
    return told + (f"Not calibrated, factor 1: {', '.join(missing)}." if missing else "")
