"""Opens and runs exported networks (ONNX), each on one thread, or says in one line why a file is not that network.

The only module that imports onnxruntime: from version 1.31 it contains a telemetry client, which has to be switched
off before the import.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from threading import Timer
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError

if TYPE_CHECKING:
    import numpy as np
    from onnxruntime import InferenceSession

LONGEST_RUN_S = 60.0  # the slowest takes a second


def onnx_runtime() -> Any:
    """The module onnxruntime, with its telemetry switched off."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # read when the library is loaded; processes started later inherit it
    import onnxruntime

    return onnxruntime


class Network:
    """An exported network, open. Several threads may use it at once.

    Args:
        session: onnxruntime's.
        name: of the estimator.
        weights: the file that it came from.
    """

    def __init__(self, session: InferenceSession, name: str, weights: Path):
        self._session, self._name, self._weights = session, name, weights

    def answers(self, given: dict[str, np.ndarray], *shapes: tuple[int, ...]) -> list[np.ndarray]:
        """Runs it.

        Args:
            given: what it takes, by name.
            shapes: of its answers. It may give fewer than there are shapes, but one.

        Returns:
            The answers, float64.

        Raises:
            UnshutterError: it cannot be run on that, answers in other shapes, or does not come to an end.
        """
        import numpy as np

        options = onnx_runtime().RunOptions()
        options.log_severity_level = 4  # errors are told below
        timer = Timer(LONGEST_RUN_S, setattr, (options, "terminate", True))
        timer.daemon = True
        timer.start()
        try:
            outputs = [np.asarray(output) for output in self._session.run(None, given, options)]
        except Exception as error:  # onnxruntime's own kinds have no common parent
            if options.terminate:
                raise self._refusal(f"it was not done after {LONGEST_RUN_S:g} s") from None
            raise self._refusal(_cause(error)) from None
        finally:
            timer.cancel()
        got = [output.shape for output in outputs]
        if got != list(shapes[: max(len(got), 1)]) or not all(output.dtype.kind == "f" for output in outputs):
            raise self._refusal(f"they are not of {self._name}")
        if not all(np.isfinite(output).all() for output in outputs):
            raise self._refusal("its answer is no number")
        return [output.astype(np.float64) for output in outputs]

    def _refusal(self, why: str) -> UnshutterError:
        return UnshutterError(f"cannot use the weights {self._weights}: {why}")


def open_network(
    name: str, weights: Path | None, inputs: Sequence[str], answer: str, opens_fast: bool = False
) -> Network:
    """Opens the network of an estimator.

    Args:
        name: of the estimator.
        weights: the exported network.
        inputs: names of what it takes.
        answer: name of its first output.
        opens_fast: skip the optimisation of the graph. Right for a small one with a loop: it runs no slower (40 ms
            either way), but opens in 27 ms instead of 95.

    Raises:
        UnshutterError: there is no file, or it is not this network.
    """
    if weights is None:
        raise UnshutterError(f"{name} needs the weights of a network")
    onnxruntime = onnx_runtime()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # a few milliseconds of work: threads would only spin
    options.log_severity_level = 3
    if opens_fast:
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        options.add_free_dimension_override_by_name("batch_size", 1)  # the more is known, the less there is to plan
        options.enable_mem_reuse = False  # planning it takes a third of the opening, and saves nothing measurable
    try:
        session = onnxruntime.InferenceSession(str(weights), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own kinds have no common parent
        raise UnshutterError(f"cannot use the weights {weights}: {_cause(error)}") from None
    answers = [output.name for output in session.get_outputs()]
    if [i.name for i in session.get_inputs()] != list(inputs) or answers[:1] != [answer]:
        raise UnshutterError(f"cannot use the weights {weights}: they are not of {name}")
    return Network(session, name, weights)


def _cause(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)
