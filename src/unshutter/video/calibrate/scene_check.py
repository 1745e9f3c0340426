"""Whether each scene of a clip shows the readout time with which it is straightened.

Edited clips join scenes of several cameras, or scenes that were stabilised with others that were not. Undoing a motion
with a readout time that is more than twice as long as the scene's own leaves more distortion than there was. So what a
scene has shown so far is asked again as its frames are rendered: a scene that contradicts is left unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from unshutter.frames.self_calibration import Shot
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate.readout_regression import PairMotion, regression, runs_of

_SOURCES = ReadoutSource.FRAMES, ReadoutSource.REGRESSION, ReadoutSource.USUAL  # those that frames may contradict
_MIN_PAIRS = 30  # pairs of frames
_ERROR = 0.15  # largest standard error of a ratio that counts
_LONGEST = 1.1  # largest such ratio


@dataclass(eq=False)
class SceneCheck:
    """Asks the frames of each scene, in order, whether straightening makes them better."""

    ratio: float  # readout ratio that is undone
    _scene: int = 0
    _shot: int = 0
    _until: float = -np.inf  # time in that shot up to which pairs are known [frame intervals]
    _aspect: float = 1.0  # height of a frame / width
    # motion of each pair of the scene, and the time between its frames; None between two shots
    _pairs: list[tuple[PairMotion | None, float | None]] = field(default_factory=list)

    @classmethod
    def of(cls, time: ReadoutTime, interval_s: float) -> SceneCheck | None:
        """Returns the check for a readout time that frames may contradict; None for those that others state."""
        return cls(time.ratio(interval_s).value) if time.source in _SOURCES else None

    def __call__(self, shot: Shot) -> Reason | None:
        """Returns why the frames of a shot are left unchanged; None if their scene does not contradict."""
        self._add(shot)
        shown = regression(runs_of(self._pairs, self._aspect))
        if shown is None or shown.pairs < _MIN_PAIRS or shown.error > _ERROR or abs(shown.rows.ratio) > _LONGEST:
            return None
        # whether it is certain that less than half of the ratio that is undone is there
        is_certain = self.ratio / 2 - shown.rows.ratio > 3 * shown.error and not shown.is_turned
        return Reason(Code.SCENE_CONTRADICTS) if is_certain else None

    def _add(self, shot: Shot) -> None:
        """Adds the pairs of a shot that are not known yet."""
        if shot.scene != self._scene:
            self._pairs.clear()
        if (shot.scene, shot.number) != (self._scene, self._shot):
            self._pairs.append((None, None))
            self._until = -np.inf
        self._scene = shot.scene
        self._shot = shot.number
        pairs = zip(shot.pairs, shot.times, shot.times[1:], strict=False)
        new = [(tracks, end - begin) for tracks, begin, end in pairs if end > self._until]
        if new:
            motions = PairMotion.through_lens([tracks for tracks, _ in new])
            self._pairs += zip(motions, [gap for _, gap in new], strict=True)
            self._aspect = new[-1][0].height / new[-1][0].width
            self._until = shot.times[len(shot.pairs)]
        del self._pairs[:-240]  # pairs, the last ones of a scene
