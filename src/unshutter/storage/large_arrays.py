"""Arrays too large for memory, kept in a temporary file that the system pages in and out."""

from __future__ import annotations

import math
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np  # not imported above: decoding, which starts first, does not need it

SPILL_BYTES = 1 << 31  # larger arrays are kept in a file


def new_array(shape: tuple[int, ...], dtype: np.dtype | type) -> np.ndarray:
    """Creates an uninitialised array in memory or, if large, in a file that is removed when no longer used."""
    import numpy as np

    if math.prod(shape) * np.dtype(dtype).itemsize <= SPILL_BYTES:
        return np.empty(shape, dtype)
    with nameless_file() as file:
        return np.memmap(file, dtype=dtype, mode="w+", shape=shape)


def nameless_file() -> IO[bytes]:
    """Opens a temporary file that is removed once it is neither open nor mapped, however its process ends."""
    import tempfile  # imported here: most photos do not need it

    return tempfile.TemporaryFile(prefix="unshutter-")
