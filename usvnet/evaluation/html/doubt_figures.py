"""The figures of what is not known exactly: reliability of the intervals, error budget, one error at a time."""

from collections.abc import Sequence
from functools import partial

from matplotlib.axes import Axes

from usvnet.evaluation.disturbances import DISTURBANCES
from usvnet.evaluation.html.camera_study import CURVES, CameraStudy
from usvnet.evaluation.html.figures import LINE, Figure, Key
from usvnet.evaluation.html.svg import SERIES, SMALL_IN, draw_panel
from usvnet.evaluation.range_metrics import RangedBoat
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
from usvnet.wording import counted


def reliability_figure(ranged: Sequence[RangedBoat], scores: Scores) -> Figure:
    """Share of readings inside the interval of every nominal coverage."""
    panels = [
        draw_panel(
            f"reliability-{estimator}",
            f"Reliability of {estimator}, {counted(errors.n, 'reading')}: "
            f"{_share(errors.after.coverage_68)} in the 68 %, {_share(errors.after.coverage_90)} in the 90 % interval",
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
    texts = [source_text(source, amount) for source, amount in sources]
    keys = [Key(LINE, f"--c{n}", text) for n, text in enumerate(texts)]
    caption = (
        f"Error budget of the camera ({study.camera}), one standard deviation: what each thing costs that its file "
        "does not know exactly, and keypoints that stray by a pixel (how far they do, the floor tells); "
        f"{FIRST_ORDER_NOTE}."
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


def _reliability(panel: Axes, ranged: Sequence[RangedBoat], scores: Scores, estimator: str) -> None:
    draw_reliability_panel(panel, ranged, scores.intervals, estimator)
    panel.set_ylabel("readings inside, %")


def _budget(panel: Axes, study: CameraStudy, estimator: str) -> None:
    draw_budget_panel(panel, study.budget, estimator)
    panel.set(xlabel="slant range, m", ylabel="cost, % of the range")


def _curves(panel: Axes, study: CameraStudy, source: str, estimator: str) -> None:
    draw_curve_panel(panel, study.curves, source, estimator, SERIES)
    panel.set_title(panel.get_title(), pad=20)
    panel.legend(loc="lower center", bbox_to_anchor=(0.5, 0.98), ncols=3, fontsize="small", frameon=False)


def _share(share: float) -> str:
    return "none" if share != share else f"{100 * share:.0f} %"
