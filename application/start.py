"""Where the application starts: files are opened on the page, and the words of the command line are understood, too."""

import os
import sys
from multiprocessing import freeze_support


def command(words: list[str]) -> list[str]:
    """Returns the command for the words with which the application was started."""
    from unshutter.cli import COMMANDS

    if words and (words[0] in COMMANDS or words[0].startswith("-")):
        return words
    return ["open", *words]


def restore_libraries() -> None:
    """Restores the place of the system's libraries, for the browser: the program has started with its own."""
    before = os.environ.pop("LD_LIBRARY_PATH_ORIG", None)
    os.environ.pop("LD_LIBRARY_PATH", None)
    if before is not None:
        os.environ["LD_LIBRARY_PATH"] = before


if __name__ == "__main__":
    freeze_support()  # the workers are processes of this program
    if sys.platform == "linux":
        restore_libraries()
    from unshutter.cli import run

    sys.argv[1:] = command(sys.argv[1:])
    run()
