"""The command line: what each command is called, takes and prints. The work is done elsewhere."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import NoReturn

from unshutter.default_estimator import DEFAULT_ESTIMATOR
from unshutter.errors import UnshutterError, UsageError

_FORBID_DECODING = ("--max-pixels", "--jobs", "--scheduler", "--dry-run")
_FORBID_ESTIMATING = ("--motion", "--readout", "--focal", "--roll", "--tilt")


def run() -> NoReturn:
    """The program: :func:`main`, then the end of the process, which has nothing to tidy up after a photo or two."""
    code = main()
    with_helpers = {"multiprocessing", "distributed", "torch"} & sys.modules.keys()
    for stream in filter(None, (sys.stdout, sys.stderr)):
        try:
            stream.flush()
        except BrokenPipeError:  # the reader of our output went away
            code = code or 1
        except OSError as error:
            code = code or _say(f"cannot write the output: {error.strerror}", 1)
    if with_helpers:  # processes that end with this one
        sys.exit(code)
    os._exit(code)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 0 done, 1 something failed, 2 wrong usage."""
    # NumPy's own threads are hardly used, but while it is imported they spin on the cores that decode.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        return _command(arguments)
    except UsageError as error:
        return _say(str(error), 2)
    except UnshutterError as error:
        return _say(str(error), 1)
    except BrokenPipeError:  # the reader of our output went away
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:  # what is printed is led to a full disc, say
        return _say(error.strerror or str(error), 1)
    except ImportError as error:  # a library is missing or damaged, or Ctrl-C came while one was loaded
        return _say(f"cannot load what it needs, install it again if that persists: {' '.join(str(error).split())}", 1)
    except MemoryError:
        return _say("not enough memory", 1)
    except KeyboardInterrupt:
        return _say("stopped; what was finished is kept", 130)


def _command(arguments: list[str] | None) -> int:
    _begin_early(sys.argv[1:] if arguments is None else arguments)
    # not above: the photo is decoded meanwhile
    from cyclopts import CycloptsError

    from unshutter.cli import elsewhere, photos, research  # noqa: F401 (their commands register themselves)
    from unshutter.cli.app import app

    try:
        result = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        return _say(f"{' '.join(str(error).split())} (see unshutter --help)", 2)
    return result if isinstance(result, int) else 0


def _begin_early(arguments: list[str]) -> None:
    """``rectify PHOTO ...``: the photo is decoded while the command line is imported.

    Its motion is looked for, too. A guess, which may be wrong: what is wanted, the command's parser says.
    """
    if arguments[:1] == ["rectify"] and len(arguments) > 1 and os.path.isfile(arguments[1]):
        if any(word.startswith(_FORBID_DECODING) for word in arguments):
            return
        from unshutter import early

        otherwise = any(word.startswith(_FORBID_ESTIMATING) for word in arguments)
        early.begin(Path(arguments[1]), None if otherwise else _estimator_in(arguments))


def _estimator_in(arguments: list[str]) -> str:
    for word, following in zip(arguments, [*arguments[1:], ""], strict=True):
        if word.partition("=")[0] == "--estimator":
            return word.partition("=")[2] or following
    return DEFAULT_ESTIMATOR


def _say(message: str, code: int) -> int:
    print(f"unshutter: {message}", file=sys.stderr)
    return code
