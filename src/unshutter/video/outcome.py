"""The outcome of a clip's rectification, for the user, the log and the plot."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from unshutter.export import plot_rotation_rates
from unshutter.inventory import Fate, Part, as_they_were, left_out
from unshutter.motion import RotationMotion
from unshutter.motion.lens import Lens
from unshutter.orientation import ScanDirection
from unshutter.readout_time import ReadoutRatio, ReadoutTime
from unshutter.reasons import Code, JsonObject, Reason
from unshutter.video.file.camera_clock import CameraClock
from unshutter.video.render.clip_motion import MovingFrame
from unshutter.video.render.virtual_gyro import VirtualGyro

if TYPE_CHECKING:
    from unshutter.options import FrameModel
    from unshutter.video.calibrate.clip_gyro import ClipGyro
    from unshutter.video.render.enlargement import Enlargement
    from unshutter.video.render.stabilisation import Stabilisation


@dataclass(eq=False)
class Tally:
    """The frames of a clip, counted one by one."""

    frames: int = 0  # number of frames
    rectified: int = 0  # number of frames rectified
    dense: int = 0  # number of those rectified by the flow to their neighbours
    reasons: Counter[Reason] = field(default_factory=Counter)  # why the others were left unchanged, with counts
    cuts_s: list[float] = field(default_factory=list)  # times of scene changes [s]
    # presentation time [s] and rotation of the camera about x, y and z during the readout [rad], by frame
    rotations: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)

    def add(self, moving: MovingFrame) -> None:
        """Counts another frame."""
        self.frames += 1
        self.dense += moving.dense
        if moving.dense or not moving.motion.is_zero:
            self.rectified += 1
        else:
            self.reasons[moving.found.reason or Reason(Code.NO_MOTION)] += 1
        time_s = moving.frame.time or 0.0
        motion = moving.motion
        if moving.cut:
            self.cuts_s.append(round(time_s, 3))
        is_rotation = isinstance(motion, RotationMotion)
        self.rotations.append(
            (time_s, tuple(motion.rotations[-1] - motion.rotations[0]) if is_rotation else (nan,) * 3)
        )


@dataclass(frozen=True)
class ClipPlan:
    """What would be done with a clip."""

    source: str
    output: str
    reason: Reason | None  # why no frame would be straightened; None if frames would
    fate: Fate  # of the clip: carried if it would be copied, left out if nothing would be written
    parts: list[Part] = field(default_factory=list)  # what would become of those of its file, if it is transformed


@dataclass(frozen=True)
class ClipOutcome:
    """The outcome of rectifying a clip.

    Attributes:
        source, output: the clip and the new one, as named by the user.
        readout_time: readout time, and its source.
        interval_s: the usual time from one frame to the next [s].
        clock: the camera's clock, as far as it differs from the file's.
        picture: height and width of the picture between bars [px], which are left unchanged; None if there are none.
        model: the motion model requested.
        written: whether there is a new clip; False if nothing changed and only changes were requested.
        after_killed_run: whether leftovers of an earlier, killed run were removed.
        frames: number of frames.
        rectified: number of frames rectified.
        dense: number of those rectified by the flow to their neighbours.
        reasons: why the others were left unchanged, with counts.
        cuts_s: times of scene changes [s].
        parts: what became of the parts of the clip's file; empty if it was copied.
        rotations: presentation time [s] and rotation of the camera about x, y and z during the readout [rad], by frame.
        gyro: the clip's gyro log and the result of using it; None if it has none.
        stabilisation: the smoothed path; None if the camera's path was left unchanged.
        enlargement: that of all frames, to hide their borders; None if borders may show, or were not looked for.
        damaged: number of frames that cannot be decoded, and are missing in the new clip.
        lens: the lens, if it bends straight lines.
        lens_degrees: its field of view, from corner to corner of a frame [degrees].
        straight_degrees: that of the new clip, if lines were straightened; otherwise None.
        direction: in which the stored pixels were read, if the frames show another than usual; otherwise None.
        unfit: why frames must not be straightened with this readout time; None if they may be.
        virtual_gyro: what became of the gyro log found in the frames; None if none was asked for.
    """

    source: str
    output: str
    readout_time: ReadoutTime
    interval_s: float
    model: FrameModel
    written: bool = True
    after_killed_run: bool = False
    frames: int = 0
    rectified: int = 0
    dense: int = 0
    reasons: Counter[Reason] = field(default_factory=Counter)
    cuts_s: list[float] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    rotations: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)
    gyro: ClipGyro | None = None
    stabilisation: Stabilisation | None = None
    enlargement: Enlargement | None = None
    lens: Lens | None = None
    lens_degrees: float | None = None
    straight_degrees: float | None = None
    direction: ScanDirection | None = None
    unfit: Reason | None = None
    virtual_gyro: VirtualGyro | None = None
    clock: CameraClock = field(default_factory=CameraClock)
    picture: tuple[int, int] | None = None
    damaged: int = 0

    @property
    def left_out(self) -> list[str]:
        """What the clip's file held and the new one does not, with reasons."""
        return left_out(self.parts)

    @property
    def as_they_were(self) -> list[str]:
        """What might have been straightened, too, and was not, with reasons: further films in the clip's file."""
        return as_they_were(self.parts)

    @property
    def unchanged(self) -> dict[str, int]:
        """Why frames were left unchanged, in sentences, with counts."""
        counts: Counter[str] = Counter()
        for reason, count in self.reasons.items():
            counts[str(reason)] += count
        return dict(counts)

    @property
    def ratio(self) -> ReadoutRatio:
        """Readout time of a frame as a share of the time between frames."""
        return self.readout_time.ratio(self.clock.interval_s(self.interval_s))

    @property
    def readout_ms(self) -> float:
        """Readout time of a frame [ms]."""
        return self.readout_time.ms

    @property
    def gap_s(self) -> tuple[float, float] | None:
        """Start and length of the longest gap between frames [s]; None if it is negligible."""
        times = [time_s for time_s, _ in self.rotations]
        longest, at = max(((b - a, a) for a, b in pairwise(times)), default=(0.0, 0.0))
        return (at, longest) if longest > max(10 * self.interval_s, 1.0) else None

    def as_json(self) -> JsonObject:
        """Returns the record of the run for the log."""
        plausible = self.readout_time.plausible_ms
        ratio = self.ratio
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
            "as_they_were": self.as_they_were,
            "parts": [part.as_json() for part in self.parts],
            "readout_ratio": ratio.value,
            "readout_ratio_sd": ratio.error or None,
            "readout_ms": self.readout_ms,
            "found_by": self.readout_time.source,
            **({} if self.gyro is None else {"gyro": self.gyro.as_json()}),
            **({} if self.virtual_gyro is None else {"virtual_gyro": self.virtual_gyro.as_json()}),
            **({} if self.stabilisation is None else {"stabilised": self.stabilisation.as_json()}),
            **({} if self.enlargement is None else {"enlarged": self.enlargement.as_json()}),
            **({} if self.lens is None else {"lens": {**self.lens.as_json(), "degrees": self.lens_degrees}}),
            **({} if plausible is None else {"plausible_ms": list(plausible)}),
            **({} if self.direction is None else {"readout": self.direction}),
            **({} if self.clock.is_files else {"camera_fps": round(1 / self.clock.interval_s(self.interval_s), 4)}),
            **({"damaged": self.damaged} if self.damaged else {}),
            **({} if self.picture is None else {"picture": list(self.picture)}),
            **({} if self.readout_time.shown_s is None else {"shown_ms": 1000 * self.readout_time.shown_s}),
        }

    def plot(self, path: Path, overwrite: bool) -> None:
        """Plots how fast the camera turned.

        Raises:
            UnshutterError: the picture cannot be written.
        """
        times, rotations = (np.array(values, np.float64) for values in zip(*self.rotations, strict=True))
        title = f"{Path(self.source).name}, readout time {self.readout_ms:.1f} ms"
        plot_rotation_rates(times, 1000 * np.degrees(rotations) / self.readout_ms, self.cuts_s, path, title, overwrite)
