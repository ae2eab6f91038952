"""What the runs of a sweep come to: the paper's Tables 2 and 4 with ours beside them, and what each network costs."""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from usvnet.evaluation.paper_tables import TABLE_2, TABLE_4, PaperPose
from usvnet.evaluation.tables import Cell, Column, Table
from usvnet.network.variants import VARIANTS
from usvnet.sweep.cost import Cost
from usvnet.sweep.grid import EPOCHS, SEED, VARIANT, run_name
from usvnet.sweep.plan import Run
from usvnet.sweep.progress import Result

POSE = (("Precision", "precision"), ("Recall", "recall"), ("mAP50", "map50"), ("mAP50-95", "map50_95"))
SIGMAS = (("1/7", "pose"), ("0.025", "pose_strict"))
PAPER_TABLE_4_VARIANT = "m"


class Stat(NamedTuple):
    """A figure over seeds."""

    mean: float | None
    """None where a run has no such figure."""
    std: float | None
    """Sample standard deviation; None with fewer than two seeds."""

    def show(self) -> Cell:
        """For people."""
        return self.mean if self.mean is None or self.std is None else f"{self.mean:.3f} ± {self.std:.3f}"


@dataclass(frozen=True)
class Group:
    """Runs that differ in nothing but the seed."""

    runs: Sequence[tuple[Run, Result]]

    @property
    def first(self) -> Run:
        """Any of them."""
        return self.runs[0][0]

    @property
    def network(self) -> str:
        """The network's name, such as ``YOLOv8m-P6``."""
        return network_name(self.first.variant)

    @property
    def others(self) -> str:
        """What it has of the grid besides network, epochs and seed."""
        choices = {key: value for key, value in self.first.choices.items() if key not in (VARIANT, EPOCHS, SEED)}
        return run_name(choices) if choices else ""

    def stat(self, figure: Callable[[dict[str, Any]], float | None]) -> Stat:
        """A figure of the metrics over the seeds."""
        values = [figure(result.metrics) for _, result in self.runs]
        numbers = [value for value in values if value is not None]
        if len(numbers) < len(values):
            return Stat(None, None)
        return Stat(statistics.fmean(numbers), statistics.stdev(numbers) if len(numbers) > 1 else None)

    def pose(self, sigma: str, name: str) -> Stat:
        """A pose score; ``sigma`` is ``pose`` or ``pose_strict``."""
        return self.stat(lambda metrics: metrics[sigma][name])

    def waterline(self, name: str) -> Stat:
        """A range error of the ``waterline`` estimate."""
        return self.stat(lambda metrics: metrics["ranges"]["overall"]["waterline"][name])


def group_by_seed(finished: Sequence[tuple[Run, Result]]) -> list[Group]:
    """Put runs together that differ in their seed only, in the order of the grid."""
    groups: dict[str, list[tuple[Run, Result]]] = {}
    for run, result in finished:
        name = run_name({key: value for key, value in run.choices.items() if key != SEED})
        groups.setdefault(name, []).append((run, result))
    return [Group(runs) for runs in groups.values()]


def network_name(variant: str) -> str:
    """``n`` is YOLO11n, ``v8m-p6`` is YOLOv8m-P6."""
    return f"YOLO11{variant}" if "v8" not in variant else f"YOLO{variant}".replace("-p6", "-P6")


def paper_row(variant: str) -> PaperPose | None:
    """The row of the paper's Table 2 for a network; it has one for YOLOv8 and one for YOLOv8-P6, of unstated size."""
    family = VARIANTS[variant].family
    name = f"{network_name(variant)}-pose" if family == "YOLO11" else family.replace("YOLOv8", "YOLOv8-pose")
    return next((row for row in TABLE_2 if row.model == name), None)


def pose_table(groups: Sequence[Group]) -> Table:
    """Table 2: pose scores of every network at both OKS sigmas, the paper's beside those at its own sigma."""
    rows: list[list[Cell]] = []
    for group in groups:
        for sigma, key in SIGMAS:
            paper = paper_row(group.first.variant) if key == "pose" else None
            ours = [group.pose(key, name).show() for _, name in POSE]
            rows.append([*_labels(group, groups), sigma, len(group.runs), *ours, *(paper[1:] if paper else [None] * 4)])
    titles = [*_label_titles(groups), "OKS sigma", "seeds", *(title for title, _ in POSE)]
    return Table(
        title="Table 2: pose by network",
        columns=[Column(title) for title in [*titles, *(f"paper {title}" for title, _ in POSE)]],
        rows=rows,
        rules=frozenset(range(1, len(rows), 2)),
        note="On the test split; with several seeds, mean ± standard deviation. The paper's figures were measured on "
        "its own photographs, and it does not say which sizes its two YOLOv8 rows are.",
    )


def epoch_table(groups: Sequence[Group]) -> Table:
    """Table 4: mAP50-95 by the number of epochs, each of them a run with a schedule of its own."""
    epochs = sorted({group.first.epochs for group in groups})
    rows: list[list[Cell]] = []
    for variant, others in dict.fromkeys((group.first.variant, group.others) for group in groups):
        members = {g.first.epochs: g for g in groups if (g.first.variant, g.others) == (variant, others)}
        name = " ".join(filter(None, (network_name(variant), others)))
        for sigma, key in SIGMAS:
            found = [members[n].pose(key, "map50_95").show() if n in members else None for n in epochs]
            rows.append([name, sigma, *found])
        if variant == PAPER_TABLE_4_VARIANT and TABLE_4.keys() & set(epochs):
            rows.append(["paper: YOLO11m-pose", "1/7", *(TABLE_4.get(n) for n in epochs)])
    return Table(
        title="Table 4: mAP50-95 by epochs",
        columns=[Column(title) for title in ("Network", "OKS sigma", *(f"{n} epochs" for n in epochs))],
        rows=rows,
    )


def cost_table(groups: Sequence[Group], costs: dict[tuple[str, int], Cost]) -> Table:
    """What a network costs and what it gives."""
    rows: list[list[Cell]] = []
    for group in groups:
        cost = costs[group.first.variant, group.first.eval_size_px]
        training_s = statistics.fmean(result.training_s for _, result in group.runs)
        rows.append(
            [
                *_labels(group, groups),
                group.first.eval_size_px,
                cost.parameters / 1e6,
                cost.parameters_without_heatmaps / 1e6,
                cost.gflops,
                cost.ms,
                training_s / 60,
                group.pose("pose_strict", "map50_95").show(),
                group.waterline("rmse_m").show(),
                group.waterline("missed").mean,
            ]
        )
    devices = sorted({cost.device for cost in costs.values()})
    trained_on = sorted({result.device for group in groups for _, result in group.runs})
    return Table(
        title="Cost and accuracy",
        columns=[
            *(Column(title) for title in _label_titles(groups)),
            Column("px"),
            Column("parameters M", digits=2),
            Column("pose network M", digits=2),
            Column("GFLOPs", digits=2),
            Column("ms", digits=1),
            Column("training min", digits=1),
            Column("strict mAP50-95"),
            Column("waterline RMSE m"),
            Column("missed", digits=1),
        ],
        rows=rows,
        note="parameters: all, in millions; pose network: without the heatmap head, as published counts are. GFLOPs: "
        "of the network with its heatmap head for one picture, a multiply-add counting as two. ms: median time of one "
        f"picture from pixels to ranges in eager PyTorch, on {'; '.join(devices)}. "
        f"Trained on {'; '.join(trained_on)}. missed: laser-ranged boats of the test split that were not ranged, mean "
        "over seeds; the RMSE is over the others.",
    )


def figures_table(groups: Sequence[Group]) -> Table:
    """Every figure as numbers: mean and standard deviation in columns of their own."""
    rows: list[list[Cell]] = []
    for group in groups:
        stats = [group.pose(key, name) for _, key in SIGMAS for _, name in POSE]
        stats += [group.waterline(name) for name in ("rmse_m", "mae_m", "missed")]
        head: list[Cell] = [group.first.variant, group.first.epochs, group.others, len(group.runs)]
        rows.append([*head, *(cell for stat in stats for cell in stat)])
    names = [f"{title} {sigma}" for sigma, _ in SIGMAS for title, _ in POSE]
    names += [f"waterline {name}" for name in ("rmse_m", "mae_m", "missed")]
    titles = ["variant", "epochs", "others", "seeds", *(f"{name}{end}" for name in names for end in ("", " std"))]
    return Table(title="", columns=[Column(title) for title in titles], rows=rows)


def run_table(finished: Sequence[tuple[Run, Result]]) -> Table:
    """Every run by itself."""
    figures = figures_table([Group([pair]) for pair in finished])
    titles = [column.title for column in figures.columns]
    keep = [n for n, title in enumerate(titles) if title != "seeds" and not title.endswith(" std")]
    return Table(
        title="",
        columns=[Column("run"), Column("seed"), *(figures.columns[n] for n in keep)],
        rows=[
            [run.name, str(run.seed), *(row[n] for n in keep)]
            for (run, _), row in zip(finished, figures.rows, strict=True)
        ],
    )


def _label_titles(groups: Sequence[Group]) -> list[str]:
    titles = ["Network"]
    if len({group.first.epochs for group in groups}) > 1:
        titles.append("epochs")
    if any(group.others for group in groups):
        titles.append("setting")
    return titles


def _labels(group: Group, groups: Sequence[Group]) -> list[Cell]:
    cells: dict[str, Cell] = {"Network": group.network, "epochs": group.first.epochs, "setting": group.others}
    return [cells[title] for title in _label_titles(groups)]
