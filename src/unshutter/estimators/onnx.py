"""Runs exported networks (ONNX), each in its own process; explains in one line why a file is not the expected network.

A file may contain anything, including divisions that kill the process or endless work. This ends its process, not ours.
"""

from __future__ import annotations

import os
import subprocess
import sys
import weakref
from collections.abc import Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from threading import Event, Lock, Timer
from typing import TYPE_CHECKING, Any

from unshutter import installation
from unshutter.errors import UnshutterError, WeightsError

if TYPE_CHECKING:
    import numpy as np

LONGEST_RUN_S = 60.0  # for opening a network, or running it once; our slowest takes a second
_GRACE_S = 5.0  # after which the other process exits by itself if this one is gone
_NO_WINDOW = getattr(subprocess, "CREATE_NO_WINDOW", 0)  # on Windows


class Network:
    """An exported network. Thread-safe: threads take turns.

    Its process is started when it is opened, restarted if it had to be ended or in a forked process, and ends with this
    object or with this process, however that ends.

    Args:
        name: name of the estimator.
        weights: the network's file.
        inputs: names of its inputs.
        answer: name of its first output.
        opens_fast: skip graph optimisation. This suits a small network with a loop: it runs no slower (40 ms either
            way) but opens in 27 ms instead of 95.

    Raises:
        UnshutterError: onnxruntime is not installed, or the file is not this network.
    """

    def __init__(self, name: str, weights: Path, inputs: Sequence[str], answer: str, opens_fast: bool = False):
        self._name, self._weights = name, weights
        self._inputs, self._answer, self._opens_fast = list(inputs), answer, opens_fast
        self._turn, self._owner = Lock(), os.getpid()
        self._runner: Runner | None = self._opened()

    def answers(self, inputs: dict[str, np.ndarray], *shapes: tuple[int, ...]) -> list[np.ndarray]:
        """Runs the network.

        Args:
            inputs: inputs by name.
            shapes: expected shapes of the outputs. There may be fewer outputs than shapes, but at least one.

        Returns:
            The outputs, float64.

        Raises:
            WeightsError: it cannot run on these inputs, its outputs have other shapes, or it does not finish.
        """
        import numpy as np

        if self._owner != os.getpid():  # forked: the pipes belong to the parent, and it may hold the lock
            self._turn, self._runner, self._owner = Lock(), None, os.getpid()
        with self._turn:
            runner, self._runner = self._runner or self._opened(), None  # the process ends if anything goes wrong
            try:
                _, outputs = runner.ask({"inputs": list(inputs)}, list(inputs.values()))
            except EndedError as ended:
                raise self._refusal(str(ended)) from None
            except RefusedError as refused:
                self._runner = runner
                raise self._refusal(str(refused)) from None
            self._runner = runner
        got = [output.shape for output in outputs]
        if got != list(shapes[: max(len(got), 1)]):
            raise self._refusal(f"they are not of {self._name}")
        if not all(np.isfinite(output).all() for output in outputs):
            raise self._refusal("its answer is not a number")
        return [output.astype(np.float64) for output in outputs]

    def _opened(self) -> Runner:
        """Returns a process that has opened the file and verified that it is this network."""
        if find_spec("onnxruntime") is None:
            raise UnshutterError(f"networks in ONNX files need the extra: {installation.extra('onnx')}")
        runner = Runner()
        try:
            message, _ = runner.ask({"open": str(self._weights.absolute()), "opens_fast": self._opens_fast})
        except (EndedError, RefusedError) as error:
            raise self._refusal(str(error)) from None
        if message["inputs"] != self._inputs or message["outputs"][:1] != [self._answer]:
            raise self._refusal(f"they are not of {self._name}")
        return runner

    def _refusal(self, why: str) -> WeightsError:
        return WeightsError(f"cannot use the weights {self._weights}: {why}")


class RefusedError(Exception):
    """The other process reported an error."""


class EndedError(Exception):
    """The other process was ended, or exited by itself."""


class Runner:
    """A separate process that runs one network. It ends with this object.

    Raises:
        UnshutterError: it cannot be started, or cannot load onnxruntime.
    """

    def __init__(self) -> None:
        # the module search path of this process and nothing else: -P omits the current folder
        paths = os.pathsep.join(os.getcwd() if path == "" else path for path in sys.path)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "unshutter.estimators.onnx_process"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"},
                creationflags=_NO_WINDOW,
                start_new_session=True,  # shields it from Ctrl-C in a terminal
            )
        except OSError as error:
            raise UnshutterError(f"cannot start a process for the network: {error.strerror}") from None
        weakref.finalize(self, _end, self._process, os.getpid())
        try:
            self._receive()
        except (EndedError, RefusedError) as error:
            raise UnshutterError(f"cannot load onnxruntime: {error}") from None

    def ask(self, words: dict[str, Any], arrays: Sequence[np.ndarray] = ()) -> tuple[dict[str, Any], list[np.ndarray]]:
        """Sends a request and returns the answer.

        Raises:
            RefusedError: the request failed.
            EndedError: the process has ended.
        """
        from unshutter.estimators.onnx_messages import send

        limit_s, late = LONGEST_RUN_S, Event()

        def expire() -> None:
            late.set()
            self._process.kill()

        clock = Timer(limit_s, expire)
        clock.daemon = True
        clock.start()
        try:
            send(self._process.stdin, {**words, "limit_s": limit_s + _GRACE_S}, arrays)  # pyright: ignore[reportArgumentType]
            return self._receive()
        except (OSError, EndedError):
            message = f"it was not done after {limit_s:g} s" if late.is_set() else "it makes its process crash"
            raise EndedError(message) from None
        finally:
            clock.cancel()

    def _receive(self) -> tuple[dict[str, Any], list[np.ndarray]]:
        from unshutter.estimators.onnx_messages import receive

        try:
            words, arrays = receive(self._process.stdout)  # pyright: ignore[reportArgumentType]
        except (EOFError, ValueError):
            raise EndedError("its process ended") from None
        if "refusal" in words:
            raise RefusedError(words["refusal"])
        return words, arrays


def _end(process: subprocess.Popen, owner: int) -> None:
    """Ends a process immediately; a forked process leaves its parent's process alone."""
    is_ours = os.getpid() == owner
    if is_ours:
        process.kill()
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):
            if pipe is not None:
                pipe.close()
    if is_ours:
        process.wait()
    else:
        process.returncode = 0  # prevents Python's warning about a running child process


def open_network(
    name: str, weights: Path | None, inputs: Sequence[str], answer: str, opens_fast: bool = False
) -> Network:
    """Opens the network of an estimator; see :class:`Network`.

    Raises:
        UnshutterError: there is no file, onnxruntime is not installed, or the file is not this network.
    """
    if weights is None:
        raise UnshutterError(f"{name} needs the weights of a network")
    return Network(name, weights, inputs, answer, opens_fast)
