"""The page: what it tells in which order, and the file that it is written to."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from usvnet.data.records import Frame
from usvnet.evaluation.examples import find_examples
from usvnet.evaluation.html.camera_study import study_commonest_camera
from usvnet.evaluation.html.doubt_figures import budget_figure, curves_figure, reliability_figure
from usvnet.evaluation.html.facts import now, page_facts
from usvnet.evaluation.html.figures import HEADLINE, error_figure, precision_recall_figure, scatter_figure
from usvnet.evaluation.html.pictures import MISSED, missed_examples, tiles, worst_examples
from usvnet.evaluation.paper_tables import SOURCE
from usvnet.evaluation.range_metrics import ranged_boats
from usvnet.evaluation.records import BoatRecord, TruthRecord
from usvnet.evaluation.report import distance_table, keypoint_table, pose_table, range_table
from usvnet.evaluation.scores import Scores
from usvnet.evaluation.sensitivity_report import budget_table
from usvnet.evaluation.tables import Table
from usvnet.evaluation.uncertainty_report import floor_table, interval_table
from usvnet.files import atomic_write
from usvnet.wording import counted


@dataclass(frozen=True)
class Evaluation:
    """Everything that the page tells of."""

    model: str
    """Its name, such as ``usvnet-n``."""
    frames: Sequence[Frame]
    """The P pictures."""
    records: Sequence[Sequence[BoatRecord]]
    """Their predicted boats, in native pixels."""
    truths: Sequence[Sequence[TruthRecord]]
    """Their labelled boats, in native pixels."""
    scores: Scores
    curved_water: bool
    made_with: Mapping[str, object]
    """What the predictions depend on, among it ``split``, and where the weights came from."""
    configuration: str = ""
    """Every setting of the evaluation, as YAML."""


class Tile(NamedTuple):
    """A key figure."""

    name: str
    value: str
    note: str


class Row(NamedTuple):
    """A row of a table that is shown."""

    cells: list[str]
    strong: bool


def write_page(evaluation: Evaluation, path: Path | str) -> None:
    """Write the page, whole or not at all.

    Raises:
        ValueError: a picture is damaged.
    """
    page = render_page(evaluation)
    with atomic_write(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def render_page(evaluation: Evaluation) -> str:
    """Make the page's HTML; every text in it is escaped."""
    environment = Environment(
        loader=PackageLoader("usvnet.evaluation.html"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["rows_by_group"] = rows_by_group
    environment.filters |= {"counted": counted, "in_two_lines": in_two_lines}
    return environment.get_template("report.html").render(
        evaluation=evaluation,
        estimator=HEADLINE,
        source=SOURCE,
        split=evaluation.made_with.get("split", "pictures"),
        written=now(),
        key_figures=key_figures(evaluation.scores),
        facts=page_facts(evaluation.made_with),
        **_pose(evaluation),
        **_range(evaluation),
        **_pictures(evaluation),
        **_sensitivity(evaluation),
    )


def key_figures(scores: Scores) -> list[Tile]:
    """The few figures that most people come for."""
    keypoints, ranges = scores.keypoints, scores.ranges.overall[HEADLINE]
    boats = keypoints.matched + keypoints.missed
    found = 100 * keypoints.matched / boats if boats else math.nan
    tiles = [
        Tile("Boats found", _number(found, "{:.0f} %"), f"{keypoints.matched} of {boats}"),
        Tile("mAP50-95", _number(scores.pose.map50_95, "{:.3f}"), "OKS sigma 1/7, the paper's"),
        Tile("mAP50-95, strict", _number(scores.pose_strict.map50_95, "{:.3f}"), "OKS sigma 0.025"),
        Tile("Keypoint error", _number(keypoints.overall.median_px, "{:.1f} px"), "median, pixels of the picture"),
    ]
    if scores.ranges.by_distance:
        share, inside = 100 * ranges.median_relative_error, 100 * ranges.coverage_90
        tiles += [
            Tile("Range error", _number(share, "{:.1f} %"), f"median, {HEADLINE}, {ranges.missed} without a range"),
            Tile("RMSE", _number(ranges.rmse_m, "{:.2f} m"), f"{HEADLINE}, over {counted(ranges.n, 'boat')}"),
            Tile("In 90 % interval", _number(inside, "{:.0f} %"), f"of the laser's readings, {HEADLINE}"),
        ]
    return tiles


def in_two_lines(title: str) -> list[str]:
    """Break the title of a column: ``pitch 0.3 deg`` before its number, any other before its last word."""
    return re.split(r" (?=-?[\d.]+ \S+$)", title) if re.search(r" -?[\d.]+ \S+$", title) else title.rsplit(" ", 1)


def rows_by_group(table: Table) -> list[list[Row]]:
    """The rows of a table, those that begin alike together."""
    rows = [Row(cells, n in table.strong) for n, cells in enumerate(table.shown())]
    return [list(members) for _, members in groupby(rows, key=lambda row: row.cells[0])]


def _pose(of: Evaluation) -> dict[str, Any]:
    labelled = of.scores.pose.boats > 0
    return {
        "pose": pose_table(of.scores, of.model),
        "keypoints": keypoint_table(of.scores),
        "precision_recall": precision_recall_figure(of.records, of.truths, of.scores) if labelled else None,
    }


def _range(of: Evaluation) -> dict[str, Any]:
    ranged, scores = ranged_boats(of.records, of.truths, of.scores.range_confidence), of.scores
    if not ranged:
        return {"ranged": 0}
    return {
        "ranged": len(ranged),
        "scatter": scatter_figure(ranged, scores),
        "range_tables": [*([range_table(scores)] if scores.ranges.by_scene else []), distance_table(scores)],
        "errors": [figure for by in ("distance", "scene") if (figure := error_figure(ranged, scores, by))],
        "floor": None if scores.floor is None else floor_table(scores.floor),
        "reliability": reliability_figure(ranged, scores),
        "interval_tables": [interval_table(scores.intervals, group) for group in ("distance", "scene")],
    }


def _pictures(of: Evaluation) -> dict[str, Any]:
    examples = find_examples(of.frames, of.records, of.truths, of.scores.range_confidence, HEADLINE)
    missed = missed_examples(examples)
    return {
        "worst": tiles(worst_examples(examples), HEADLINE),
        "missed": tiles(missed[:MISSED], HEADLINE),
        "missed_pictures": len(missed),
    }


def _sensitivity(of: Evaluation) -> dict[str, Any]:
    study = study_commonest_camera(of.frames, of.curved_water)
    if study is None:
        return {"budget": None}
    return {
        "budget": budget_figure(study),
        "budget_table": budget_table(study.budget),
        "curves": curves_figure(study, HEADLINE),
    }


def _number(value: float, pattern: str) -> str:
    return pattern.format(value) if math.isfinite(value) else "none"
