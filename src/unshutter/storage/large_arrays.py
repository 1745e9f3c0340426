"""Pictures larger than memory should hold: arrays that lie in a temporary file, which the system pages in and out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np  # not imported above: decoding, which starts first, can do without

SPILL_BYTES = 1 << 31  # arrays above this lie in a file


def new_array(shape: tuple[int, ...], dtype: np.dtype | type) -> np.ndarray:
    """An array to be filled, in memory or, when it is large, in a file that goes when nobody needs it any more."""
    import numpy as np

    if math.prod(shape) * np.dtype(dtype).itemsize <= SPILL_BYTES:
        return np.empty(shape, dtype)
    import tempfile  # not above: most photos do without

    with tempfile.TemporaryFile(prefix="unshutter-") as file:  # the mapping outlives the name and the handle
        return np.memmap(file, dtype=dtype, mode="w+", shape=shape)
