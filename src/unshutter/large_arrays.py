"""Pictures larger than memory should hold: arrays that lie in a temporary file, which the system pages in and out."""

from __future__ import annotations

import math

import numpy as np

SPILL_BYTES = 1 << 31  # arrays above this lie in a file


def new_array(shape: tuple[int, ...], dtype: np.dtype | type) -> np.ndarray:
    """An array to be filled, in memory or, when it is large, in a file that goes when nobody needs it any more."""
    if math.prod(shape) * np.dtype(dtype).itemsize <= SPILL_BYTES:
        return np.empty(shape, dtype)
    import tempfile  # not above: most photos do without

    with tempfile.TemporaryFile(prefix="unshutter-") as file:  # the mapping outlives the name and the handle
        return np.memmap(file, dtype=dtype, mode="w+", shape=shape)
