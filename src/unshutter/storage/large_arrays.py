"""Pictures larger than memory should hold: arrays that lie in a temporary file, which the system pages in and out."""

from __future__ import annotations

import math
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np  # not imported above: decoding, which starts first, can do without

SPILL_BYTES = 1 << 31  # arrays above this lie in a file


def new_array(shape: tuple[int, ...], dtype: np.dtype | type) -> np.ndarray:
    """An array to be filled, in memory or, when it is large, in a file that goes when nobody needs it any more."""
    import numpy as np

    if math.prod(shape) * np.dtype(dtype).itemsize <= SPILL_BYTES:
        return np.empty(shape, dtype)
    with nameless_file() as file:
        return np.memmap(file, dtype=dtype, mode="w+", shape=shape)


def nameless_file() -> IO[bytes]:
    """A temporary file that goes when nobody has it open or mapped any more, however its process ends."""
    import tempfile  # not above: most photos do without

    return tempfile.TemporaryFile(prefix="unshutter-")
