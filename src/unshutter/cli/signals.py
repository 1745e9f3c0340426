"""SIGTERM and SIGHUP end the program as Ctrl-C does: nothing half-written is left, what was finished is kept."""

from __future__ import annotations

import signal


class Stopped(KeyboardInterrupt):
    """The program was asked to end.

    Attributes:
        exit_code: of a program that a signal ended, as shells count.
    """

    def __init__(self, number: int):
        super().__init__()
        self.exit_code = 128 + number


def stop_on_signals() -> None:
    """From now on, these signals raise :class:`Stopped`; one that is ignored, as under ``nohup``, stays so."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, _stop)


def _stop(number: int, _frame: object) -> None:
    raise Stopped(number)
