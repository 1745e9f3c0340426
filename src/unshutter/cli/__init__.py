"""The command line: what each command is called, takes and prints. The work is done elsewhere."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from pathlib import Path

from unshutter.errors import UnshutterError, UsageError


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 0 done, 1 something failed, 2 wrong usage."""
    # NumPy's own threads are hardly used, but while it is imported they spin on the cores that decode.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    atexit.register(gc.freeze)  # else the interpreter ends by looking for cycles among all that was imported
    _begin_early(sys.argv[1:] if arguments is None else arguments)
    # not above: the photo is decoded meanwhile
    from cyclopts import CycloptsError

    from unshutter.cli import elsewhere, photos, research  # noqa: F401 (their commands register themselves)
    from unshutter.cli.app import app

    try:
        result = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        return result if isinstance(result, int) else 0
    except CycloptsError as error:
        return _say(f"{' '.join(str(error).split())} (see unshutter --help)", 2)
    except UsageError as error:
        return _say(str(error), 2)
    except UnshutterError as error:
        return _say(str(error), 1)
    except BrokenPipeError:  # the reader of our output went away
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except MemoryError:
        return _say("not enough memory", 1)
    except KeyboardInterrupt:
        return _say("stopped; what was finished is kept", 130)


def _begin_early(arguments: list[str]) -> None:
    """``rectify PHOTO ...``: the photo is decoded while the command line is imported.

    A guess, which may be wrong: what the command is, its parser says. A limit on pixels is for it to read first.
    """
    limited = any(word.startswith("--max-pixels") for word in arguments)
    if arguments[:1] == ["rectify"] and not limited and len(arguments) > 1 and os.path.isfile(arguments[1]):
        from unshutter.photo import early

        early.begin(Path(arguments[1]))


def _say(message: str, code: int) -> int:
    print(f"unshutter: {message}", file=sys.stderr)
    return code
