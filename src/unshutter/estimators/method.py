"""One method, as it is known without importing it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Method:
    """A method's entry in the register.

    Attributes:
        name: by which users ask for it.
        summary: one line for ``unshutter models``.
        home: ``module:class`` of its :class:`Estimator`.
        grey_px: short side [px] of the grey copy that it works on (``View.grey``), so that decoding can start before
            the method is imported; None: it uses none.
        weights: the file that it runs on; None: it needs none.
        scores: file with what was measured of it (``unshutter models``); None: nothing was.
        takes_weights: whether NAME@FILE runs it with the user's own weights.
    """

    name: str
    summary: str
    home: str
    grey_px: int | None = None
    weights: Path | None = None
    scores: Path | None = None
    takes_weights: bool = False
