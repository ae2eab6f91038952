"""The figure of a sweep: what accuracy each network buys with its parameters, operations and time."""

from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from usvnet.files import atomic_write
from usvnet.network.variants import VARIANTS
from usvnet.sweep.cost import Cost
from usvnet.sweep.tables import Group, Stat

COLOURS = {"YOLO11": "#0b5fa5", "YOLOv8": "#c1440e", "YOLOv8-P6": "#5b8c2a"}
PRICES: tuple[tuple[str, Callable[[Cost], float]], ...] = (
    ("parameters, millions", lambda cost: cost.parameters / 1e6),
    ("GFLOPs a picture", lambda cost: cost.gflops),
    ("milliseconds a picture", lambda cost: cost.ms),
)
YIELDS: tuple[tuple[str, Callable[[Group], Stat], tuple[int, int]], ...] = (
    ("strict mAP50-95", lambda group: group.pose("pose_strict", "map50_95"), (6, -10)),
    ("waterline range RMSE, m", lambda group: group.waterline("rmse_m"), (6, 4)),
)
"""With where names stand, in points from their mark: on the side away from a curve that rises or falls."""
LOGARITHMIC_FROM = 3.0
"""Prices whose largest is more than so many times the smallest are shown on a logarithmic scale."""
Point = tuple[float, float, float, str]
"""Price, yield, its spread, name."""


def draw_figure(groups: Sequence[Group], costs: dict[tuple[str, int], Cost], path: Path) -> None:
    """Draw accuracy (above) and range error (below) against three prices, on scales that suit the prices.

    Args:
        groups: a point each; a bar where there are several seeds, one standard deviation to either side.
        costs: of every group's network at its size of picture.
        path: PNG to write.
    """
    figure = Figure(figsize=(11, 6.2), layout="constrained")
    axes = figure.subplots(len(YIELDS), len(PRICES), sharex="col", sharey="row")
    for row, (yield_title, of_group, name_offset) in enumerate(YIELDS):
        for column, (price_title, of_cost) in enumerate(PRICES):
            axis = axes[row, column]
            for family, colour in COLOURS.items():
                members = [group for group in groups if VARIANTS[group.first.variant].family == family]
                points = sorted(_points(members, costs, of_group, of_cost))
                _draw_family(axis, points, family, colour, name_offset)
            _dress(axis, [of_cost(costs[group.first.variant, group.first.eval_size_px]) for group in groups])
            if row == len(YIELDS) - 1:
                axis.set_xlabel(price_title)
            if column == 0:
                axis.set_ylabel(yield_title)
    handles, names = axes[0, 0].get_legend_handles_labels()
    if names:
        figure.legend(handles, names, loc="outside upper center", ncols=len(names), frameon=False)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=150)


def _points(
    groups: Sequence[Group],
    costs: dict[tuple[str, int], Cost],
    of_group: Callable[[Group], Stat],
    of_cost: Callable[[Cost], float],
) -> list[Point]:
    points = []
    for group in groups:
        stat, cost = of_group(group), costs[group.first.variant, group.first.eval_size_px]
        if stat.mean is not None:
            points.append((of_cost(cost), stat.mean, stat.std or 0.0, _short_name(group, groups)))
    return points


def _short_name(group: Group, groups: Sequence[Group]) -> str:
    """The size, and whatever else tells the group from another of the same network."""
    size = group.first.variant.removeprefix("v8").removesuffix("-p6")
    epochs = f"{group.first.epochs} epochs" if len({other.first.epochs for other in groups}) > 1 else ""
    return " ".join(filter(None, (size, epochs, group.others)))


def _draw_family(axis: Axes, points: list[Point], family: str, colour: str, name_offset: tuple[int, int]) -> None:
    if not points:
        return
    prices, yields, spreads, names = zip(*points, strict=True)
    one_each = len(set(prices)) == len(prices)
    axis.errorbar(
        prices,
        yields,
        yerr=spreads if any(spreads) else None,
        marker="o",
        markersize=5,
        linewidth=1 if one_each else 0,
        elinewidth=1,
        capsize=2,
        color=colour,
        label=family,
    )
    for price, value, name in zip(prices, yields, names):
        axis.annotate(name, (price, value), xytext=name_offset, textcoords="offset points", fontsize=8, color=colour)


def _dress(axis: Axes, prices: Sequence[float]) -> None:
    if max(prices) > LOGARITHMIC_FROM * min(prices):
        axis.set_xscale("log")
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.xaxis.set_minor_locator(NullLocator())
    axis.margins(x=0.12, y=0.12)
    axis.set_ylim(bottom=0)
    axis.grid(color="#dddddd", linewidth=0.6)
    axis.spines[["top", "right"]].set_visible(False)
