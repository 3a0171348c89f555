"""The terminal: short aligned tables, progress on long work, plain text when piped."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from rich.cells import cell_len
from rich.console import Console
from rich.measure import Measurement
from rich.progress import (
    BarColumn,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as RichProgress
from rich.table import Table
from rich.text import Text

from chiplog.errors import one_line

_PIPED_WIDTH = 1000  # a pipe has no edge: nothing is wrapped or cut there


class Progress(Protocol):
    """Hears how much is done, and of how much if that was not known before."""

    def __call__(self, done: float, total: int | None = None, /) -> None:
        """Move the bar."""


def _console() -> Console:
    """Return standard output as it is now: its width on a terminal, unbroken lines in a pipe."""
    is_terminal = sys.stdout.isatty()
    return Console(
        file=sys.stdout,
        highlight=False,
        markup=False,
        emoji=False,
        width=None if is_terminal else _PIPED_WIDTH,
    )


def show_table(head: Sequence[str], rows: Sequence[Sequence[str]], *, words: int = 1) -> None:
    """Print an aligned table; the first `words` columns are text, the others numbers."""
    table = Table(
        box=None, pad_edge=False, padding=(0, 3, 0, 0), header_style="dim", show_header=any(head)
    )
    for index, name in enumerate(head):
        is_last = index == len(head) - 1
        wraps = is_last and index < words
        table.add_column(
            Text(name),
            justify="left" if index < words else "right",
            no_wrap=not wraps,
            overflow="fold",
            # Cells hold blanks: rich would take their longest word for the least width.
            min_width=None if wraps else max(cell_len(row[index]) for row in (head, *rows)),
        )
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    out = _console()
    # A table wider than the terminal is wrapped by the terminal: nothing is cut off. (Asked within
    # the terminal's width, rich would answer with that.)
    unbound = out.options.update(max_width=_PIPED_WIDTH)
    out.width = max(out.width, Measurement.get(out, unbound, table).minimum)
    with out.capture() as capture:
        out.print(table)
    # Padding to the full width would be invisible blanks in a pipe or a copied line.
    for line in capture.get().splitlines():
        print(line.rstrip())


def show_line(text: str = "") -> None:
    """Print one line as it is."""
    print(text, flush=True)


def show_error(text: str) -> None:
    """Print `chiplog: text` on standard error, as one line whatever `text` holds."""
    print(f"chiplog: {one_line(text)}", file=sys.stderr)


@contextmanager
def progress(
    description: str, total: int | None = None, *, then: str | None = None
) -> Iterator[Progress | None]:
    """Show a progress bar on standard error inside this context, if that is a terminal.

    Yields a function that moves the bar, or None where nobody watches. `then` names the work that
    is left once the bar is full.
    """
    if not sys.stderr.isatty():
        yield None
        return
    with RichProgress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    ) as bar:
        task = bar.add_task(description, total=total)

        def move(done: float, of: int | None = None, /) -> None:
            end = total if of is None else of
            is_full = done == end and then is not None
            bar.update(
                task, completed=done, total=end, description=then if is_full else description
            )

        yield move
