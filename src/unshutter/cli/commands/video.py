"""``unshutter video``."""

from __future__ import annotations

from dataclasses import dataclass, field

from unshutter.cli.arguments import Command, positional, required
from unshutter.errors import UnknownRatioError
from unshutter.video.options import RectifyClip


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    clip: str = positional("A film (.mp4, .mov, .mkv ...), a folder of numbered pictures, or frames/%05d.png.", "input")
    output: str = required(
        "File to write; for pictures a new folder, or a pattern such as out/%05d.png.", "output", short="-o"
    )
    how: RectifyClip = field(default_factory=RectifyClip)


def run(arguments: Arguments) -> int:
    """Rectifies the clip; returns the exit code."""
    from unshutter.video.rectifying import rectify_clip

    try:
        rectify_clip(arguments.clip, arguments.output, arguments.how)
    except UnknownRatioError as error:
        raise error.with_advice("say it with --readout-ms, or name the camera with --camera") from None
    return 0


COMMAND = Command(
    """Straighten a clip: every frame as a global shutter would have seen it.

The frames show how the camera moved, and usually how long it takes to read one out. Sound, other tracks, tags and
timestamps stay as they are. Needs the extra `video`.""",
    Arguments,
    run,
    when_stopped="no half-written file is left",
)
