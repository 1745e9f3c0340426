"""Damaged files: how they are damaged, and what may come of them.

``UNSHUTTER_FUZZ_CASES`` says how many cases each test tries (100 by default); thousands take minutes.
"""

import faulthandler
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import gettempdir

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from unshutter import UnshutterError

CASES = int(os.environ.get("UNSHUTTER_FUZZ_CASES", "100"))
MOST_MEMORY = 600_000_000  # bytes above what was used before: many times what a picture of 4 megapixels takes
LONGEST_S, HANG_S = 5, 60
_hang_told_in = (Path(gettempdir()) / "unshutter-fuzz-hang.txt").open("w")
thorough = settings(
    max_examples=CASES, deadline=None, database=None, suppress_health_check=list(HealthCheck), derandomize=CASES <= 300
)

# ---- what happens to files -----------------------------------------------------------------------------------

Change = Callable[[bytearray, int, int, int], None]  # of a file, at a place, with a length and a value


def flip(data: bytearray, at: int, length: int, value: int) -> None:
    data[at] ^= 1 << value % 8


def noise(data: bytearray, at: int, length: int, value: int) -> None:
    data[at : at + length] = np.random.default_rng(value).bytes(min(length, len(data) - at))


def cut(data: bytearray, at: int, length: int, value: int) -> None:
    del data[at:]


def drop(data: bytearray, at: int, length: int, value: int) -> None:
    del data[at : at + length]


def double(data: bytearray, at: int, length: int, value: int) -> None:
    data[at:at] = data[at : at + length] * (1 + value % 50)


def extreme(data: bytearray, at: int, length: int, value: int) -> None:
    """A number that sizes, counts and offsets are seldom."""
    number = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0xFFFFFFF0)[value % 10]
    size = (1, 2, 4, 8)[length % 4]
    order = "little" if value & 16 else "big"
    data[at : at + size] = (number & (1 << 8 * size) - 1).to_bytes(size, order)


CHANGES: tuple[Change, ...] = (flip, noise, cut, drop, double, extreme, extreme)


def damaged(draw: st.DrawFn, whole: bytes) -> bytes:
    """A file with one to six changes, half of them within its first 400 bytes, where the headers are."""
    data = bytearray(whole)
    for _ in range(draw(st.integers(1, 6))):
        change = draw(st.sampled_from(CHANGES))
        end = max(min(len(data), 400) if draw(st.booleans()) else len(data), 1)
        at = draw(st.integers(0, end - 1))
        if data:
            change(data, min(at, len(data) - 1), draw(st.integers(1, 64)), draw(st.integers(0, 2**16)))
    return bytes(data)


# ---- what may come of it -------------------------------------------------------------------------------------


def peak_memory() -> int:
    """Bytes that this process ever used; on Linux, since `memory` was last asked."""
    if sys.platform == "win32":
        return 0
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def memory() -> int:
    """Bytes that this process uses now (where the system tells no more: ever used), from which the peak then rises."""
    if sys.platform == "linux":
        Path("/proc/self/clear_refs").write_text("5")  # the peak is what is used now
    return peak_memory()


def check(read: Callable[[], object]) -> object:
    """What was read, or None after a clear refusal, soon and with little memory.

    A hang ends the test run, and leaves the place where it hangs in a file: the test cannot interrupt a decoder.
    """
    faulthandler.dump_traceback_later(HANG_S, exit=True, file=_hang_told_in)
    before, start = memory(), time.process_time()
    try:
        result = read()
    except UnshutterError as error:
        result, message = None, str(error)
        assert 0 < len(message) < 20_000  # it may quote what is wrong
        assert "\n" not in message
        assert "Traceback" not in message
    finally:
        faulthandler.cancel_dump_traceback_later()
    assert peak_memory() - before < MOST_MEMORY
    assert time.process_time() - start < LONGEST_S
    return result
