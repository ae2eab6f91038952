"""The figures of the page: panels, a legend of words, and a caption."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

from matplotlib.axes import Axes

from usvnet.evaluation.disturbances import DISTURBANCES
from usvnet.evaluation.html.camera_study import CURVES, CameraStudy
from usvnet.evaluation.html.charts import MARKERS, draw_bars, draw_boxes, draw_precision_recall, draw_scatter
from usvnet.evaluation.html.svg import SERIES, SMALL_IN, Panel, draw_panel
from usvnet.evaluation.paper_tables import TABLE_3
from usvnet.evaluation.pose_metrics import precision_recall
from usvnet.evaluation.range_metrics import RangedBoat, RangeErrors, group_boats, usable_errors
from usvnet.evaluation.records import BoatRecord, TruthRecord
from usvnet.evaluation.scores import Scores
from usvnet.evaluation.sensitivity import ALL
from usvnet.evaluation.sensitivity_report import (
    FIRST_ORDER_NOTE,
    amount_text,
    draw_budget_panel,
    draw_curve_panel,
    source_text,
)
from usvnet.evaluation.uncertainty_report import draw_reliability_panel
from usvnet.intervals import ESTIMATORS

GLYPHS = dict(zip(MARKERS, "●■▲◆▼⬟✱✖"))
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
        f"Precision and recall of {scores.pose.boats} labelled boats as the lowest score changes. A boat is right "
        "where its keypoints reach the OKS; the smaller sigma is the stricter judge."
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
    spoken = "; ".join(f"{group}: {_errors_text(errors[group][SPOKEN])}" for group in members)
    panels = [
        draw_panel(
            f"rmse-by-{by}",
            f"RMSE by {by} and estimator. {SPOKEN}: {spoken}",
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


def reliability_figure(ranged: Sequence[RangedBoat], scores: Scores) -> Figure:
    """Share of readings inside the interval of every nominal coverage."""
    panels = [
        draw_panel(
            f"reliability-{estimator}",
            f"Reliability of {estimator}, {errors.n} readings: {_share(errors.after.coverage_68)} in the 68 %, "
            f"{_share(errors.after.coverage_90)} in the 90 % interval",
            partial(_reliability, ranged=ranged, scores=scores, estimator=estimator),
            (4.0, 4.0),
        )
        for estimator, errors in scores.intervals.overall.items()
    ]
    caption = (
        "Of all intervals that should hold so many per cent of the readings, how many do. On the line is honest, below "
        "it too sure, above it too cautious."
    )
    legend = [Key(LINE, "--c3", "raw sigma"), Key("■", "--band", "90 % of honest sigmas by chance")]
    if any(scores.intervals.calibration_boats.values()):
        legend += [Key(LINE, "--c0", "calibrated sigma"), Key("●", "--c0", "68 % and 90 % intervals")]
    return Figure(caption, panels, legend)


def budget_figure(study: CameraStudy) -> Figure:
    """Cost of each thing that is not known exactly, by estimator."""
    panels = [
        draw_panel(
            f"budget-{name}",
            f"Error budget of {name} by distance",
            partial(_budget, study=study, estimator=name),
            SMALL_IN,
        )
        for name in ESTIMATORS
    ]
    sources = list(dict.fromkeys((cost.source, cost.amount) for cost in study.budget if cost.source != ALL))
    texts = [source_text(source, float(f"{amount:.2g}")) for source, amount in sources]
    keys = [Key(LINE, f"--c{n}", text) for n, text in enumerate(texts)]
    caption = (
        f"Error budget of the camera ({study.camera}): what each thing that its file does not know exactly costs, and "
        f"the network's own keypoint noise, {study.keypoint_std_px:.2f} px, one standard deviation; {FIRST_ORDER_NOTE}."
    )
    return Figure(caption, panels, [*keys, Key(LINE, "--ink", "all together")])


def curves_figure(study: CameraStudy, estimator: str) -> Figure:
    """What each kind of error does to one estimator."""
    panels = []
    for source, amounts in CURVES.items():
        title = DISTURBANCES[source].title
        texts = ", ".join(amount_text(source, amount) for amount in amounts)
        draw = partial(_curves, study=study, source=source, estimator=estimator)
        label = f"Range by {estimator} with {title} wrong by {texts}"
        panels.append(draw_panel(f"curve-{source}", label, draw, SMALL_IN))
    caption = (
        f"What one error does to the range by {estimator}, all else being right. Pitch, roll, height and focal length "
        "are wrong by a fixed amount; waves and keypoints stray by that standard deviation."
    )
    return Figure(caption, panels, [])


SPOKEN = ESTIMATORS[-1]
"""The estimator whose figures the labels tell; all are in the tables."""


def _reliability(panel: Axes, ranged: Sequence[RangedBoat], scores: Scores, estimator: str) -> None:
    draw_reliability_panel(panel, ranged, scores.intervals, estimator)
    panel.set_ylabel("readings inside, %")


def _budget(panel: Axes, study: CameraStudy, estimator: str) -> None:
    draw_budget_panel(panel, study.budget, estimator)
    panel.set(xlabel="slant range, m", ylabel="cost, % of the range")


def _curves(panel: Axes, study: CameraStudy, source: str, estimator: str) -> None:
    draw_curve_panel(panel, study.curves, source, estimator, SERIES)
    panel.legend(fontsize="small", frameon=False)


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
    return f"{errors.n} boats, RMSE {errors.rmse_m:.2f} m, {errors.missed} missed"


def _share(share: float) -> str:
    return "none" if share != share else f"{100 * share:.0f} %"
