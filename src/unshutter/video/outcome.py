"""The outcome of a clip, counted frame by frame, for the user, the log and the plot."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from unshutter.export.plot import plot_turns
from unshutter.frames.self_calibration import ReadoutRatio
from unshutter.motion import RotationMotion
from unshutter.reasons import Code, Reason

if TYPE_CHECKING:
    from unshutter.options import FrameModel
    from unshutter.video.clip_gyro import ClipGyro
    from unshutter.video.stabilisation import Stabilisation
from unshutter.video.moving_frames import MovingFrame

_GAP, _GAP_S = 10, 1.0  # frame intervals and seconds without a frame that are reported


@dataclass
class ClipOutcome:
    """The outcome of a clip.

    Attributes:
        source, output: the clip and the new one, as the user named them.
        ratio: readout time in frame intervals, and where it comes from.
        interval_s: the usual time from one frame to the next [s].
        model: how motion was to be described.
        written: whether there is a new clip: not where nothing changes and only changes were asked for.
        after_killed_run: whether leftovers of an earlier run, which was killed, were removed.
        frames: number of frames.
        rectified: how many of them moved.
        dense: how many of these by the flow to their neighbours.
        reasons: why others were left unchanged, and how many.
        cuts_s: when the scene changes [s].
        left_out: streams of the file that the new file has no place for.
        turns: of each frame, when it is shown [s], and how far the camera turned about x, y and z in its rows [rad].
        gyro: the clip's gyro log and what came of it; None: it has none.
        stabilisation: the smoothed path; None: the camera kept its own.
    """

    source: str
    output: str
    ratio: ReadoutRatio
    interval_s: float
    model: FrameModel
    written: bool = True
    after_killed_run: bool = False
    frames: int = 0
    rectified: int = 0
    dense: int = 0
    reasons: Counter[Reason] = field(default_factory=Counter)
    cuts_s: list[float] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    turns: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)
    gyro: ClipGyro | None = None
    stabilisation: Stabilisation | None = None

    @property
    def unchanged(self) -> dict[str, int]:
        """Why frames were left unchanged, in sentences, and how many."""
        counts: Counter[str] = Counter()
        for reason, count in self.reasons.items():
            counts[str(reason)] += count
        return dict(counts)

    @property
    def readout_ms(self) -> float:
        """Readout time of a frame [ms]."""
        return 1000 * self.interval_s * self.ratio.value

    @property
    def gap_s(self) -> tuple[float, float] | None:
        """The longest gap between frames: from when on, and for how long [s]; None: there is none worth mentioning."""
        times = [time_s for time_s, _ in self.turns]
        longest, at = max(((b - a, a) for a, b in pairwise(times)), default=(0.0, 0.0))
        return (at, longest) if longest > max(_GAP * self.interval_s, _GAP_S) else None

    def add(self, moving: MovingFrame) -> None:
        """Counts one more frame."""
        self.frames += 1
        self.dense += moving.dense
        if moving.dense or not moving.motion.is_zero:
            self.rectified += 1
        else:
            self.reasons[moving.motion.reason or Reason(Code.NO_MOTION)] += 1
        time_s, motion = moving.frame.time or 0.0, moving.motion
        if moving.cut:
            self.cuts_s.append(round(time_s, 3))
        is_rotation = isinstance(motion, RotationMotion)
        self.turns.append((time_s, tuple(motion.rotations[-1] - motion.rotations[0]) if is_rotation else (nan,) * 3))

    def add_unchanged(self, frames: int, reason: Reason) -> None:
        """Counts frames that are left unchanged for one reason."""
        self.frames += frames
        self.reasons[reason] += frames

    def as_json(self) -> dict[str, Any]:
        """The record of the run for the log."""
        plausible, ms = self.ratio.plausible, 1000 * self.interval_s
        return {
            "source": self.source,
            "output": self.output,
            "written": self.written,
            "frames": self.frames,
            "rectified": self.rectified,
            "model": self.model,
            "rectified_densely": self.dense,
            "left": self.unchanged,
            "declined": [{**reason.as_json(), "frames": count} for reason, count in self.reasons.items()],
            "cuts_s": self.cuts_s,
            "left_out": self.left_out,
            "readout_ratio": self.ratio.value,
            "readout_ratio_sd": self.ratio.error or None,
            "readout_ms": self.readout_ms,
            "found_by": self.ratio.source,
            **({} if self.gyro is None else {"gyro": self.gyro.as_json()}),
            **({} if self.stabilisation is None else {"stabilised": self.stabilisation.as_json()}),
            **({} if plausible is None else {"plausible_ms": [plausible.lowest * ms, plausible.highest * ms]}),
        }

    def plot(self, path: Path, overwrite: bool) -> None:
        """Draws how fast the camera turned.

        Raises:
            UnshutterError: the picture cannot be written.
        """
        times, turns = (np.array(values, np.float64) for values in zip(*self.turns, strict=True))
        title = f"{Path(self.source).name}, readout time {self.readout_ms:.1f} ms"
        plot_turns(times, 1000 * np.degrees(turns) / self.readout_ms, self.cuts_s, path, title, overwrite)
