"""One method, as it is known without importing it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

_WEIGHTS = Path(__file__).parents[1] / "weights"  # importlib.resources says the same, but takes 10 ms to import


@dataclass(frozen=True)
class Method:
    """What is said of a method in the register.

    Attributes:
        name: by which it is asked for.
        summary: one line for ``unshutter models``.
        home: ``module:class`` of its :class:`Estimator`.
        grey_px: short side of the grey copy that it asks the photo for [px], so that decoding can start before the
            method is imported; None: it asks for none.
        weights: stem of the file in ``unshutter/weights`` that it runs on; None: no such file.
        takes_weights: whether NAME@FILE runs it with weights of the user's own.
        ships: whether it runs without such; False: NAME@FILE only.
    """

    name: str
    summary: str
    home: str
    grey_px: int | None = None
    weights: str | None = None
    takes_weights: bool = False
    ships: bool = True

    @property
    def weights_path(self) -> Path | None:
        """The package's own weights, where it runs on some."""
        return None if self.weights is None else _WEIGHTS / f"{self.weights}.onnx"
