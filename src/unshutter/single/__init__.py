"""Estimates motion from a single photo; methods can be listed without importing them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Method:
    """A method's entry in the register.

    Attributes:
        name: name by which users select it.
        summary: one line for ``unshutter models``.
        home: ``module:class`` of its :class:`Estimator`.
        grey_px: short side [px] of the grey copy it works on (``View.grey``), so that decoding can start before the
            method is imported; None if it uses none.
        weights: its weights file; None if it needs none.
        scores: file with its measured accuracy (``unshutter models``); None if not measured.
        takes_weights: whether NAME@FILE runs it with the user's own weights.
    """

    name: str
    summary: str
    home: str
    grey_px: int | None = None
    weights: Path | None = None
    scores: Path | None = None
    takes_weights: bool = False
