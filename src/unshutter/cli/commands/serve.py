"""``unshutter serve``."""

from __future__ import annotations

from unshutter.cli.arguments import Command
from unshutter.serve.settings import Settings


def run(given: Settings) -> int:
    """Serves the page until Ctrl-C; returns the exit code."""
    from unshutter.serve.server import serve

    return serve(given)


COMMAND = Command(
    """Open a page for photos in the browser, on this machine only: before and after, corrections, saving.

Photos stay on this machine, in a temporary folder that goes when the page ends. Needs the extra `web`.""",
    Settings,
    run,
)
