"""How many photos of a folder moved, found from all of them: a base rate for the decision on each.

A single photo is judged as if half of all photos moved. Of a hundred photos that a camera took within an hour, usually
none moved, or, from a train, nearly all. Their log odds (motion/finding.py, ``MotionOdds``) show which, by expectation
maximisation of the one unknown share. Every photo is first judged by itself; those that the share decides differently
are then done again. The share that applies to a photo is found from the others, so a single photo changes nothing.

Photos that name no camera may be those of strangers: that others moved does not show that this one did. They can only
make one another more cautious.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from unshutter.reasons import JsonObject
from unshutter.run.job import Job, Outcome

PRIOR = 10.0  # photos that moved, and as many that did not, are added to those of the folder
MOST = math.log(4)  # log odds; the same as for a camera that is known to have moved (single/prospects.py)


@dataclass(frozen=True)
class Judged:
    """What became of one photo of a folder."""

    group: str  # folder, camera and hour, with "|" between them (run/work.py)
    log_odds: float  # that it moved, if half of all photos did
    decision_threshold: float  # log odds of the folder from which it is undone
    used: float  # log odds of the folder with which it was judged

    @classmethod
    def of(cls, job: Job, outcome: Outcome) -> Judged | None:
        """Returns what became of a photo; None if it and the others say nothing about each other."""
        motion_odds = None if outcome.verdict is None or outcome.model else outcome.verdict.finding.motion_odds
        if motion_odds is None:
            return None
        return cls(outcome.group, motion_odds.log_odds, motion_odds.decision_threshold, job.folder_log_odds or 0.0)

    @classmethod
    def from_json(cls, record: JsonObject) -> Judged | None:
        """Reads :meth:`as_json` from a record of the manifest."""
        try:
            data = record["folder"]
            return cls(str(data["group"]), *(float(data[name]) for name in ("log_odds", "turning_point", "used")))
        except (TypeError, KeyError, ValueError):  # none, or by another version
            return None

    def as_json(self) -> JsonObject:
        """Returns it ready for JSON."""
        numbers = {"log_odds": self.log_odds, "turning_point": self.decision_threshold, "used": self.used}
        return {"folder": {"group": self.group, **{name: round(number, 4) for name, number in numbers.items()}}}

    @property
    def most(self) -> float:
        """Highest log odds that the other photos can lend it; 0 unless its camera is named."""
        camera = self.group.rpartition("|")[0].rpartition("|")[2]
        return MOST if camera else 0.0


def shares_moved(log_odds: Sequence[float]) -> list[float]:
    """Returns the log odds [N] that each of N photos moved, as all the others suggest.

    Args:
        log_odds: [N] of each photo by itself.
    """
    share = 0.5
    for _ in range(200):  # expectation maximisation
        each = [_probability(number + _log_odds(share)) for number in log_odds]
        before = share
        share = (math.fsum(each) + PRIOR) / (len(each) + 2 * PRIOR)
        if abs(share - before) < 1e-6:
            break
    each = [_probability(number + _log_odds(share)) for number in log_odds]
    total = math.fsum(each) + PRIOR
    return [min(_log_odds((total - own) / (len(each) - 1 + 2 * PRIOR)), MOST) for own in each]


@dataclass
class Folder:
    """The photos of a run that are judged together."""

    photos: dict[Path, tuple[Job, Judged]] = field(default_factory=dict)
    moved: float = 0.0  # expected number of photos that moved, once :meth:`to_redo` has found it
    redone: int = 0

    def add(self, job: Job, judged: Judged | None) -> None:
        """Adds a photo."""
        if judged is not None:
            self.photos[job.source] = job, judged

    def to_redo(self) -> list[Job]:
        """Returns the jobs of the photos that are decided differently in view of the others."""
        groups = defaultdict(list)
        for source in sorted(self.photos, key=str):
            groups[self.photos[source][1].group].append(self.photos[source])
        again = []
        self.moved = 0.0
        for group in groups.values():
            for (job, judged), log_odds in zip(group, shares_moved([each.log_odds for _, each in group]), strict=True):
                self.moved += _probability(judged.log_odds + log_odds)
                log_odds = min(log_odds, judged.most)
                changes = (log_odds > judged.decision_threshold) != (judged.used > judged.decision_threshold)
                if changes and abs(log_odds - judged.used) > 0.05:
                    again.append(replace(job, folder_log_odds=round(log_odds, 4)))
        self.redone = len(again)
        return again


def _log_odds(share: float) -> float:
    return math.log(share / (1 - share))


def _probability(log_odds: float) -> float:
    return 1 / (1 + math.exp(-log_odds)) if log_odds > 0 else 1 - 1 / (1 + math.exp(log_odds))
