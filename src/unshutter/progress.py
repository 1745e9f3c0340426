"""Messages for the user on standard error, and progress while many photos are processed: a bar on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from unshutter.errors import visible

if TYPE_CHECKING:
    import rich.progress

    from unshutter.readout_time import ReadoutTime

Watch: TypeAlias = Callable[[str, int, int], None]  # called with the items' name, the number done and the total


def tell(line: str) -> None:
    """Prints one line for the user on standard error, if the process has one; control characters are escaped."""
    if _has_standard_error():  # otherwise print would take standard output, which is for results
        print(visible(line), file=sys.stderr)


def _has_standard_error() -> bool:
    """Whether there is a standard error: a service, or Python without a window, may start with none."""
    return sys.stderr is not None and not getattr(sys.stderr, "closed", False)


class Progress:
    """A progress bar on standard error; shows nothing if that is not a terminal or there is only one item."""

    def __init__(self, total: int, what: str = "photos"):
        self._bar: rich.progress.Progress | None = None
        if total > 1 and _has_standard_error() and sys.stderr.isatty():
            self._bar = _bar()
            self._task = self._bar.add_task(what, total=total, rate="")
            self._bar.start()

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def advance(self, count: int = 1) -> None:
        """Marks ``count`` more items as done."""
        if self._bar is not None:
            self._bar.advance(self._task, count)
            self._bar.update(self._task, rate=rate(self._bar.tasks[self._task].speed))

    def tell(self, line: str) -> None:
        """Prints one line for the user, above the bar if there is one; control characters are escaped."""
        if self._bar is not None:
            self._bar.console.print(visible(line), markup=False, highlight=False, soft_wrap=True)
        else:
            tell(line)


class Steps:
    """Counts the steps of a task and reports each to a callback, if there is one; prints nothing."""

    def __init__(self, what: str, total: int, watch: Watch | None):
        self._what = what
        self._total = total
        self._watch = watch
        self._done = 0

    def advance(self, count: int = 1) -> None:
        """Marks ``count`` more steps as done."""
        self._done += count
        if self._watch is not None:
            self._watch(self._what, self._done, self._total)


class ClipObserver:
    """Receives the progress of the work on a clip; this one ignores it."""

    def note_progress(self, what: str, done: int, total: int) -> None:
        """Is called for every step of the work, with its kind, the number that are done, and their total."""

    def note_readout(self, time: ReadoutTime, interval_s: float) -> None:
        """Is called once the readout time is found, which may be long before the clip is done; with the time between
        its frames [s].
        """

    def note_rate(self, before: float, after: float) -> None:
        """Is called early with the bit rates of the clip and of the new film, if they differ considerably."""


SILENT = ClipObserver()


class Bars:
    """Progress bars on the terminal, one after another: a callback for work that counts several kinds of steps."""

    def __init__(self) -> None:
        self._what = ""
        self._done = 0
        self._bar: Progress | None = None

    def __enter__(self) -> Bars:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.__exit__(*error)
        self._bar = None

    def __call__(self, what: str, done: int, total: int) -> None:
        """Shows that ``done`` of ``total`` steps of the kind ``what`` are complete."""
        if self._bar is None or what != self._what:
            self.__exit__()
            self._what, self._done, self._bar = what, 0, Progress(total, what)
        self._bar.advance(done - self._done)
        self._done = done

    def tell(self, line: str) -> None:
        """Prints one line above the bar."""
        (self._bar or Progress(1)).tell(line)


def rate(per_second: float | None) -> str:
    """Formats a speed: ``2.5/s``, or ``4.0 s each``."""
    if not per_second:
        return ""
    return f"{per_second:.1f}/s" if per_second >= 1 else f"{1 / per_second:.1f} s each"


def _bar() -> rich.progress.Progress:
    """Creates the bar: progress, speed and remaining time."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    name = TextColumn("{task.description}")
    speed = TextColumn("{task.fields[rate]}")
    return Progress(
        *(name, BarColumn(), MofNCompleteColumn(), speed, TimeRemainingColumn()),
        console=Console(stderr=True),
        redirect_stdout=sys.stdout is not None and sys.stdout.isatty(),  # rich would send results to standard error
    )
