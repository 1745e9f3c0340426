"""SIGTERM and SIGHUP end the program as Ctrl-C does: finished results are kept, partial files removed."""

from __future__ import annotations

import signal


class Stopped(KeyboardInterrupt):
    """Raised when a signal asks the program to end.

    Attributes:
        exit_code: the shell's exit code for a program ended by this signal.
    """

    def __init__(self, number: int):
        super().__init__()
        self.exit_code = 128 + number


def stop_on_signals() -> None:
    """Makes these signals raise :class:`Stopped`; signals that are ignored, as under ``nohup``, remain ignored."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _stop)


def _stop(number: int, _frame: object) -> None:
    raise Stopped(number)
