"""Entry point of the application: opens files on the page, and runs the commands of the command line."""

import html
import io
import os
import sys
import tempfile
import webbrowser
from contextlib import redirect_stderr
from multiprocessing import freeze_support
from pathlib import Path


def command(words: list[str]) -> list[str]:
    """Returns the command for the words with which the application was started."""
    from unshutter.cli import COMMANDS

    if words and (words[0] in COMMANDS or words[0].startswith("-")):
        return words
    return ["open", *words]


def restore_libraries() -> None:
    """Restores the place of the system's libraries, for the browser: the program has started with its own.

    Its own further processes find theirs again, since they start as if nobody had started them.
    """
    os.environ["PYINSTALLER_RESET_ENVIRONMENT"] = "1"
    before = os.environ.pop("LD_LIBRARY_PATH_ORIG", None)
    os.environ.pop("LD_LIBRARY_PATH", None)
    if before is not None:
        os.environ["LD_LIBRARY_PATH"] = before


def has_terminal() -> bool:
    """Whether somebody reads what is printed."""
    return sys.stderr is not None and sys.stderr.isatty()


def open_without_terminal(words: list[str]) -> int:
    """Opens files on the page; what prevents that is shown in the browser, too. Returns the exit code."""
    from unshutter.cli import main, open_missing_streams

    open_missing_streams()
    with redirect_stderr(io.StringIO()) as told:
        code = main(words)
    print(told.getvalue(), end="", file=sys.stderr)
    if code:
        with tempfile.NamedTemporaryFile("w", suffix=".html", delete=False, encoding="utf-8") as page:
            page.write(f'<!doctype html><meta charset="utf-8"><title>unshutter</title>{html.escape(told.getvalue())}')
        webbrowser.open(Path(page.name).as_uri())
    return code


if __name__ == "__main__":
    freeze_support()  # the workers are processes of this program
    if sys.platform == "linux":
        restore_libraries()
    from unshutter.cli import run

    sys.argv[1:] = command(sys.argv[1:])
    if sys.argv[1] == "open" and not has_terminal():
        sys.exit(open_without_terminal(sys.argv[1:]))
    run()
