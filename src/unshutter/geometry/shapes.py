"""The words in which annotations say what an array holds and what shape it has.

    if TYPE_CHECKING:
        from unshutter.geometry.shapes import Float

    def rotation_matrix(vectors: Float[Array, "*at 3"]) -> Float[Array, "*at 3 3"]: ...

The words are jaxtyping's. A dimension is a number, or a name that stands for the same number wherever it appears in
one signature; ``*at`` is any number of dimensions, ``#`` before a name lets it broadcast, ``_`` and ``...`` may be
anything, and ``{...}`` is worked out from the arguments.

To type checkers they are the array's type alone. While the tests run, each call is checked (tests/support/checked.py).
Nothing else imports this module: jaxtyping is not needed to use the package.
"""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from typing import Annotated as Bool
    from typing import Annotated as Float
    from typing import Annotated as Float32
    from typing import Annotated as Float64
    from typing import Annotated as Real
    from typing import Annotated as UInt
    from typing import Annotated as UInt8

    Numbers = np.ndarray
else:
    from jaxtyping import Bool, Float, Float32, Float64, Real, UInt, UInt8

    Numbers = np.ndarray | np.float64  # NumPy gives a number where an array would have no dimensions

__all__ = ["Bool", "Float", "Float32", "Float64", "Numbers", "Real", "UInt", "UInt8"]
