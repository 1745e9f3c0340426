"""Reports a batch to the user: messages, progress, the JSON log, the summary and the exit code."""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.batch.inputs import Inputs
from unshutter.batch.job import Job, Outcome
from unshutter.batch.preview import Preview
from unshutter.errors import UnshutterError, errors_in_one_line
from unshutter.progress import Progress, rate
from unshutter.reasons import Cause, Code, pixels
from unshutter.storage.journal import JsonLog
from unshutter.storage.places import Place
from unshutter.storage.protection import Protection

if TYPE_CHECKING:
    from unshutter.motion.verdict import Verdict  # not imported above: it loads NumPy, and decoding starts first

Tell = Callable[[str], None]  # prints a line for the user

_NO_VISIBLE_MOTION = {Code.NO_MOTION, Code.NO_VISIBLE_MOTION}
_BY_ITSELF = {*_NO_VISIBLE_MOTION, Code.NO_RIGHT_ANGLES, Code.TOO_FEW_SEGMENTS, Code.TOO_FAST_FOR_HANDS}


class Report:
    """Counts and reports the outcomes of a batch.

    Args:
        total: number of photos in all.
        to_do: number of photos with work to do.
        log: JSON log to append to, one event per line.
        inputs: the photos, and the files that were skipped.
        protection: protects the files that the run reads.

    Raises:
        UnshutterError: the log cannot be written, or the existing file is not such a log.
    """

    def __init__(
        self,
        total: int,
        to_do: int,
        log: Path | None = None,
        inputs: Inputs | None = None,
        protection: Protection | None = None,
    ):
        self.total = total
        self.counts = {"done": 0, "skipped": 0, "failed": 0}
        self._changed = 0
        self._left: Counter[Cause] = Counter()  # photos that were left unchanged
        self._start = time.monotonic()
        self._inputs = inputs or Inputs()
        self._log = JsonLog(log, protection or Protection([])) if log is not None else None
        self._bar = Progress(to_do)
        self.preview: Preview | None = None  # set if one is to be written
        self._advised: set[Any] = set()  # folders for which the next step was already suggested

    def __enter__(self) -> Report:
        self._bar.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.__exit__(*error)
        fates = {"changed": self._changed, "left_as_they_are": dict(self._left)}
        summary = {**self.counts, **fates, "photos": self.total, "stopped": error[0] is not None}
        if self._inputs.passed_over:
            summary["not_taken"] = self._inputs.counts()
        self._note("end", **summary, seconds=round(time.monotonic() - self._start, 3))

    def done(self, job: Job, outcome: Outcome) -> None:
        """Reports a photo that was changed or left unchanged."""
        verdict = outcome.verdict
        extras = {name: value for name in ("model", "note") if (value := getattr(outcome, name))}
        self._count(
            "done",
            job.source,
            target=str(job.target) if outcome.is_written else None,
            **(verdict.as_json() if verdict else {}),
            seconds=round(outcome.seconds, 3),
            **extras,
        )
        if self.preview is not None:
            self.preview.add(job, outcome)
        changed = verdict is None or verdict.changes
        if verdict is None or verdict.cause is None:
            self._changed += 1
        else:
            self._left[verdict.cause] += 1
        model = f"model {outcome.model}" if outcome.model and changed else ""
        details = "; ".join(
            filter(None, (verdict and about(verdict), self._next_step(job, verdict), model, outcome.note))
        )
        what = f"{job.source} -> {job.target}" if changed else f"{job.source} left unchanged"
        self.tell(f"{what} ({details})" if details else what)
        self._bar.advance()

    def _next_step(self, job: Job, verdict: Verdict | None) -> str:
        """Suggests how to get an unchanged photo corrected; once per folder."""
        step = next_step(verdict) if verdict is not None else ""
        if not step or job.source.parent in self._advised:
            return ""
        self._advised.add(job.source.parent)
        return step

    def save_preview(self) -> None:
        """Writes the preview, if there is one, and reports it.

        Raises:
            UnshutterError: it cannot be written.
        """
        if self.preview is not None:
            self.tell(self.preview.save())

    def skipped(self, job: Job) -> None:
        """Counts a photo whose result existed when the batch began or was finished by another run."""
        self._count("skipped", job.source, target=str(job.target))
        if self.preview is not None:
            with suppress(UnshutterError):  # then the preview omits this photo
                self.preview.add_finished(job)

    def failed(self, photo: str | Place, error: str, seconds: float = 0.0) -> None:
        """Reports a photo that failed."""
        self._count("failed", photo, error=error, **({"seconds": round(seconds, 3)} if seconds else {}))
        self.tell(f"unshutter: {error}")
        self._bar.advance()

    def tell(self, line: str) -> None:
        """Prints one line for the user."""
        self._bar.tell(line)

    def _count(self, fate: str, photo: str | Place, **facts: Any) -> None:
        self.counts[fate] += 1
        self._note(fate, photo=str(photo), **facts)

    def _note(self, event: str, **facts: Any) -> None:
        if self._log is None:
            return
        log, self._log = self._log, None  # report a log that cannot be written only once
        log.add(event, at=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), **facts)
        self._log = log

    def _fates(self) -> str:
        """Counts changed photos, and unchanged ones by cause: ``3 changed, 2 left unchanged (2 not sure)``."""
        causes = self._left.most_common()
        line = f"{self._changed} changed, {self._left.total()} left unchanged"
        return f"{line} ({', '.join(f'{count} {cause}' for cause, count in causes)})" if causes else line

    def exit_code(self) -> int:
        """Prints the summary; returns the exit code of the command."""
        seconds, done, skipped = time.monotonic() - self._start, self.counts["done"], self.counts["skipped"]
        if self.total > 1:
            speed = f" ({rate(done / seconds)})" if done else ""
            before = f", {skipped} finished already" if skipped else ""
            if self._inputs.passed_over:
                self.tell(f"unshutter: {self._inputs.not_taken()}")
            self.tell(f"unshutter: {done} of {self.total} photos done in {_spoken(seconds)}{speed}{before}")
            if done:
                self.tell(f"unshutter: {self._fates()}")
        return exit_code(self.counts["failed"], self.total)


def _spoken(seconds: float) -> str:
    hours, rest = divmod(round(seconds), 3600)
    return f"{hours} h {rest // 60} min" if hours else f"{rest // 60} min {rest % 60} s" if rest >= 60 else f"{rest} s"


def each_photo(inputs: Inputs, one: Callable[[Place, Tell], None]) -> int:
    """Calls ``one`` for each photo, continuing past failures; returns the exit code."""
    files = list(inputs.photos)
    failed = len(inputs.unreadable)
    with Progress(len(files)) as bar:
        for folder, reason in inputs.unreadable:
            bar.tell(f"unshutter: cannot read folder {folder}: {reason}")
        for photo in files:
            try:
                with errors_in_one_line(photo):
                    one(photo, bar.tell)
            except UnshutterError as error:
                if len(files) == 1:
                    raise
                failed += 1
                bar.tell(f"unshutter: {error}")
            bar.advance()
        if inputs.passed_over:
            bar.tell(f"unshutter: {inputs.not_taken()}")
    return exit_code(failed, len(files) + len(inputs.unreadable))


def exit_code(failed: int, total: int) -> int:
    """Returns 1 if something failed, and prints how many photos did."""
    if failed:
        print(f"unshutter: {failed} of {total} photos failed", file=sys.stderr)
    return 1 if failed else 0


def about(verdict: Verdict) -> str:
    """Describes the verdict, why a film inside the photo was not used, and what the user can do."""
    return "; ".join(filter(None, (verdict.described(), verdict.film_sentence, advice(verdict))))


def advice(verdict: Verdict) -> str:
    """Names the option with which the photo would be changed; empty if there is none."""
    if verdict.reason is None or verdict.confidence is None:
        return ""
    if verdict.reason.code is Code.UNSURE:
        limit = _one_digit(verdict.confidence)
        return f"--min-confidence {limit:g} would move it by up to {pixels(verdict.largest_px)}"
    return "--moving says that it did" if verdict.reason.code is Code.UNSURE_WHETHER_MOVED else ""


def next_step(verdict: Verdict) -> str:
    """Suggests options for a photo that does not show by itself that it moved; empty if there is nothing to suggest."""
    if verdict.reason is None or verdict.reason.code not in _BY_ITSELF:
        return ""
    moved = "if the camera moved: --moving; " if verdict.reason.code in _NO_VISIBLE_MOTION else ""
    return f"{moved}with a neighbour: --after"


def _one_digit(confidence: float) -> float:
    """Rounds down to one significant digit: 0.36 -> 0.3, 0.036 -> 0.03, 0.0036 -> 0."""
    steps = 10 if confidence >= 0.1 else 100
    return math.floor(steps * confidence) / steps
