"""``unshutter models`` and ``unshutter cameras``: list methods, and cameras with known readout times."""

from __future__ import annotations

from dataclasses import dataclass

from unshutter.cli.arguments import Command, positional


@dataclass(frozen=True)
class Models:
    """Arguments of ``unshutter models``: none."""


def _models(arguments: Models) -> int:
    """Prints the list of methods."""
    from unshutter.estimators.catalogue import as_text, list_models

    print(as_text(list_models()))
    return 0


MODELS = Command("List the methods: what each one does, its size and its accuracy.", Models, _models)


@dataclass(frozen=True)
class Cameras:
    """Arguments of ``unshutter cameras``."""

    word: list[str] = positional("List only cameras with these words in their name.", "word", optional=True)


def _cameras(arguments: Cameras) -> int:
    """Prints the list of cameras."""
    from unshutter.video.cameras import as_text, listed

    print(as_text(listed(" ".join(arguments.word))))
    return 0


CAMERAS = Command(
    """List the cameras whose readout time is known: camera and lens, frame size and rate, readout time.

`unshutter video --camera NAME` takes these times. They come from Gyroflow's lens profiles (CC0), where users share
what they measured.""",
    Cameras,
    _cameras,
)
