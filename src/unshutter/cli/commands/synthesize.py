"""``unshutter synthesize``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from unshutter.cli.arguments import Command, positional, required
from unshutter.options import Synthesize


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    photos: list[Path] = positional("Photos, or folders of photos.")
    output: Path = required("New folder; gets rs/, gs/, motion/ and manifest.json.", short="-o")
    pictures: Synthesize = field(default_factory=Synthesize)


def run(given: Arguments) -> int:
    """Makes the pictures; returns the exit code."""
    from unshutter.batch.synthesizing import synthesize_files

    return synthesize_files(given.photos, given.output, given.pictures)


COMMAND = Command("Make rolling-shutter pictures with known motion from undistorted photos.", Arguments, run)
