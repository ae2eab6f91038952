"""Drawing on one panel: scatter of ranges, grouped bars, grouped boxes, precision over recall."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from usvnet.evaluation.pose_metrics import PoseScores
from usvnet.evaluation.range_metrics import RangedBoat
from usvnet.evaluation.records import FloatArray
from usvnet.intervals import ESTIMATORS

MARKERS = "osD^vP*X"
"""One for each group of a scatter, so that it does not hang on colour alone."""
MANY = 1500
"""More points than these are drawn as a picture, or the page would grow without end."""
WHISKERS = (5, 95)
"""Percentiles."""


def draw_scatter(panel: Axes, groups: Mapping[str, Sequence[RangedBoat]], estimator: str) -> None:
    """Draw predicted over measured range with 90 % intervals; a group has its colour and marker.

    The panel reaches a quarter beyond the farthest reading; what is predicted farther away lies on its upper edge.
    """
    readings = [item.truth.range_m for boats in groups.values() for item in boats]
    reach_m = 1.25 * max(readings, default=1.0)
    panel.plot([0, reach_m], [0, reach_m], color="0.5", linewidth=1)
    for n, boats in enumerate(groups.values()):
        found = [(item.truth.range_m, item.boat.ranges[estimator]) for item in boats if item.boat is not None]
        points = [(read_m, e.slant_m, e.half_width_90_m) for read_m, e in found if e.usable]
        measured_m, predicted_m, half_m = np.array(points).reshape(-1, 3).T
        panel.errorbar(
            measured_m,
            np.minimum(predicted_m, reach_m),
            yerr=np.where(predicted_m < reach_m, half_m, 0.0),
            fmt=MARKERS[n % len(MARKERS)],
            color=f"C{n % 10}",
            markersize=3.5,
            elinewidth=0.9,
            alpha=0.75,
            clip_on=True,
            rasterized=len(readings) > MANY,
        )
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_locator(MaxNLocator(6, steps=(1, 2, 5, 10)))
    panel.set(title=estimator, xlabel="measured, m", ylabel="predicted, m", xlim=(0, reach_m), ylim=(0, 1.02 * reach_m))
    panel.grid(alpha=0.3)


def draw_bars(
    panel: Axes,
    groups: Sequence[str],
    heights: Mapping[str, Sequence[float]],
    marks: Mapping[str, Sequence[float]],
    ylabel: str,
) -> None:
    """Draw a bar for each estimator in each group, and a diamond beside it where there is another figure to compare."""
    width = 0.8 / len(ESTIMATORS)
    for n, estimator in enumerate(ESTIMATORS):
        x = _places(n, len(groups))
        panel.bar(x, np.nan_to_num(heights[estimator]), 0.9 * width, color=f"C{n}", alpha=0.85)
        if estimator in marks:
            panel.plot(x, marks[estimator], "D", color="black", markersize=4, markerfacecolor="white")
    _name_groups(panel, groups)
    panel.set_ylim(0)
    panel.set_ylabel(ylabel)


def draw_boxes(panel: Axes, groups: Sequence[str], errors: Mapping[str, Sequence[FloatArray]], ylabel: str) -> None:
    """Draw a box for each estimator in each group: quartiles, median, and whiskers to the 5th and 95th percentile."""
    width = 0.8 / len(ESTIMATORS)
    panel.axhline(0, color="0.5", linewidth=1)
    for n, estimator in enumerate(ESTIMATORS):
        line = {"color": f"C{n}"}
        panel.boxplot(
            [np.asarray(members) for members in errors[estimator]],
            positions=_places(n, len(groups)),
            widths=0.75 * width,
            whis=WHISKERS,
            showfliers=False,
            patch_artist=True,
            boxprops={"facecolor": f"C{n}", "edgecolor": f"C{n}", "alpha": 0.45},
            medianprops={**line, "linewidth": 2},
            whiskerprops=line,
            capprops=line,
        )
    _name_groups(panel, groups)
    panel.set_ylabel(ylabel)


def draw_precision_recall(panel: Axes, recall: FloatArray, precision: FloatArray, pose: PoseScores, title: str) -> None:
    """Draw precision (10, 101) over recall (101,), per cent, at OKS 0.5, 0.75 and as the mean of all ten."""
    for n, row in enumerate((precision[0], precision[5], precision.mean(0))):
        panel.plot(100 * recall, 100 * row, color=f"C{n}", drawstyle="steps-pre")
    panel.plot([100 * pose.recall], [100 * pose.precision], "D", color="black", markersize=5, markerfacecolor="white")
    panel.set(title=title, xlabel="recall, %", ylabel="precision, %", xlim=(0, 101), ylim=(0, 103))
    panel.grid(alpha=0.3)


def _places(estimator: int, groups: int) -> FloatArray:
    """Where the bars of an estimator stand: groups at 0, 1, 2, their members side by side."""
    width = 0.8 / len(ESTIMATORS)
    return np.arange(groups, dtype=np.float64) + (estimator - (len(ESTIMATORS) - 1) / 2) * width


def _name_groups(panel: Axes, groups: Sequence[str]) -> None:
    panel.set_xticks(range(len(groups)), groups)
    panel.tick_params(axis="x", length=0)
    panel.set_xlim(-0.5, len(groups) - 0.5)
    panel.grid(alpha=0.3, axis="y")
    panel.set_axisbelow(True)
