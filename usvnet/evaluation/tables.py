"""A table that can be shown in a terminal, written as Markdown and as CSV."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table as RichTable

from usvnet.files import atomic_write

Cell = str | int | float | None


@dataclass(frozen=True)
class Column:
    """A column and how its numbers are shown."""

    title: str
    digits: int = 3
    """Decimals of a float."""
    percent: bool = False
    """Whether a share is shown in per cent."""

    def show(self, cell: Cell) -> str:
        """Format a cell; a figure that does not exist is a dash."""
        if cell is None or (isinstance(cell, float) and not math.isfinite(cell)):
            return "-"
        if not isinstance(cell, float):
            return str(cell)
        return f"{100 * cell:.{self.digits}f} %" if self.percent else f"{cell:.{self.digits}f}"


@dataclass(frozen=True)
class Table:
    """Rows of raw values; formatting is the columns' matter."""

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]
    strong: frozenset[int] = frozenset()
    """Rows that stand out."""
    rules: frozenset[int] = frozenset()
    """Rows with a line under them (in the terminal)."""
    note: str = ""

    def print(self, console: Console) -> None:
        """Show in a terminal."""
        shown = RichTable(title=self.title, box=box.SIMPLE_HEAD, title_style="bold", title_justify="left")
        shown.caption, shown.caption_justify = self.note or None, "left"
        for column, numeric in zip(self.columns, self.numeric()):
            shown.add_column(
                "\n".join(column.title.rsplit(" ", 1)),
                justify="right" if numeric else "left",
                no_wrap=True,
                vertical="bottom",
            )
        for n, row in enumerate(self.shown()):
            shown.add_row(*row, style="bold" if n in self.strong else None, end_section=n in self.rules)
        console.print(shown)

    def to_markdown(self) -> str:
        """Write as a Markdown section."""
        titles = [column.title for column in self.columns]
        marks = ["---:" if numeric else ":---" for numeric in self.numeric()]
        rows = [
            [f"**{cell}**" if n in self.strong and cell != "-" else cell for cell in row]
            for n, row in enumerate(self.shown())
        ]
        lines = [f"| {' | '.join(cells)} |" for cells in [titles, marks, *rows]]
        note = f"\n{self.note}\n" if self.note else ""
        return f"## {self.title}\n\n" + "\n".join(lines) + "\n" + note

    def write_csv(self, path: Path | str) -> None:
        """Write the values with six digits; a figure that does not exist is an empty field."""
        with atomic_write(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([column.title for column in self.columns])
            for row in self.rows:
                writer.writerow([_csv_field(cell) for cell in row])

    def shown(self) -> list[list[str]]:
        """Every cell as people read it."""
        return [[column.show(cell) for column, cell in zip(self.columns, row)] for row in self.rows]

    def numeric(self) -> list[bool]:
        """Which columns hold numbers alone, and stand to the right."""
        cells = zip(*self.rows) if self.rows else [()] * len(self.columns)
        return [not any(isinstance(cell, str) for cell in column) for column in cells]


def _csv_field(cell: Cell) -> Cell:
    if isinstance(cell, float):
        return f"{cell:.6g}" if math.isfinite(cell) else ""
    return cell
