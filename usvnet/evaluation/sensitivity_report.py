"""Error budget and sensitivity as people read them: Markdown, CSV and PNG."""

import math
from collections.abc import Sequence
from dataclasses import astuple, fields
from pathlib import Path

from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from usvnet.evaluation.disturbances import DISTURBANCES
from usvnet.evaluation.paper_tables import TABLE_5
from usvnet.evaluation.records import ESTIMATORS
from usvnet.evaluation.sensitivity import ALL, Cost, SetErrors, costs_at
from usvnet.evaluation.tables import Cell, Column, Table
from usvnet.files import atomic_write

PAPER_ESTIMATOR = "waterline"
FIRST_ORDER_NOTE = "lines: first order; dots: through the real geometry"


def amount_text(source: str, amount: float) -> str:
    """``0.3 deg`` of ``pitch_deg``, to three digits; a number alone where there is no unit."""
    return f"{float(f'{amount:.3g}'):g} {DISTURBANCES[source].unit}".strip()


def source_text(source: str, amount: float) -> str:
    """``pitch 0.3 deg``; ``all`` is itself."""
    return ALL if source == ALL else f"{DISTURBANCES[source].title} {amount_text(source, amount)}"


def budget_table(costs: Sequence[Cost]) -> Table:
    """What each thing that is not known exactly costs, in per cent of the range, one standard deviation."""
    sources = list(dict.fromkeys((cost.source, cost.amount) for cost in costs if cost.source != ALL))
    rows: list[list[Cell]] = []
    for distance in dict.fromkeys(cost.distance_m for cost in costs):
        for estimator in ESTIMATORS:
            of = {cost.source: cost for cost in costs_at(costs, distance, estimator)}
            parts = [of[source].first_order for source, _ in sources]
            together = of[ALL]
            rows.append([f"{distance:g} m", estimator, *parts, together.first_order, together.exact, together.no_range])
    return Table(
        title="Error budget, share of the range, one standard deviation",
        columns=[
            Column("Distance"),
            Column("Estimator"),
            *(Column(source_text(source, amount), digits=2, percent=True) for source, amount in sources),
            Column("all", digits=2, percent=True),
            Column("all, Monte Carlo", digits=2, percent=True),
            Column("no range", digits=1, percent=True),
        ],
        rows=rows,
        rules=frozenset(range(len(ESTIMATORS) - 1, len(rows), len(ESTIMATORS))),
        note="To first order but for the Monte Carlo, which is half the width of the central 68.3 %; no range: share "
        "of its draws above the horizon or refused by the hull's fit.",
    )


def budget_sentences(costs: Sequence[Cost], estimator: str = PAPER_ESTIMATOR) -> list[str]:
    """One sentence for each distance: what each thing costs, dearest first."""
    sentences = []
    for distance in dict.fromkeys(cost.distance_m for cost in costs):
        parts = sorted(
            (cost for cost in costs_at(costs, distance, estimator) if cost.source != ALL),
            key=lambda cost: -cost.first_order,
        )
        told = ", ".join(
            f"{source_text(cost.source, cost.amount)} costs {_percent(cost.first_order)}" for cost in parts
        )
        sentences.append(f"{estimator} at {distance:g} m: {told}")
    return sentences


def error_table(rows: Sequence[SetErrors], what: str) -> Table:
    """RMSE and MAE for each amount of each error, the paper's Table 5 beside the focal length's."""
    cells: list[list[Cell]] = []
    for row in rows:
        focal = row.source == "focal_px" and row.estimator == PAPER_ESTIMATOR
        paper = TABLE_5.get(row.amount) if focal else None
        cells.append(
            [
                DISTURBANCES[row.source].title, amount_text(row.source, row.amount), row.estimator, row.n, row.missed,
                row.first_order_rmse_m, row.rmse_m, row.first_order_mae_m, row.mae_m, *(paper or (None, None)),
            ]
        )  # fmt: skip
    names = ("Wrong", "by", "Estimator", "n", "missed", "RMSE first order", "RMSE", "MAE first order", "MAE",
             "paper RMSE", "paper MAE")  # fmt: skip
    return Table(
        title=f"Slant range with something wrong, {what}, metres",
        columns=[Column(name) for name in names],
        rows=cells,
        rules=frozenset(range(len(ESTIMATORS) - 1, len(cells), len(ESTIMATORS))),
        note="keypoints and waves: standard deviation of noise; all others: an error that stays. Paper: Table 5, "
        "measured on its own photographs.",
    )


def error_csv(rows: Sequence[SetErrors]) -> Table:
    """The errors of the sets of boats with the names of their fields."""
    names = [field.name for field in fields(SetErrors)]
    return Table("", [Column(name) for name in names], [astuple(row) for row in rows])


def cost_csv(costs: Sequence[Cost]) -> Table:
    """Every cost as a row of shares."""
    names = [field.name for field in fields(Cost)]
    return Table("", [Column(name) for name in names], [astuple(cost) for cost in costs])


def draw_budget(costs: Sequence[Cost], path: Path) -> None:
    """Write a PNG: cost of each source by distance, one panel for each estimator."""
    columns = min(2, len(ESTIMATORS))
    lines = math.ceil(len(ESTIMATORS) / columns)
    figure = Figure(figsize=(4.6 * columns + 2.4, 3.8 * lines + 0.6), layout="constrained")
    grid = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
    panels = grid.flatten()
    for panel, estimator in zip(panels, ESTIMATORS):
        draw_budget_panel(panel, costs, estimator)
    for panel in grid[:, 0]:
        panel.set_ylabel("cost, % of the range\n(one standard deviation)")
    for panel in grid[-1]:
        panel.set_xlabel("slant range, m")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center", title="not known exactly")
    figure.suptitle(f"Error budget ({FIRST_ORDER_NOTE})")
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=120)


def draw_curves(costs: Sequence[Cost], estimator: str, path: Path) -> None:
    """Write a PNG: change of one estimator's range by distance, one panel for each kind of error."""
    sources = list(dict.fromkeys(cost.source for cost in costs))
    columns = min(3, len(sources))
    lines = math.ceil(len(sources) / columns)
    figure = Figure(figsize=(4.6 * columns, 3.6 * lines + 0.5), layout="constrained")
    panels = figure.subplots(lines, columns, squeeze=False).flatten()
    for panel, source in zip(panels, sources):
        draw_curve_panel(panel, costs, source, estimator)
        noise = DISTURBANCES[source].noise
        panel.legend(fontsize="small", title="standard deviation" if noise else "wrong by", title_fontsize="small")
    for panel in panels[len(sources) :]:
        panel.set_axis_off()
    figure.suptitle(f"{estimator}: what one error does to the range ({FIRST_ORDER_NOTE})")
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=120)


def draw_budget_panel(panel: Axes, costs: Sequence[Cost], estimator: str) -> None:
    """Draw the cost of each source by distance for one estimator, with labelled lines."""
    sources = list(dict.fromkeys((cost.source, cost.amount) for cost in costs if cost.source != ALL))
    colours = colormaps["tab10"].colors  # type: ignore[attr-defined]
    styles = [(*source, colours[n], 1.5) for n, source in enumerate(sources)] + [(ALL, math.nan, "black", 2.5)]
    for source, amount, colour, width in styles:
        members = [cost for cost in costs if cost.source == source and cost.estimator == estimator]
        _draw_line(panel, members, source_text(source, amount), colour, width)
    panel.set(title=estimator, xscale="log", yscale="log")
    panel.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    _mark_distances(panel, costs)
    panel.grid(alpha=0.3, which="both")


def draw_curve_panel(
    panel: Axes, costs: Sequence[Cost], source: str, estimator: str, colours: Sequence[str] | None = None
) -> None:
    """Draw what each amount of one kind of error does to one estimator, with labelled lines; colours by amount."""
    members = [cost for cost in costs if cost.source == source and cost.estimator == estimator]
    amounts = sorted({cost.amount for cost in members})
    for n, amount in enumerate(amounts):
        colour = colours[n] if colours else colormaps["viridis"](0.9 * n / max(len(amounts) - 1, 1))
        _draw_line(panel, [c for c in members if c.amount == amount], amount_text(source, amount), colour, 1.5)
    panel.set(title=DISTURBANCES[source].title, xlabel="slant range, m", xscale="log")
    noise = DISTURBANCES[source].noise
    panel.set_ylabel("standard deviation, % of the range" if noise else "change of the range, %")
    _mark_distances(panel, costs)
    panel.grid(alpha=0.3)


def _percent(share: float) -> str:
    """Two digits, never an exponent."""
    percent = 100 * share
    return f"{percent:.0f} %" if percent >= 10 else f"{percent:.2g} %"


def _draw_line(panel: Axes, costs: Sequence[Cost], label: str, colour: object, width: float) -> None:
    """First order as a line, exact values as dots; what is not finite is left out."""
    distances = [cost.distance_m for cost in costs]
    panel.plot(distances, [100 * c.first_order for c in costs], color=colour, linewidth=width, label=label)
    exact = [100 * c.exact if math.isfinite(c.exact) else math.nan for c in costs]
    panel.plot(distances, exact, "o", color=colour, markersize=3 + width)


def _mark_distances(panel: Axes, costs: Sequence[Cost]) -> None:
    distances = sorted({cost.distance_m for cost in costs})
    panel.set_xticks(distances, [f"{distance:g}" for distance in distances])
    panel.minorticks_off()
