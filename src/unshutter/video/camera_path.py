"""The motion of a whole clip: kept during a first pass over its frames, looked up in a second one.

Only rotations are kept, about 1 kB for each frame, and 3 kB where a gyro says them.
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
    """The motion of the frames of a clip, in their order.

    Attributes:
        undo: how their motion is undone.
        readout: direction in which stored pixels were read.
        height, width: of the readout frame [px].
        times_s: when each frame is shown [s].
        cuts: whether a frame shows another scene than the one before it.
        steps: turn from the frame before to each frame, at the reference row [rad]; NaN where it is unknown.
        focals: focal length of each frame [heights]; NaN where it is unknown.
        borders: how far each frame reaches once its motion is undone (:func:`borders_of`).
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
    _at_reference: np.ndarray = field(default_factory=lambda: np.eye(3))  # of the last frame, since its middle row

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def aspect(self) -> float:
        """Width of the readout frame by its height."""
        return self.width / self.height

    def add(self, motion: Motion, step: Step | None, cut: bool, time_s: float) -> None:
        """The next frame.

        Args:
            motion: of a small picture, first row as the reference.
            step: turn since the frame before; None where it is unknown.
            cut: whether it shows another scene.
            time_s: when it is shown [s].
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
        """The motion of a frame, first row as the reference; zero, with the reason, where it has none."""
        kept = self._motions[frame]
        return kept.motion() if isinstance(kept, _Rows) else RowMotion.zero(ROWS, ROWS, reason=kept)

    def step(self, frame: int) -> Step | None:
        """The camera's turn since the frame before, between middle rows."""
        return self._own_steps[frame]


@dataclass(frozen=True, eq=False)
class _Rows:
    """A rotation motion in little memory."""

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
