"""The command ``unshutter synthesize``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from unshutter.cli.arguments import Command, positional, required
from unshutter.errors import UsageError
from unshutter_lab.synthesis.options import Synthesize, SynthesizeClip


@dataclass(frozen=True)
class Arguments:
    """Arguments of the command."""

    photos: list[Path] = positional("Photos, or folders of photos.", "input")
    output: Path = required("New folder; gets rs/, gs/, motion/ and manifest.json.", "output", short="-o")
    pictures: Synthesize = field(default_factory=Synthesize)
    clip: SynthesizeClip = field(default_factory=SynthesizeClip)


def run(arguments: Arguments) -> int:
    """Synthesises the pictures or the clip; returns the exit code."""
    if arguments.clip.video:
        from unshutter_lab.synthesis.clip import synthesize_clip

        if len(arguments.photos) != 1:
            raise UsageError("--video makes one clip: name one photo")
        synthesize_clip(arguments.photos[0], arguments.output, arguments.pictures, arguments.clip)
        return 0
    from unshutter_lab.synthesis.batch import synthesize_files

    return synthesize_files(arguments.photos, arguments.output, arguments.pictures)


COMMAND = Command("Make rolling-shutter pictures with a known motion from undistorted photos.", Arguments, run)
