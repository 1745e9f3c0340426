"""Options for the frames before and after a photo, and for their timing."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypedDict, get_args

from unshutter.errors import UsageError
from unshutter.options.description import option
from unshutter.options.picture import Undo

FrameModel = Literal["camera", "dense"]


def check_ratio(ratio: float | None) -> None:
    """Checks a readout ratio; None, for unknown, is allowed.

    Raises:
        UsageError: it is not above 0 and at most 1.
    """
    if ratio is not None and not 0 < ratio <= 1:
        raise UsageError(
            f"the readout ratio (readout time / time from frame to frame) must be above 0 and at most 1, got {ratio:g}"
        )


@dataclass(frozen=True)
class Clock:
    """How fast frames were taken and read out.

    Attributes:
        readout_ratio: readout time of a frame / time from frame to frame.
        readout_ms, fps: readout time [ms] and frames per second, as an alternative.

    Raises:
        UsageError: both alternatives are used, or a number is impossible.
    """

    readout_ratio: float | None = option(
        None,
        "Readout time of a frame divided by the time between frames, 0 to 1. Default: found from a sequence, if "
        "possible.",
        limits=(0, 1),
    )
    fps: float | None = option(
        None, "Frames per second; together with the readout time, it replaces the ratio.", metavar="N"
    )
    readout_ms: float | None = None  # set by the camera's option of this name

    def __post_init__(self) -> None:
        if self.readout_ratio is not None and self.fps is not None:
            raise UsageError("say either --readout-ratio, or --readout-ms with --fps")
        for each in (self.readout_ms, self.fps):
            if each is not None and not 0 < each < math.inf:
                raise UsageError(f"readout time and frame rate must be positive, got {each:g}")
        if self.is_known:
            check_ratio(self.ratio)

    @property
    def is_known(self) -> bool:
        """Whether the ratio was specified, directly or by readout time and frame rate."""
        return self.readout_ratio is not None or (self.readout_ms is not None and self.fps is not None)

    @property
    def ratio(self) -> float:
        """Readout time / frame interval.

        Raises:
            UsageError: it was not specified.
        """
        if self.readout_ratio is not None:
            return self.readout_ratio
        if self.readout_ms is None or self.fps is None:
            raise UsageError(
                "say how long a readout takes: --readout-ratio (readout time / time from frame to frame), or "
                "--readout-ms with --fps"
            )
        return self.readout_ms * self.fps / 1000


class ClockKeywords(TypedDict, total=False):
    """Keyword arguments corresponding to the fields of :class:`Clock`."""

    readout_ratio: float | None
    fps: float | None


def model_for(model: FrameModel | None, at: float | None, undo: Undo) -> FrameModel | None:
    """Chooses the motion model: as requested, otherwise as other options require; None: as the frames suggest.

    Raises:
        UsageError: the model is unknown, or no single model supports all options.
    """
    if model not in (None, *get_args(FrameModel)):
        raise UsageError(f"unknown model '{model}': choose camera or dense")
    dense, camera = at is not None or undo.edges == "borrow", undo.strength != 1
    if dense and (camera or model == "camera"):
        wrong = "--model camera" if model == "camera" else "--strength"
        raise UsageError(f"--at and --edges borrow are for --model dense: leave out {wrong}")
    if camera and model == "dense":
        raise UsageError("--model dense undoes the whole motion: leave out --strength")
    return "dense" if dense else "camera" if camera else model


@dataclass(frozen=True)
class Neighbours:
    """Frames taken just before and after the photo.

    Attributes:
        clock: timing of the frames.

    Raises:
        UsageError: options for neighbours are used without any neighbour.
    """

    before: Path | None = option(
        None, "Frame taken by the same camera just before the photo. It shows what moved.", names="input"
    )
    after: Path | None = option(None, "Frame taken just after the photo; one of the two is enough.", names="input")
    sequence: bool = option(
        False,
        "The photos are frames from one camera at even intervals, in the order given (in folders: by name). "
        "Their motions are found from one another, and so is the readout ratio unless you give it.",
        page=False,
    )
    clock: Clock = field(default_factory=Clock)
    at: float | None = option(
        None,
        "Moment that the result shows, instead of that of a reference row. In frame intervals, "
        "counted from the photo's first row: with --after, 0.5 is halfway to the next frame.",
    )
    model: FrameModel | None = option(
        None,
        "camera: one motion for the whole picture. dense: near and far objects may move differently. "
        "Default: the one that fits the frames.",
    )
    fallback: bool = option(
        False, "If the neighbouring frames show no motion, use the photo alone. Default: leave the photo unchanged."
    )

    def __post_init__(self) -> None:
        if self.sequence and self:
            raise UsageError("--sequence already gives each photo its neighbours: leave out --before and --after")
        others = self.clock != Clock() or self.at is not None or self.model is not None or self.fallback
        if not (self or self.sequence) and others:
            raise UsageError(
                "--readout-ratio, --fps, --at, --model and --fallback are for a photo with neighbours: "
                "name one with --before or --after, or several with --sequence"
            )
        if self.at is not None and not -1 <= self.at <= 1:
            raise UsageError(f"--at must lie between -1 and 1 frame intervals, got {self.at:g}")

    def __bool__(self) -> bool:
        return self.before is not None or self.after is not None
