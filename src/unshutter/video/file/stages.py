"""Progress of the work on a clip: the share that is done and the time left, from the cost of its stages."""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import Enum
from functools import partial
from threading import Lock

from unshutter.progress import ClipObserver

_PATIENCE_S = 2.0  # of work, before anything is said of the rest
_CLOSING_S = 0.05  # what is left once all frames are done


class Stage(Enum):
    """A stage of the work on a clip, and what is counted in it."""

    SURVEY = "frames in which corners are tracked, to know the camera"
    ALIGN = "pairs of frames that are aligned with a gyro log, each round"
    SEARCH = "pairs of frames in a fit for the readout time"
    JUDGE = "pairs of frames in a fit that tells what undoing the motion gains"
    SURVEY_ALL = "frames in which corners are tracked, before a clip is left by what some of its frames show"
    JUDGE_ALL = "pairs of frames in a fit that tells the gain then"
    FOLLOW = "frames in which corners are tracked, to find their motion"
    FIT = "pairs of frames in a fit that finds their motion"
    READ = "frames whose motion is known"
    LINK = "frames linked to their neighbours by the flow"
    DRAW = "frames warped"
    ENCODE = "frames encoded"


# what each takes [s], and what each million pixels of a frame adds: medians of three real clips of 640x360 px, as they
# are and enlarged to 1080p, with two cores; of two others what these do not need
_COSTS_S = {
    Stage.SURVEY: (0.010, 0.003),
    Stage.ALIGN: (0.0005, 0.0),
    Stage.SEARCH: (0.0006, 0.0),
    Stage.JUDGE: (0.0013, 0.0),
    Stage.SURVEY_ALL: (0.010, 0.003),
    Stage.JUDGE_ALL: (0.0013, 0.0),
    Stage.FOLLOW: (0.010, 0.003),
    Stage.FIT: (0.0013, 0.0),
    Stage.READ: (0.001, 0.005),
    Stage.LINK: (0.17, 0.0),
    Stage.DRAW: (0.001, 0.025),
    Stage.ENCODE: (0.001, 0.030),
}


# of these it is known how many frames they are for, but not how many fits each takes: until they are stated to be done,
# half as many are expected as were done
_GUESSED = {Stage.SEARCH, Stage.JUDGE, Stage.JUDGE_ALL}


class Work:
    """The stages of a task; the share that is done never falls.

    Stages that nobody expected take their part, too. The time that is left follows from the pace so far.

    Args:
        observer: hears of each step.
        megapixels: of a frame [10^6 px].
    """

    def __init__(self, observer: ClipObserver, megapixels: float):
        self.observer = observer
        self._costs_s = {stage: once + more * megapixels for stage, (once, more) in _COSTS_S.items()}
        self._left = dict.fromkeys(Stage, 0)  # number of items
        self._done = dict.fromkeys(Stage, 0)  # number of items since the stage was expected
        self._share = 0.0
        self._spent_s = 0.0  # cost of what is done
        self._began_s = time.monotonic()
        self._one_at_a_time = Lock()  # frames are decoded, followed and drawn in different threads

    def expect(self, items: dict[Stage, int]) -> None:
        """States how many items of some stages are left; the others keep their numbers."""
        with self._one_at_a_time:
            self._left |= items
            self._done |= dict.fromkeys(items, 0)

    def expect_as_before(self, stage: Stage, done: int, left: int) -> None:
        """States that each remaining frame takes as many items as those begun since ``expect``.

        Args:
            done: number of frames that were begun, at least 1.
            left: number of frames that are not done.
        """
        with self._one_at_a_time:
            self._left[stage] = round(self._done[stage] * left / done)

    def advance(self, stage: Stage, items: int = 1) -> None:
        """Counts items of a stage that are done."""
        with self._one_at_a_time:
            self._done[stage] += items
            if stage in _GUESSED:
                self._left[stage] = max(self._left[stage], items + int(0.5 * self._done[stage]))
            elif self._left[stage] < items:
                self._left[stage] = items + int(0.1 * self._done[stage])  # it takes longer than expected
            cost_s = self._costs_s[stage] * items
            self._share += (1 - self._share) * cost_s / self._left_s
            self._left[stage] -= items
            self._spent_s += cost_s
            self._tell()

    def name(self, what: str, done: int, total: int) -> None:
        """Tells the observer how many items of a kind are done."""
        with self._one_at_a_time:
            self.observer.note_progress(what, done, total)

    def counts(self, stage: Stage) -> Callable[[int], None]:
        """Returns a function that counts items of a stage."""
        return partial(self.advance, stage)

    def finish(self) -> None:
        """States that everything is done, whatever was expected."""
        with self._one_at_a_time:
            self.observer.note_share(1.0, 0.0)

    @property
    def _left_s(self) -> float:
        """Cost of what is left."""
        return sum(self._costs_s[stage] * items for stage, items in self._left.items()) + _CLOSING_S

    def _tell(self) -> None:
        passed_s = time.monotonic() - self._began_s
        left_s = self._left_s * passed_s / self._spent_s if passed_s > _PATIENCE_S and self._spent_s else None
        self.observer.note_share(self._share, left_s)


class Steps:
    """Counts the steps of one kind, which the observer knows by name."""

    def __init__(self, work: Work, what: str, total: int, stage: Stage | None = None):
        self._work = work
        self._what = what
        self._total = total
        self._stage = stage
        self._done = 0

    def advance(self, count: int = 1) -> None:
        """Marks ``count`` more steps as done."""
        self._done += count
        self._work.name(self._what, self._done, self._total)
        if self._stage is not None:
            self._work.advance(self._stage, count)
