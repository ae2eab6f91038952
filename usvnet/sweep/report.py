"""A sweep's results as Markdown, CSV and a picture."""

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from usvnet import __version__
from usvnet.evaluation.paper_tables import SOURCE
from usvnet.evaluation.tables import Table
from usvnet.files import atomic_write
from usvnet.sweep.cost import measure_costs
from usvnet.sweep.figure import draw_figure
from usvnet.sweep.plan import Run
from usvnet.sweep.progress import Result, read_result
from usvnet.sweep.tables import cost_table, epoch_table, figures_table, group_by_seed, pose_table, run_table

REPORT, FIGURE, COSTS = "report.md", "accuracy_and_cost.png", "costs.json"
TERMINAL_COLUMNS = 150
"""What the widest table needs; a narrower terminal wraps its lines."""


def write_report(runs: Sequence[Run], out: Path, config: Path) -> list[Table]:
    """Write report.md, table_2.csv, table_4.csv, costs.csv, runs.csv and the figure, of the runs that are finished.

    Args:
        runs: all runs of the sweep.
        out: folder of the sweep.
        config: the sweep's YAML.

    Returns:
        The tables, to be shown.

    Raises:
        ValueError: a result is damaged.
    """
    finished = finished_runs(runs)
    if not finished:
        return []
    groups = group_by_seed(finished)
    costs = measure_costs(((run.variant, run.eval_size_px) for run, _ in finished), out / COSTS)
    tables = {"table_2": pose_table(groups)}
    if len({group.first.epochs for group in groups}) > 1:
        tables["table_4"] = epoch_table(groups)
    tables["costs"] = cost_table(groups, costs)
    for name, table in (tables | {"table_2": figures_table(groups), "runs": run_table(finished)}).items():
        table.write_csv(out / f"{name}.csv")
    draw_figure(groups, costs, out / FIGURE)
    roots = sorted({str(run.configuration["data.root"]) for run, _ in finished})
    facts = {
        "command": f"usvnet sweep --config {config.name}",
        "runs": f"{len(finished)} of {len(runs)}",
        "data": ", ".join(roots),
        "usvnet": __version__,
        "torch": ", ".join(sorted({result.versions["torch"] for _, result in finished})),
        "paper": SOURCE,
    }
    lines = [f"# Sweep {config.stem}", "", *(f"- {name}: {value}" for name, value in facts.items()), ""]
    lines += [*(table.to_markdown() for table in tables.values()), f"![accuracy and cost]({FIGURE})", ""]
    with atomic_write(out / REPORT) as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")
    return list(tables.values())


def finished_runs(runs: Sequence[Run]) -> list[tuple[Run, Result]]:
    """Pick the runs that have a result.

    Raises:
        ValueError: a result is damaged, or of another configuration than the run has.
    """
    finished = []
    for run in runs:
        result = read_result(run.folder)
        if result is not None:
            if result.configuration_sha256 != run.sha256:
                raise ValueError(f"{run.folder}: its result is of another configuration: delete the folder")
            finished.append((run, result))
    return finished


def print_tables(tables: Sequence[Table]) -> None:
    """Show tables in the terminal."""
    console = Console(width=max(Console().width, TERMINAL_COLUMNS))
    for table in tables:
        table.print(console)
        console.print()
