"""One method, as it is known without importing it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

_WEIGHTS = Path(__file__).parents[1] / "weights"  # importlib.resources says the same, but takes 10 ms to import


@dataclass(frozen=True)
class Method:
    """A method's entry in the register.

    Attributes:
        name: by which users ask for it.
        summary: one line for ``unshutter models``.
        home: ``module:class`` of its :class:`Estimator`.
        grey_px: short side [px] of the grey copy that it works on (``View.grey``), so that decoding can start before
            the method is imported; None: it uses none.
        weights: file in ``unshutter/weights`` that it runs on (``.onnx`` may be left out); None: none of them.
        takes_weights: whether NAME@FILE runs it with the user's own weights.
    """

    name: str
    summary: str
    home: str
    grey_px: int | None = None
    weights: str | None = None
    takes_weights: bool = False

    @property
    def weights_path(self) -> Path | None:
        """The weights in the package that it runs on, if any."""
        if self.weights is None:
            return None
        return _WEIGHTS / (self.weights if "." in self.weights else f"{self.weights}.onnx")
