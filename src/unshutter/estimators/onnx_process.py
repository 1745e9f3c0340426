"""The process that runs a network for another one, and can be ended: ``python -m unshutter.estimators.onnx_process``.

It opens and runs what it is asked to on its standard input, and answers on its standard output (onnx_messages.py). The
only module that imports onnxruntime: from version 1.31 it contains a telemetry client, which has to be switched off
before the import. Its lines on standard error are not for users either: the process has none.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from unshutter.estimators.onnx_messages import receive, send

if TYPE_CHECKING:
    from onnxruntime import InferenceSession


def onnx_runtime() -> Any:
    """The module onnxruntime, with its telemetry switched off."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # read when the library is loaded; processes started later inherit it
    import onnxruntime

    return onnxruntime


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answers requests until there are no more: first one to open a network, then those to run it."""
    try:
        onnx_runtime()
    except Exception as error:  # a library that cannot be loaded
        send(answers, {"refusal": _cause(error)})
        return
    send(answers, {"ready": True})
    session: Any = None
    while True:
        try:
            words, arrays = receive(requests)
        except EOFError:
            return
        # Asked by somebody who was killed meanwhile, it must not go on for ever. This clock needs no help of Python's.
        faulthandler.dump_traceback_later(words["limit_s"], exit=True, file=sys.stderr)
        try:
            if "open" in words:
                session = _opened(words["open"], words["opens_fast"])
                description = {
                    "inputs": [each.name for each in session.get_inputs()],
                    "outputs": [each.name for each in session.get_outputs()],
                }
                send(answers, description)
            else:
                send(answers, {}, _run(session, dict(zip(words["inputs"], arrays, strict=True))))
        except Exception as error:  # onnxruntime's own kinds have no common parent
            send(answers, {"refusal": _cause(error)})
        finally:
            faulthandler.cancel_dump_traceback_later()


def _opened(path: str, opens_fast: bool) -> InferenceSession:
    onnxruntime = onnx_runtime()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # a few milliseconds of work: threads would only spin
    options.log_severity_level = 4
    if opens_fast:
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        options.add_free_dimension_override_by_name("batch_size", 1)  # the more is known, the less there is to plan
        options.enable_mem_reuse = False  # planning it takes a third of the opening, and saves nothing measurable
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def _run(session: InferenceSession, inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
    outputs = [np.asarray(output) for output in session.run(None, inputs)]
    if not all(output.dtype.kind == "f" for output in outputs):
        raise ValueError("it answers with something else than floating-point numbers")
    return outputs


def _cause(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)


def main() -> None:
    """The program."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asks, which ends this one
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print is not mistaken for an answer
    try:
        serve(sys.stdin.buffer, answers)
    except OSError:  # nobody reads the answer any more
        os._exit(1)


if __name__ == "__main__":
    main()
