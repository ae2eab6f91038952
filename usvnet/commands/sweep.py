"""``usvnet sweep``: many training runs from one experiment, and the tables that compare them."""

from pathlib import Path

from rich.console import Console

from usvnet.files import alone_in
from usvnet.sweep.board import Board
from usvnet.sweep.grid import load_sweep
from usvnet.sweep.local import default_parallel, run_locally
from usvnet.sweep.plan import claim_folder, plan_runs
from usvnet.sweep.ray_tune import run_with_ray
from usvnet.sweep.report import REPORT, finished_runs, print_tables, write_report
from usvnet.wording import counted


def sweep(
    *,
    config: Path,
    out: str | None = None,
    data: str | None = None,
    parallel: int | None = None,
    ray: bool = False,
) -> None:
    """Train and score every run of a grid, then write tables and a figure that compare them.

    Each run is a process of its own with a folder of its own. A sweep that was stopped, by Ctrl-C or otherwise, goes on
    when the same command is given again: finished runs are skipped, an interrupted one starts at its last epoch's end,
    and the tables are the same as if nothing had happened.

    Args:
        config: The sweep, such as one of configs/sweep/.
        out: Folder of all results; runs/sweep-NAME if left out, by the name of the configuration.
        data: Dataset folder in the place of the experiment's.
        parallel: Runs at a time; one for each graphics card, or one, if left out.
        ray: Start the runs through Ray Tune, on all machines of its cluster, instead of on this machine only.

    Raises:
        ValueError: the configuration is wrong or has changed, the folder is in use, or a run failed.
        FileNotFoundError: no such configuration.
    """
    if parallel is not None and parallel < 1:
        raise ValueError(f"--parallel is {parallel}, expected at least 1")
    console = Console(highlight=False)
    folder = Path(out or f"runs/sweep-{config.stem}")
    runs = plan_runs(load_sweep(config), folder, data)
    folder.mkdir(parents=True, exist_ok=True)
    with alone_in(folder):
        claim_folder(folder, runs, config)
        done = {run.name for run, _ in finished_runs(runs)}
        left = [run for run in runs if run.name not in done]
        try:
            with Board(console, runs) as board:
                if ray and left:
                    failed = run_with_ray(left, parallel, folder / "ray", board)
                else:
                    failed = run_locally(left, parallel or default_parallel(), board)
        except KeyboardInterrupt:
            console.print(
                f"{len(finished_runs(runs))} of {counted(len(runs), 'run')} finished, the same command goes on"
            )
            raise
        print_tables(write_report(runs, folder, config))
    if failed:
        first, reason = next(iter(failed.items()))
        raise ValueError(
            f"{len(failed)} of {counted(len(runs), 'run')} failed, the first of them {first}: {reason} "
            f"(see {folder / first / 'log.txt'}; the same command tries them again)"
        )
    console.print(f"written to {folder}: {REPORT}, tables and a figure", soft_wrap=True)
