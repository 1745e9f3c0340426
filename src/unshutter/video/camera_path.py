"""The motion of a whole clip, recorded during a first pass over its frames and looked up during a second one.

Only rotations are stored, about 1 kB per frame, or 3 kB with a gyro.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from unshutter.frames.frame_motion import Step
from unshutter.geometry.readout import Readout
from unshutter.geometry.rotations import rotation_matrix, rotation_vector
from unshutter.motion import Motion, RotationMotion, RowMotion
from unshutter.motion.sampling import row_index
from unshutter.reasons import Reason
from unshutter.video.frame_margins import borders_of
from unshutter.video.moving_frames import ROWS
from unshutter.video.options import ClipUndo

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float32, Float64


@dataclass(eq=False)
class CameraPath:
    """The motion of the frames of a clip, in order.

    Attributes:
        undo: how their motion is undone.
        readout: direction in which stored pixels were read.
        height, width: size of the readout frame [px].
        times_s: presentation time of each frame [s].
        cuts: whether a frame shows another scene than the previous one.
        steps: rotation since the previous frame, at the reference row [rad]; NaN if unknown.
        focals: focal length of each frame [heights]; NaN if unknown.
        borders: extent of each frame once its motion is undone (:func:`borders_of`).
    """

    undo: ClipUndo
    readout: Readout
    height: int
    width: int
    times_s: list[float] = field(default_factory=list)
    cuts: list[bool] = field(default_factory=list)
    steps: list[Float64[np.ndarray, "3"]] = field(default_factory=list)
    focals: list[float] = field(default_factory=list)
    borders: list[Float32[np.ndarray, "4 9"]] = field(default_factory=list)
    _own_steps: list[Step | None] = field(default_factory=list)  # between middle rows
    _motions: list[_Rows | Reason | None] = field(default_factory=list)
    _at_reference: np.ndarray = field(default_factory=lambda: np.eye(3))  # of the last frame, from its middle row

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def aspect(self) -> float:
        """Width of the readout frame divided by its height."""
        return self.width / self.height

    def add(self, motion: Motion, step: Step | None, cut: bool, time_s: float) -> None:
        """Adds the next frame.

        Args:
            motion: motion of a small picture, with the first row as the reference.
            step: rotation since the previous frame; None if unknown.
            cut: whether it shows another scene.
            time_s: presentation time [s].
        """
        focal = np.nan if step is None else step.focal_heights
        at_reference = np.eye(3)
        if isinstance(motion, RotationMotion):
            focal = motion.focal_px / motion.height
            rows = [row_index(reference, motion.height) for reference in ("middle", self.undo.reference)]
            middle, reference = rotation_matrix(motion.rotations[rows])
            at_reference = reference @ middle.T
        turn = np.full(3, np.nan)
        if step is not None and not cut:
            turn = rotation_vector(at_reference @ rotation_matrix(step.turn) @ self._at_reference.T)
        undone = motion.rereferenced(self.undo.reference).scaled(self.undo.strength)
        self.times_s.append(time_s)
        self.cuts.append(cut)
        self.steps.append(turn)
        self.focals.append(focal)
        self.borders.append(borders_of(undone, self.aspect))
        self._own_steps.append(step)
        self._motions.append(_Rows.of(motion) if isinstance(motion, RotationMotion) else motion.reason)
        self._at_reference = at_reference

    def motion(self, frame: int) -> Motion:
        """Returns the motion of a frame, first row as the reference; zero, with a reason, if it has none."""
        kept = self._motions[frame]
        return kept.motion() if isinstance(kept, _Rows) else RowMotion.zero(ROWS, ROWS, reason=kept)

    def step(self, frame: int) -> Step | None:
        """Returns the camera's rotation since the previous frame, between middle rows."""
        return self._own_steps[frame]


@dataclass(frozen=True, eq=False)
class _Rows:
    """Compact storage of a rotation motion."""

    rotations: Float32[np.ndarray, "rows 3"]
    width: int
    focal_px: float
    readout: Readout
    estimator: str

    @classmethod
    def of(cls, motion: RotationMotion) -> _Rows:
        rotations = motion.rotations.astype(np.float32)
        return cls(rotations, motion.width, motion.focal_px, motion.readout, motion.estimator)

    def motion(self) -> RotationMotion:
        rotations = self.rotations.astype(np.float64)
        return RotationMotion(
            self.width, rotations=rotations, focal_px=self.focal_px, readout=self.readout, estimator=self.estimator
        )
