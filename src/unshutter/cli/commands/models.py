"""``unshutter models``."""

from __future__ import annotations

from dataclasses import dataclass

from unshutter.cli.arguments import Command


@dataclass(frozen=True)
class Arguments:
    """The command takes none."""


def run(arguments: Arguments) -> int:
    """Prints the list."""
    from unshutter.estimators.catalogue import as_text, list_models

    print(as_text(list_models()))
    return 0


COMMAND = Command("List the methods: what each does, how large it is, how well it does.", Arguments, run)
