"""Telling how many frames there are, how fast they come and how long it will take."""

import time
from datetime import timedelta
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

LINE_EVERY_S = 60.0
"""Where there is no terminal to draw a bar in, such as in a log, there is a line so often."""


class FrameProgress:
    """A bar in a terminal, a line now and then in a log."""

    def __init__(self, console: Console, total: int) -> None:
        """Start at none of ``total`` frames."""
        columns = (TextColumn("frames"), BarColumn(), MofNCompleteColumn(), _Pace(), TimeRemainingColumn())
        self._console = console
        self._bar = Progress(
            *columns, console=console, speed_estimate_period=600, disable=not console.is_terminal, transient=True
        )
        self._task = self._bar.add_task("", total=total)
        self._began_s = self._last_line_s = time.monotonic()
        self._total, self._done = total, 0

    def __enter__(self) -> "FrameProgress":
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Take the bar away."""
        self._bar.stop()

    def say(self, line: str) -> None:
        """Print a line over the bar."""
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)

    def advance(self) -> None:
        """One more frame is done."""
        self._done += 1
        self._bar.advance(self._task)
        now_s = time.monotonic()
        if not self._console.is_terminal and now_s - self._last_line_s > LINE_EVERY_S:
            self._last_line_s = now_s
            per_second = self._done / (now_s - self._began_s)
            left = timedelta(seconds=round((self._total - self._done) / per_second))
            self.say(f"{self._done} of {self._total} frames, {60 * per_second:.1f} frames/min, {left} left")


class _Pace(ProgressColumn):
    """Frames a minute."""

    def render(self, task: Task) -> Text:
        """Show nothing before the second frame."""
        speed = task.finished_speed or task.speed
        return Text(f"{60 * speed:.1f} frames/min" if speed else "", style="progress.data.speed")
