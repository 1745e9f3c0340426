"""What the user sees while many photos are worked on: a bar where there is a terminal, and lines above it."""

from __future__ import annotations

import sys
from typing import Any


class Progress:
    """A progress bar on standard error; nothing when that is no terminal or there is but one photo."""

    def __init__(self, total: int, what: str = "photos"):
        self._bar: Any = None
        if total > 1 and sys.stderr.isatty():
            import rich.console
            import rich.progress

            self._bar = rich.progress.Progress(console=rich.console.Console(stderr=True))
            self._task = self._bar.add_task(what, total=total)
            self._bar.start()

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def advance(self) -> None:
        """One more is done."""
        if self._bar is not None:
            self._bar.advance(self._task)

    def tell(self, line: str) -> None:
        """One line for the user, above the bar when there is one."""
        if self._bar is not None:
            self._bar.console.print(line, markup=False, highlight=False, soft_wrap=True)
        else:
            print(line, file=sys.stderr)
