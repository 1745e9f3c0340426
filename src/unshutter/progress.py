"""Messages for the user on standard error, progress while many photos are processed, and texts in columns."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from datetime import timedelta
from typing import TYPE_CHECKING, Self, TypeAlias

from unshutter.errors import visible

if TYPE_CHECKING:
    import rich.progress

    from unshutter.readout_time import ReadoutTime

Count: TypeAlias = Callable[[int], object]  # called with the number of items that are done


def uncounted(items: int) -> None:
    """Ignores what is done, where nobody counts it."""


def tell(line: str) -> None:
    """Prints one line for the user on standard error, if the process has one; control characters are escaped."""
    if _has_standard_error():  # otherwise print would take standard output, which is for results
        print(visible(line), file=sys.stderr)


def _has_standard_error() -> bool:
    """Whether there is a standard error: a service, or Python without a window, may start with none."""
    return sys.stderr is not None and not getattr(sys.stderr, "closed", False)


class Bar:
    """A progress bar on standard error; nothing is shown before it starts, or if that is not a terminal."""

    _bar: rich.progress.Progress | None = None
    _is_hidden = False  # whether there is no terminal to show it on

    def _start(self, what: str, total: float, *columns: str) -> None:
        """Shows the bar.

        Args:
            columns: what is written after the bar: formats of a task, whose field ``said`` is "" at first.
        """
        if self._is_hidden or not (_has_standard_error() and sys.stderr.isatty()):
            self._is_hidden = True
            return
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        self._bar = Progress(
            *(TextColumn("{task.description}"), BarColumn(), *map(TextColumn, columns)),
            console=Console(stderr=True),
            redirect_stdout=sys.stdout is not None and sys.stdout.isatty(),  # rich would send results to standard error
        )
        self._task = self._bar.add_task(what, total=total, said="")
        self._bar.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def tell(self, line: str) -> None:
        """Prints one line for the user, above the bar if there is one; control characters are escaped."""
        if self._bar is not None:
            self._bar.console.print(visible(line), markup=False, highlight=False, soft_wrap=True)
        else:
            tell(line)


class Progress(Bar):
    """A progress bar for items; shows nothing if there is only one."""

    def __init__(self, total: int, what: str = "photos"):
        if total > 1:
            self._start(what, total, "{task.completed:.0f}/{task.total:.0f}", "{task.fields[said]}")

    def advance(self, count: int = 1) -> None:
        """Marks ``count`` more items as done."""
        if self._bar is not None:
            self._bar.advance(self._task, count)
            task = self._bar.tasks[self._task]
            said = [rate(task.speed), "" if task.time_remaining is None else clock(task.time_remaining)]
            self._bar.update(self._task, said=" ".join(said))


class ClipObserver:
    """Receives the progress of the work on a clip; this one ignores it."""

    def note_progress(self, what: str, done: int, total: int) -> None:
        """Is called for every step of the work, with its kind, the number that are done, and their total."""

    def note_share(self, share: float, left_s: float | None) -> None:
        """Is called for every step of the work, and perhaps from another thread, but never twice at a time.

        Args:
            share: how much of the whole work is done, from 0 to 1; it never falls.
            left_s: how long the rest takes [s]; None if that is not known yet.
        """

    def note_readout(self, time: ReadoutTime, interval_s: float) -> None:
        """Is called once the readout time is found, which may be long before the clip is done; with the time between
        its frames [s].
        """

    def note_rate(self, before: float, after: float) -> None:
        """Is called early with the bit rates of the clip and of the new video, if they differ considerably."""


SILENT = ClipObserver()


def in_columns(rows: Sequence[Sequence[str]], right: int | None = None) -> str:
    """Formats rows of texts, one a line, in columns of which one may be aligned to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = [str.rjust if k == right else str.ljust for k in range(len(widths))]
    cells = [zip(sides, row, widths, strict=True) for row in rows]
    lines = ("  ".join(side(text, width) for side, text, width in row) for row in cells)
    return "\n".join(line.rstrip() for line in lines)


def rate(per_second: float | None) -> str:
    """Formats a speed: ``2.5/s``, or ``4.0 s each``."""
    if not per_second:
        return ""
    return f"{per_second:.1f}/s" if per_second >= 1 else f"{1 / per_second:.1f} s each"


def clock(seconds: float) -> str:
    """Formats a time that is left: ``0:01:30``."""
    return str(timedelta(seconds=round(seconds)))
