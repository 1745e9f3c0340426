"""What all options' fields are made with."""

from __future__ import annotations

import math
from dataclasses import field
from typing import Any, Literal

from unshutter.errors import UsageError

# What the word of an option names: a file or folder that is read, one that is written, or neither.
Names = Literal["input", "output", "word"]


def option(default: Any, help: str, **more: Any) -> Any:
    """A field with its help; ``more`` is for the command line (cli/arguments.py).

    A path or text needs ``names``, which says what it names (:data:`Names`): a test gives every option that names an
    output the names of all inputs.
    """
    return field(default=default, metadata={"help": help, **more})


def check_time(name: str, time: float | None, unit: str) -> None:
    """Raises UsageError where this is neither None nor a positive time."""
    if time is not None and not 0 < time < math.inf:
        raise UsageError(f"the {name} must take a positive time, got {time:g} {unit}")
