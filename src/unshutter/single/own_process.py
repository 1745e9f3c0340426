"""Runs a network's file in a process of its own, which a bad file may crash, fill up, or keep busy.

The module that runs it there calls :func:`answer`; :func:`run_in_own_process` starts it and takes its answer.
"""

from __future__ import annotations

import faulthandler
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from unshutter.errors import UnshutterError, WeightsError

LONGEST_RUN_S = 60.0  # our slowest takes a second
_MOST_MEMORY = 2 * 2**30  # bytes, where the system can limit it; ours need a tenth
_REFUSED = 3  # exit status


def run_in_own_process(module: str, weights: Path, words: str = "", data: bytes = b"") -> bytes:
    """Runs ``python -m module weights words`` and returns its answer.

    Args:
        module: a module that calls :func:`answer`.
        weights: the network's file.
        words: what else the module is to know.
        data: its standard input.

    Raises:
        WeightsError: it refused the file, crashed, or took too long.
        UnshutterError: the process cannot be started.
    """
    # the module search path of this process and nothing else: -P omits the current folder
    paths = os.pathsep.join(os.getcwd() if path == "" else path for path in sys.path)
    refused = f"cannot use the weights {weights}: "
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", module, str(weights.absolute()), words],
            input=data,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # messages of libraries are not meant for users
            timeout=LONGEST_RUN_S,
            env=os.environ | {"PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,  # shields it from Ctrl-C in a terminal; this process ends it
            check=False,
        )
    except OSError as error:
        raise UnshutterError(f"cannot start a process for the network: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise WeightsError(f"{refused}it took longer than {LONGEST_RUN_S:g} s") from None
    if done.returncode == _REFUSED:
        raise WeightsError(done.stdout.decode("utf-8", "replace"))
    if done.returncode != 0:
        raise WeightsError(f"{refused}it makes its process crash")
    return done.stdout


def answer(run: Callable[[Path, str], bytes]) -> None:
    """Writes what ``run`` returns for the words of the command line, or the first line of its exception."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # keeps libraries' output out of the answers
    # It must not run indefinitely if its parent has been killed. This timer works even if Python is blocked.
    faulthandler.dump_traceback_later(LONGEST_RUN_S + 5.0, exit=True, file=sys.stderr)
    with suppress(ImportError, ValueError, OSError):  # Windows and macOS
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
    try:
        found = run(Path(sys.argv[1]), sys.argv[2])
    except Exception as error:  # libraries' exceptions have no common base class
        why = next(iter(str(error).splitlines()), type(error).__name__)
        line = why if isinstance(error, WeightsError) else f"cannot use the weights {sys.argv[1]}: {why}"
        answers.write(line.encode())
        answers.flush()
        os._exit(_REFUSED)
    answers.write(found)
    answers.close()
