"""What unshutter-lab, the second distribution of this repository, adds: known here so that a message can say so."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

METHODS = frozenset(
    ("kandula2020", "rengarajan2017", "rengarajan2017-vanilla", "rengarajan2016", "purkait2017", "lao2018")
)
COMMANDS = frozenset(("synthesize", "evaluate", "train", "calibrate"))
INSTALLATION = "pip install ./lab in the sources of unshutter, or, once released, pip install unshutter-lab"


def plugins(group: str) -> EntryPoints:
    """What installed packages, the lab among them, add to ``unshutter.estimators`` or ``unshutter.commands``."""
    from importlib.metadata import entry_points  # slow to import, and rarely needed

    return entry_points(group=group)
