"""How frames follow each other before and after their motion is undone, and whether they lean as the speed says.

What is left of tracks that a fit does not know falls with any readout time, even with one of the wrong sign, since a
path can imitate any motion that depends on the row. Two things cannot be imitated. A frame leans by half the readout
ratio times the camera's speed. And what is skewed and stretched from frame to frame, apart from what depth adds, is the
wobble that people see: its largest steps must not grow, and none may appear where there were none.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from unshutter.motion.shapes import Float64
from unshutter.video.readout_regression import PairMotion

_FEWEST = 15  # pairs, below which the figures say nothing
_MAY_GROW, _MAY_GROW_ONCE = 1.1, 1.5  # times: by which large steps may grow; one, where all others get much smaller
FOLLOWS = 0.5  # least correlation of the lean with the speed
_MOVES_PX = 0.5  # speed of the picture [px of 1080 rows per frame], root mean square: below that, frames do not lean
_LARGE = 95  # percentile of the steps
_ROUNDS = 8  # of reweighting


@dataclass(frozen=True)
class StepSizes:
    """How much frames are skewed and stretched against the previous ones, apart from what depth adds [px]."""

    rms: float  # root mean square, at the top and bottom rows
    usual: float  # 95th percentile
    largest: float

    @classmethod
    def of(cls, shapes: Float64[np.ndarray, "pairs 2"], speeds: Float64[np.ndarray, "pairs 2"]) -> StepSizes:
        """Returns the sizes for skew and stretch of each pair of frames, and the picture's speed."""
        own = np.concatenate([np.ones((len(speeds), 1)), speeds], axis=1)
        left = np.stack([_left(shape, own) for shape in shapes.T], axis=1)
        sizes = np.hypot(*left.T)
        return cls(float(np.sqrt(2 * np.mean(left**2))), float(np.percentile(sizes, _LARGE)), float(sizes.max()))

    def is_worse_than(self, other: StepSizes, slack: float) -> bool:
        """Whether large steps are larger than others, by more than a tenth and some slack [px].

        Where the others are twice as large in general, a single step may be somewhat larger.
        """
        once = _MAY_GROW_ONCE if self.usual < other.usual / 2 else _MAY_GROW
        grows = self.usual > _MAY_GROW * other.usual + slack or self.largest > once * other.largest + slack
        return grows or self.rms > max(other.rms, slack)


@dataclass(eq=False)
class FrameSteps:
    """Frames in order, as they were and as they are when their motion is undone."""

    rows: int = 1080  # of the copies in which tracks were found; pixels are theirs
    _pairs: list[tuple[PairMotion, PairMotion] | None] = field(default_factory=list)  # before and after
    _leans: list[Float64[np.ndarray, "2"]] = field(default_factory=list)

    def add(self, before: PairMotion | None, after: PairMotion | None, lean: Float64[np.ndarray, "2"]) -> None:
        """Adds a frame.

        Args:
            before: motion of the picture since the previous frame; None if it is unknown, or there is none.
            after: the same, with the motion undone.
            lean: displacement of the frame's last row against its middle (across, down) that is undone [heights of
                the frame].
        """
        self._pairs.append(None if before is None or after is None else (before, after))
        self._leans.append(lean)

    @property
    def sizes(self) -> tuple[StepSizes, StepSizes] | None:
        """Sizes of the steps before and after; None if there are too few."""
        known = [pair for pair in self._pairs if pair is not None]
        if len(known) < _FEWEST:
            return None
        speeds = np.array([before.shift for before, _ in known])
        before, after = (StepSizes.of(np.array([pair[k].shape for pair in known]), speeds) for k in range(2))
        return before, after

    @property
    def follow(self) -> float:
        """Correlation of the frames' lean with the picture's speed, about their means' size; NaN if nothing moved."""
        leans = []
        speeds = []
        for k in range(len(self._pairs) - 1):
            here = self._pairs[k]
            following = self._pairs[k + 1]
            if here is not None and following is not None:
                leans.append(self._leans[k])
                speeds.append((here[0].shift + following[0].shift) / 2)
        if len(leans) < _FEWEST:
            return np.nan
        lean = np.array(leans)
        speed = np.array(speeds)
        size = float(np.sqrt((lean**2).sum() * (speed**2).sum()))
        moves = float(np.sqrt((speed**2).sum(axis=1).mean())) > _MOVES_PX * self.rows / 1080
        return float((lean * speed).sum()) / size if size > 0 and moves else np.nan


def _left(values: Float64[np.ndarray, "pairs"], own: Float64[np.ndarray, "pairs 3"]) -> Float64[np.ndarray, "pairs"]:
    """Returns what a constant and the speed leave of some values, robustly."""
    weights = np.ones(len(values))
    left = values
    for _ in range(_ROUNDS):
        root = np.sqrt(weights)
        left = values - own @ np.linalg.lstsq(own * root[:, None], values * root, rcond=None)[0]
        scale = max(1.4826 * float(np.median(np.abs(left))), 1e-9)
        weights = 1 / (1 + (left / (2.5 * scale)) ** 2)
    return left
