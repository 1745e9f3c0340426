"""``unshutter serve``: runs the page in the browser."""

from __future__ import annotations

from unshutter.cli.arguments import Command
from unshutter.cli.signals import Stopped
from unshutter.serve.settings import Settings


def run(arguments: Settings) -> int:
    """Serves the page until Ctrl-C; returns the exit code."""
    from unshutter.serve.server import serve

    try:
        return serve(arguments)
    except KeyboardInterrupt as stop:
        if isinstance(stop, Stopped):  # a signal that means more than the end of the session
            raise
        return 0


COMMAND = Command(
    """Open a page for photos and clips in the browser, on this machine only: before and after, corrections, saving.

They stay on this machine, in a temporary folder that goes when the page ends. Needs the extra `web`, and `video` for
clips.""",
    Settings,
    run,
)
