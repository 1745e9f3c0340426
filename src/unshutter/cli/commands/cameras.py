"""``unshutter cameras``."""

from __future__ import annotations

from dataclasses import dataclass

from unshutter.cli.arguments import Command, positional


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    word: list[str] = positional("List only cameras with these words in their name.", "word", optional=True)


def run(arguments: Arguments) -> int:
    """Prints the list."""
    from unshutter.video.cameras import as_text, listed

    print(as_text(listed(" ".join(arguments.word))))
    return 0


COMMAND = Command(
    """List the cameras whose readout time is known: camera and lens, frame size and rate, readout time.

`unshutter video --camera NAME` takes these times. They come from Gyroflow's lens profiles (CC0), where users share
what they measured.""",
    Arguments,
    run,
)
