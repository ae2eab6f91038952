"""The live table: every run, how far it is and what came of it."""

from types import TracebackType

from rich import box
from rich.console import Console
from rich.live import Live
from rich.table import Table

from usvnet.sweep.plan import Run
from usvnet.sweep.progress import Progress, read_progress, read_result

REFRESH_PER_S = 2


class Board:
    """A table that is kept up to date in a terminal; in a log, a line for each run that begins or ends.

    Args:
        console: where it is shown.
        runs: all runs of the sweep, those that were finished before included.
    """

    def __init__(self, console: Console, runs: list[Run]) -> None:
        self.console = console
        self.runs = runs
        self.running: set[str] = set()
        self.failed: dict[str, str] = {}
        self._live = Live(get_renderable=self.table, console=console, refresh_per_second=REFRESH_PER_S, transient=True)

    def __enter__(self) -> "Board":
        """Show the table."""
        if self.console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the table as it is now."""
        if self.console.is_terminal:
            self._live.stop()
            self.console.print(self.table())

    def begin(self, run: Run) -> None:
        """Say that a run has been started."""
        self.running.add(run.name)
        self._line(f"{run.name}: {self.state(run)}")

    def end(self, run: Run, reason: str) -> None:
        """Say that a run has ended; ``reason`` is why it failed, or empty."""
        self.running.discard(run.name)
        if reason:
            self.failed[run.name] = reason
        self._line(f"{run.name}: {self.state(run)}")

    def table(self) -> Table:
        """Every run and its state."""
        shown = Table(box=box.SIMPLE_HEAD)
        for title in ("Run", "State"):
            shown.add_column(title, overflow="fold")
        for title in ("strict mAP50-95", "range RMSE"):
            shown.add_column(title, justify="right")
        for run in self.runs:
            style = "red" if run.name in self.failed else "bold" if run.name in self.running else None
            shown.add_row(run.name, self.state(run), *_figures(run), style=style)
        return shown

    def state(self, run: Run) -> str:
        """Say how far a run is."""
        if run.name in self.failed:
            return f"failed: {self.failed[run.name]}"
        if read_result(run.folder) is not None:
            return "finished"
        progress = read_progress(run.folder)
        if run.name in self.running:
            return "starting" if progress is None else _stage(progress, run)
        return "waiting" if progress is None else f"interrupted after {_epochs(progress, run)}"

    def _line(self, text: str) -> None:
        if not self.console.is_terminal:
            self.console.print(text, markup=False, highlight=False, soft_wrap=True)


def _stage(progress: Progress, run: Run) -> str:
    return "scoring" if progress.stage == "scoring" else f"training, {_epochs(progress, run)}"


def _epochs(progress: Progress, run: Run) -> str:
    return f"{progress.epochs_done} of {run.epochs} epochs"


def _figures(run: Run) -> tuple[str, str]:
    result = read_result(run.folder)
    if result is None:
        return "", ""
    rmse_m = result.metrics["ranges"]["overall"]["waterline"]["rmse_m"]
    return f"{result.metrics['pose_strict']['map50_95']:.3f}", "-" if rmse_m is None else f"{rmse_m:.3f} m"
