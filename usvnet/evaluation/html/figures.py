"""What a figure of the page is, and those of poses, ranges and their errors."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

from usvnet.evaluation.html.charts import MARKERS, draw_bars, draw_boxes, draw_precision_recall, draw_scatter
from usvnet.evaluation.html.svg import SMALL_IN, Panel, draw_panel
from usvnet.evaluation.paper_tables import TABLE_3
from usvnet.evaluation.pose_metrics import precision_recall
from usvnet.evaluation.range_metrics import RangedBoat, RangeErrors, group_boats, usable_errors
from usvnet.evaluation.records import BoatRecord, TruthRecord
from usvnet.evaluation.scores import Scores
from usvnet.intervals import ESTIMATORS
from usvnet.wording import counted

GLYPHS = dict(zip(MARKERS, "●■◆▲▼✚★✖"))
LINE, DIAMOND = "━", "◇"
NO_SCENE = "no scene"


class Key(NamedTuple):
    """An entry of a legend."""

    glyph: str
    colour: str
    """A variable of the page's style sheet."""
    text: str


class Figure(NamedTuple):
    """Panels with what there is to say about them."""

    caption: str
    panels: list[Panel]
    legend: list[Key]


HEADLINE = "fused"
"""The estimator that the key figures, the worst pictures and the labels tell of: what ``usvnet predict`` shows."""
ESTIMATOR_KEYS = [Key("■", f"--c{n}", name) for n, name in enumerate(ESTIMATORS)]


def precision_recall_figure(
    records: Sequence[Sequence[BoatRecord]], truths: Sequence[Sequence[TruthRecord]], scores: Scores
) -> Figure:
    """Precision over recall at both OKS sigmas."""
    panels = []
    for name, pose, sigma in (("paper", scores.pose, "1/7"), ("strict", scores.pose_strict, "0.025")):
        recall, precision = precision_recall(records, truths, pose.sigma)
        title = f"OKS sigma {sigma}"
        draw = partial(draw_precision_recall, recall=recall, precision=precision, pose=pose, title=title)
        label = f"Precision over recall at OKS sigma {sigma}: mAP50 {pose.map50:.3f}, mAP50-95 {pose.map50_95:.3f}"
        panels.append(draw_panel(f"precision-recall-{name}", label, draw))
    keys = [Key(LINE, f"--c{n}", text) for n, text in enumerate(("OKS 0.5", "OKS 0.75", "mean of OKS 0.5 to 0.95"))]
    caption = (
        f"Precision and recall of {counted(scores.pose.boats, 'labelled boat')} as the lowest score changes. A boat is "
        "right where its keypoints reach the OKS; the smaller sigma is the stricter judge."
    )
    return Figure(caption, panels, [*keys, Key(DIAMOND, "--ink", "best F1 at OKS 0.5")])


def scatter_figure(ranged: Sequence[RangedBoat], scores: Scores) -> Figure:
    """Predicted over measured range by estimator, coloured by scene."""
    groups = group_boats(ranged)[0]
    rest = [item for item in ranged if item.truth.scene is None]
    if rest:
        groups = {**groups, NO_SCENE: rest}
    panels = [
        draw_panel(
            f"scatter-{estimator}",
            f"Predicted over measured range by {estimator}: {_errors_text(scores.ranges.overall[estimator])}",
            partial(draw_scatter, groups=groups, estimator=estimator),
            SMALL_IN,
        )
        for estimator in ESTIMATORS
    ]
    keys = [
        Key(GLYPHS[MARKERS[n % len(MARKERS)]], f"--c{n % 10}", scene if scene == NO_SCENE else f"scene {scene}")
        for n, scene in enumerate(groups)
    ]
    caption = (
        "Range by each estimator beside the laser's, with its 90 % interval. On the line is right, above it too far. "
        "What is farther than the panel reaches lies on its upper edge, without an interval; boats without a range are "
        "left out here and counted in the tables."
    )
    return Figure(caption, panels, [] if list(groups) == [NO_SCENE] else keys)


def error_figure(ranged: Sequence[RangedBoat], scores: Scores, by: str) -> Figure | None:
    """RMSE and spread of the error by ``distance`` or by ``scene``; None where there are no such groups."""
    members = group_boats(ranged)[by == "distance"]
    errors = scores.ranges.by_distance if by == "distance" else scores.ranges.by_scene
    if not members:
        return None
    titles = [f"{group}\n{len(boats)}" for group, boats in members.items()]
    rmse_m = {name: [errors[group][name].rmse_m for group in members] for name in ESTIMATORS}
    spread_m = {name: [usable_errors(boats, name)[0] for boats in members.values()] for name in ESTIMATORS}
    marks, mark = _floor(scores, list(members)) if by == "distance" else _paper(list(members))
    spoken = "; ".join(f"{group}: {_errors_text(errors[group][HEADLINE])}" for group in members)
    panels = [
        draw_panel(
            f"rmse-by-{by}",
            f"RMSE by {by} and estimator. {HEADLINE}: {spoken}",
            partial(draw_bars, groups=titles, heights=rmse_m, marks=marks, ylabel="RMSE, m"),
        ),
        draw_panel(
            f"errors-by-{by}",
            f"Spread of the error by {by} and estimator: quartiles and 5th to 95th percentile",
            partial(draw_boxes, groups=titles, errors=spread_m, ylabel="predicted - measured, m"),
        ),
    ]
    caption = (
        f"Error by {by}; the second line says how many boats. First the RMSE, then the error's median, "
        "quartiles, and whiskers to the 5th and 95th percentile; above 0 is too far."
    )
    return Figure(caption, panels, [*ESTIMATOR_KEYS, *([Key(DIAMOND, "--ink", mark)] if marks else [])])


def _floor(scores: Scores, groups: Sequence[str]) -> tuple[Mapping[str, list[float]], str]:
    if scores.floor is None:
        return {}, ""
    by_distance = scores.floor.by_distance
    floors = {
        name: [by_distance[g][name].floor_m if g in by_distance else float("nan") for g in groups]
        for name in ESTIMATORS
    }
    return floors, "Cramer-Rao floor of the keypoints' own noise"


def _paper(groups: Sequence[str]) -> tuple[Mapping[str, list[float]], str]:
    printed = {
        name: [by_scene[group].rmse_m if group in by_scene else float("nan") for group in groups]
        for name, by_scene in TABLE_3.items()
    }
    known = any(group in by_scene for by_scene in TABLE_3.values() for group in groups)
    return (printed if known else {}), "the paper's Table 3, on its own photographs"


def _errors_text(errors: RangeErrors) -> str:
    if not errors.n:
        return f"no range, {errors.missed} missed"
    return f"{counted(errors.n, 'boat')}, RMSE {errors.rmse_m:.2f} m, {errors.missed} missed"
