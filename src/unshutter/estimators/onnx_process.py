"""The separate, killable process that runs a network: ``python -m unshutter.estimators.onnx_process``.

It reads requests from its standard input and answers on its standard output (onnx_messages.py). This is the only module
that imports onnxruntime, which contains a telemetry client from version 1.31 on that must be disabled before the
import. onnxruntime's output on standard error is not meant for users either: the process has no standard error.
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
    """Returns the module onnxruntime, with telemetry disabled."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # read when the library is loaded; inherited by later child processes
    import onnxruntime

    return onnxruntime


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answers requests until the input ends: first one to open a network, then those to run it."""
    try:
        onnx_runtime()
    except Exception as error:  # the library cannot be loaded
        send(answers, {"refusal": _cause(error)})
        return
    send(answers, {"ready": True})
    session: Any = None
    while True:
        try:
            words, arrays = receive(requests)
        except EOFError:
            return
        # It must not run indefinitely if its parent has been killed. This timer works even if Python is blocked.
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
        except Exception as error:  # onnxruntime's exceptions have no common base class
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
        options.add_free_dimension_override_by_name("batch_size", 1)  # fixed shapes reduce planning
        options.enable_mem_reuse = False  # takes a third of the opening time without measurable benefit
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def _run(session: InferenceSession, inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
    outputs = [np.asarray(output) for output in session.run(None, inputs)]
    if not all(output.dtype.kind == "f" for output in outputs):
        raise ValueError("it answers with something else than floating-point numbers")
    return outputs


def _cause(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)


def main() -> None:
    """Runs the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the parent, which ends this process
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # keeps libraries' output out of the answers
    try:
        serve(sys.stdin.buffer, answers)
    except OSError:  # the parent is gone
        os._exit(1)


if __name__ == "__main__":
    main()
