"""``unshutter synthesize``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from unshutter.cli.arguments import Command, positional, required
from unshutter.errors import UsageError
from unshutter_lab.synthesis.options import Synthesize, SynthesizeClip


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    photos: list[Path] = positional("Photos, or folders of photos.", "input")
    output: Path = required("New folder; gets rs/, gs/, motion/ and manifest.json.", "output", short="-o")
    pictures: Synthesize = field(default_factory=Synthesize)
    clip: SynthesizeClip = field(default_factory=SynthesizeClip)


def run(given: Arguments) -> int:
    """Makes the pictures; returns the exit code."""
    if given.clip.video:
        from unshutter_lab.synthesis.clip import synthesize_clip

        if len(given.photos) != 1:
            raise UsageError("--video makes one clip: name one photo")
        synthesize_clip(given.photos[0], given.output, given.pictures, given.clip)
        return 0
    from unshutter_lab.synthesis.batch import synthesize_files

    return synthesize_files(given.photos, given.output, given.pictures)


COMMAND = Command("Make rolling-shutter pictures with known motion from undistorted photos.", Arguments, run)
