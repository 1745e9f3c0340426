"""Runs exported networks (ONNX), each time in a process of its own: ``python -m unshutter_lab.methods.onnx``.

A file may contain anything, including divisions that kill the process, endless work and gigabytes. This ends its
process, not ours. This is the only module that imports onnxruntime, which from version 1.31 on contains a telemetry
client that must be disabled before the import.
"""

from __future__ import annotations

import faulthandler
import io
import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError, WeightsError

LONGEST_RUN_S = 60.0  # our slowest takes a second
_GRACE_S = 5.0  # after which the process exits by itself if its parent is gone
_MOST_MEMORY = 2 * 2**30  # bytes, where the system can limit it; ours need a tenth
_REFUSED = 3  # exit status


def run_network(
    name: str, weights: Path | None, rs: np.ndarray, answer: str, *shapes: tuple[int, ...]
) -> list[np.ndarray]:
    """Runs an estimator's network once.

    Args:
        name: name of the estimator.
        weights: the network's file.
        rs: its only input, of that name.
        answer: name of its first output.
        shapes: expected shapes of the outputs. There may be fewer outputs than shapes, but at least one.

    Returns:
        The outputs, float64.
    """
    if weights is None:
        raise WeightsError(f"{name} needs the weights of a network")
    request = io.BytesIO()
    np.save(request, rs)
    # the module search path of this process and nothing else: -P omits the current folder
    paths = os.pathsep.join(os.getcwd() if path == "" else path for path in sys.path)
    told = json.dumps({"answer": answer, "shapes": shapes, "limit_s": LONGEST_RUN_S + _GRACE_S})
    refused = f"cannot use the weights {weights}: "
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "unshutter_lab.methods.onnx", str(weights.absolute()), told],
            input=request.getvalue(),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # onnxruntime's messages are not meant for users
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
        raise WeightsError(refused + (done.stdout.decode("utf-8", "replace") or f"they are not {name} weights"))
    if done.returncode != 0:
        raise WeightsError(f"{refused}it makes its process crash")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as outputs:
        return [outputs[key] for key in outputs]


def onnx_runtime() -> Any:
    """Returns the module onnxruntime, with telemetry disabled."""
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"  # read when the library is loaded
    import onnxruntime

    return onnxruntime


def _main() -> None:
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # keeps libraries' output out of the answers
    told = json.loads(sys.argv[2])
    # It must not run indefinitely if its parent has been killed. This timer works even if Python is blocked.
    faulthandler.dump_traceback_later(told["limit_s"], exit=True, file=sys.stderr)
    with suppress(ImportError, ValueError, OSError):  # Windows and macOS
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
    try:
        outputs = _outputs(sys.argv[1], told["answer"], [tuple(shape) for shape in told["shapes"]])
    except Exception as error:  # onnxruntime's exceptions have no common base class
        why = next(iter(str(error).splitlines()), "") if not isinstance(error, _OtherNetworkError) else ""
        answers.write(why.encode())
        answers.flush()
        os._exit(_REFUSED)
    np.savez(answers, *outputs)
    answers.close()


class _OtherNetworkError(Exception):
    """Its inputs or outputs have other names or shapes."""


def _outputs(path: str, answer: str, shapes: list[tuple[int, ...]]) -> list[np.ndarray]:
    """Runs the network on the array in the standard input."""
    rs = np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False)
    onnxruntime = onnx_runtime()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # a few milliseconds of work: threads would only spin
    options.log_severity_level = 4
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    names = [each.name for each in session.get_inputs()], session.get_outputs()[0].name
    if names != (["rs"], answer):
        raise _OtherNetworkError
    outputs = [np.asarray(output) for output in session.run(None, {"rs": rs})]
    if [output.shape for output in outputs] != shapes[: len(outputs)]:
        raise _OtherNetworkError
    if not all(output.dtype.kind == "f" and np.isfinite(output).all() for output in outputs):
        raise ValueError("its answer is not a number")
    return [output.astype(np.float64) for output in outputs]


if __name__ == "__main__":
    _main()
