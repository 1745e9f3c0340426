"""What was done to a clip: counted frame by frame, said at the end, added to the log, drawn."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from math import nan
from pathlib import Path

import numpy as np

from unshutter.errors import visible
from unshutter.export.plot import plot_turns
from unshutter.frames.ratio import ReadoutRatio
from unshutter.motion import RotationMotion
from unshutter.storage.json_log import JsonLog
from unshutter.video.clip import Clip
from unshutter.video.moving import Moved
from unshutter.video.options import RectifyClip

_GAP, _GAP_S = 10, 1.0  # frame intervals and seconds without a frame that are told the user


@dataclass
class Done:
    """What was done to a clip.

    Attributes:
        frames: how many there are.
        rectified: how many of them moved.
        dense: how many of these by the flow to the frames beside them.
        reasons: why others were left as they are, and how many.
        cuts_s: when the scene changes [s].
        left_out: what of the file did not find a place.
        turns: of each frame, when it is shown [s], and how far the camera turned about x, y and z in its rows [rad].
    """

    frames: int = 0
    rectified: int = 0
    dense: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    cuts_s: list[float] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    turns: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)

    def add(self, moved: Moved) -> None:
        """One more frame."""
        self.frames += 1
        self.dense += moved.dense
        if moved.dense or not moved.motion.is_zero:
            self.rectified += 1
        else:
            self.reasons[str(moved.motion.reason)] += 1
        time_s, motion = moved.frame.time or 0.0, moved.motion
        if moved.cut:
            self.cuts_s.append(round(time_s, 3))
        known = isinstance(motion, RotationMotion)
        self.turns.append((time_s, tuple(motion.rotations[-1] - motion.rotations[0]) if known else (nan,) * 3))


def _say(line: str) -> None:
    """One line for the user, whatever names hold."""
    print(visible(line), file=sys.stderr)


def _longest_gap(done: Done, interval_s: float) -> tuple[float, float] | None:
    """Where frames are farther apart than frames usually are: from when on, and for how long [s]; None: nowhere."""
    times = [time_s for time_s, _ in done.turns]
    longest, at = max(((b - a, a) for a, b in pairwise(times)), default=(0.0, 0.0))
    return (at, longest) if longest > max(_GAP * interval_s, _GAP_S) else None


def plot(path: Path, source: str, done: Done, readout_s: float, overwrite: bool) -> None:
    """Draws how fast the camera turned."""
    times, turns = (np.array(values, np.float64) for values in zip(*done.turns, strict=True))
    title = f"{Path(source).name}, readout time {1000 * readout_s:.1f} ms"
    plot_turns(times, np.degrees(turns) / readout_s, done.cuts_s, path, title, overwrite)


def tell(
    source: str, output: str, done: Done, ratio: ReadoutRatio, clip: Clip, wanted: RectifyClip, log: JsonLog | None
) -> None:
    """Says what was done, and adds it to the log, where there is one.

    Raises:
        UnshutterError: the log cannot be written.
    """
    left = done.frames - done.rectified
    note, by_camera = "", done.rectified - done.dense
    if wanted.undo.model == "dense" and by_camera:
        note = f" ({by_camera} of them by the camera's motion alone)"
    if left:
        reason, count = done.reasons.most_common(1)[0]
        others = f"; {left - count} for other reasons" if left > count else ""
        note += f", {left} left as they are ({reason}{others})"
    _say(f"{source} -> {output}: {done.rectified} of {done.frames} frames straightened{note}")
    if done.left_out:
        _say(f"unshutter: such files have no place for: {', '.join(done.left_out)}")
    if (gap := _longest_gap(done, clip.interval_s)) is not None:
        at, seconds = gap
        _say(f"unshutter: {source} has no frames for {seconds:.1f} s after {at:.1f} s: part of it may be missing")
    if log is None:
        return
    record = {
        "source": source,
        "output": output,
        "frames": done.frames,
        "rectified": done.rectified,
        "model": wanted.undo.model,
        "rectified_densely": done.dense,
        "left": dict(done.reasons),
        "cuts_s": done.cuts_s,
        "left_out": done.left_out,
        "readout_ratio": ratio.value,
        "readout_ratio_sd": ratio.error or None,
        "readout_ms": 1000 * clip.interval_s * ratio.value,
        "found_by": ratio.source,
    }
    log.add("clip", **record)
