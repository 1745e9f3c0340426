"""Annotation types that state an array's data type and shape: jaxtyping's, checked in the tests.

    def rotation_matrix(vectors: Float[Array, "*at 3"]) -> Float[Array, "*at 3 3"]: ...

A dimension is a number, or a name that stands for the same number wherever it appears in one signature; ``*at`` is any
number of dimensions, ``#`` before a name allows broadcasting, ``_`` and ``...`` match anything, and ``{...}`` is
computed from the arguments. The package does not need jaxtyping: the tests import it before anything else.
"""

import sys
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING or not sys.modules.get("jaxtyping"):
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

    Numbers = np.ndarray | np.float64  # NumPy returns a number instead of an array without dimensions

Array: TypeAlias = Any  # NumPy's or torch's, and their common functions (array API); no type states those

__all__ = ["Array", "ArrayLike", "Bool", "Float", "Float32", "Float64", "Numbers", "Real", "UInt", "UInt8"]
