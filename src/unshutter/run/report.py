"""Reports a batch to the user: messages, progress, the JSON log, the summary, the exit code and the preview."""

from __future__ import annotations

import shlex
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, errors_in_one_line
from unshutter.options import LEAST_GOOD_CROP
from unshutter.progress import Progress, rate, tell
from unshutter.reasons import Cause, Code, percent, pixels
from unshutter.run.ahead import Begun, PreviewError
from unshutter.run.inputs import MADE_BY_US, Inputs
from unshutter.run.job import Job, Outcome
from unshutter.storage.files import JsonLog

if TYPE_CHECKING:
    from unshutter.motion.verdict import Verdict
    from unshutter.run.folder import Folder
    from unshutter.run.plan import Plan
    from unshutter.run.preview import Preview


Tell = Callable[[str], None]  # prints a line for the user

_MAY_HAVE_MOVED = {Code.NO_MOTION, Code.NO_VISIBLE_MOTION, Code.UNSURE_WHETHER_MOVED}
_UNSURE_WHICH = {Code.UNSURE, Code.HARDLY_HELPS, Code.UNSURE_HOW_MOVED}
_REPORTED = {Code.UNSURE_HOW_MOVED, Code.MOVED_TOO_LITTLE, Code.MOVED_OTHERWISE}
_BY_ITSELF = {*_MAY_HAVE_MOVED, *_REPORTED, Code.NO_RIGHT_ANGLES, Code.TOO_FEW_SEGMENTS, Code.TOO_FAST_FOR_HANDS}


class Report:
    """Counts and reports the outcomes of a batch; entering it raises UnshutterError if the log cannot be written."""

    def __init__(self, plan: Plan):
        self._plan = plan
        self._inputs = plan.inputs
        run = plan.run
        self._preview: Preview | None = None
        if run.preview is not None:
            from unshutter.run.preview import Preview

            self._preview = Preview(run.preview, run.overwrite, plan.inputs.photos)
        self.total = sum(map(len, (plan.to_do, plan.finished, plan.refused, self._inputs.unreadable)))
        self.counts = {"done": 0, "skipped": 0, "failed": 0}
        self._causes: dict[Path, Cause | None] = {}  # of each photo done: why it is unchanged; None: it is changed
        self._start = time.monotonic()
        self._next_steps: dict[Path, tuple[str, ...]] = {}  # what the user can do about each photo that is unchanged
        self._to_level: dict[Path, bool] = {}  # photos to level -> whether their results would have to be replaced
        self._log: JsonLog | None = None

    def __enter__(self) -> Report:
        log = self._plan.run.json_log
        self._log = JsonLog(log) if log is not None else None
        self._bar = Progress(len(self._plan.to_do))
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.__exit__(*error)
        left = Counter(filter(None, self._causes.values()))
        fates = {"changed": len(self._causes) - left.total(), "left_as_they_are": dict(left)}
        summary = {**self.counts, **fates, "photos": self.total, "stopped": error[0] is not None}
        if self._inputs.passed_over:
            summary["not_taken"] = self._inputs.counts()
        self._note("end", **summary, seconds=round(time.monotonic() - self._start, 3))

    def begin(self, line: str) -> None:
        """Prints a line, unless it is empty, and reports what is not in the plan to do."""
        if line:
            self.tell(line)
        for folder, reason in self._inputs.unreadable:
            self.failed(folder, f"cannot read folder {folder}: {reason}")
        for job in self._plan.finished:  # when the batch began, or by another run
            self._count("skipped", job.source, target=str(job.picture))
            if self._preview is not None:
                self._preview.add_finished(job, self._plan.run.max_pixels, self._plan.preview_px or 0)
        for job, reason in self._plan.refused:
            self.failed(job.source, reason)

    def done(self, job: Job, outcome: Outcome) -> None:
        """Reports a photo that was changed or left unchanged."""
        verdict = outcome.verdict
        extras = {name: value for name in ("model", "note", "left_out", "edges") if (value := getattr(outcome, name))}
        extras |= {} if outcome.ratio is None else {"readout_ratio": outcome.ratio.value}
        extras |= {} if outcome.area_left is None else {"area_left": round(outcome.area_left, 4)}
        again = job.folder_log_odds is not None  # in view of the other photos of its folder
        if again:
            self.counts["done" if job.source in self._causes else "skipped"] -= 1
            extras["again"] = True
            self._to_level.pop(job.source, None)
        self._count(
            "done",
            job.source,
            target=None if outcome.picture is None else str(outcome.picture),
            **({**verdict.as_json(), "please_look": outcome.please_look} if verdict else {}),
            seconds=round(outcome.seconds, 3),
            **(job.burst.as_json() if job.burst else {}),
            **extras,
        )
        if self._preview is not None:
            self._preview.add(job, outcome)
        changed = verdict is None or verdict.changes
        self._causes[job.source] = None if verdict is None else verdict.cause
        told_moving = self._plan.request.find.camera.moving is not None
        steps = () if verdict is None or changed else _next_steps(verdict, told_moving)
        self._next_steps[job.source] = tuple(steps)
        details = verdict.described() if verdict else ""
        if reported := self.total == 1 or self._plan.run.verbose:
            model = f"model {outcome.model}" if outcome.model and changed else ""
            ratio = f"readout ratio {outcome.ratio}" if outcome.ratio and changed else ""
            details = "; ".join(filter(None, (verdict and about(verdict), model, ratio)))
        more = (_about_edges(outcome), outcome.note if reported else "")
        details = "; ".join(filter(None, (details, *more)))
        if job.burst is not None:
            details = "; ".join(filter(None, (details, job.burst.described())))
        what = f"{job.source} -> {job.picture}" if changed else f"{job.source} left unchanged"
        what += " after all" if again else ""
        line = f"{what} ({details})" if details else what
        if verdict is not None and verdict.lean is not None and self._plan.levelling:
            self._to_level[job.source] = outcome.picture == job.picture and self._plan.home is None
            line += f": {self._levelling()}" if self.total == 1 else ""
        self.tell(line)
        self._bar.advance(0 if again else 1)

    def tell_of_folder(self, folder: Folder) -> None:
        """Reports what judging the photos of a folder together changed, if anything."""
        if folder.redone:
            photos = "1 photo was" if folder.redone == 1 else f"{folder.redone} photos were"
            self.tell(
                f"unshutter: judging by all {len(folder.photos)} photos, about {folder.moved:.0f} moved: "
                f"{photos} decided again (--each-alone judges each by itself)"
            )

    def _levelling(self) -> str:
        """The command that levels the photos, too."""
        overwrite = ["--overwrite"] if any(self._to_level.values()) and not self._plan.run.overwrite else []
        line = shlex.join(["unshutter", "rectify", *self._plan.levelling, *overwrite])
        return line if len(line) <= 400 else "the same command with --upright level"

    def save_preview(self) -> None:
        """Writes the preview, if there is one, and reports it."""
        if self._preview is not None:
            self.tell(self._preview.save())

    def not_taken(self, job: Job) -> None:
        """Counts a file that turned out not to be a photo."""
        self._inputs.pass_over(MADE_BY_US, job.source.suffix)
        self.total -= 1
        self._bar.advance()

    def failed(self, photo: str | Path, error: str, seconds: float = 0.0) -> None:
        """Reports a photo that failed."""
        self._count("failed", photo, error=error, **({"seconds": round(seconds, 3)} if seconds else {}))
        self.tell(f"unshutter: {error}")
        self._bar.advance()

    def tell(self, line: str) -> None:
        """Prints one line for the user."""
        self._bar.tell(line)

    def _count(self, fate: str, photo: str | Path, **facts: object) -> None:
        self.counts[fate] += 1
        self._note(fate, photo=str(photo), **facts)

    def _note(self, event: str, **facts: object) -> None:
        if self._log is None:
            return
        log = self._log
        self._log = None  # report a log that cannot be written only once
        log.add(event, at=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), **facts)
        self._log = log

    def exit_code(self) -> int:
        """Prints the summary; returns the exit code of the command."""
        seconds = time.monotonic() - self._start
        done = self.counts["done"]
        skipped = self.counts["skipped"]
        if self.total > 1:
            speed = f" ({rate(done / seconds)})" if done else ""
            before = f", {skipped} finished already" if skipped else ""
            if self._inputs.passed_over:
                self.tell(f"unshutter: {self._inputs.not_taken()}")
            self.tell(f"unshutter: {done} of {self.total} photos done in {_spoken(seconds)}{speed}{before}")
            left = Counter(filter(None, self._causes.values()))
            changed = len(self._causes) - left.total()
            if done:
                causes = ", ".join(f"{count} {cause}" for cause, count in left.most_common())
                line = f"{changed} changed, {left.total()} left unchanged"
                self.tell(f"unshutter: {line} ({causes})" if causes else f"unshutter: {line}")
            if changed and left and self._plan.makes_a_set:
                mixed = f"only {changed} of {done} changed; a mixed set confuses the calibration"
                self.tell(f"unshutter: {mixed}: use the originals, or leave out the others with --only-changed")
            if count := len(self._to_level):
                are = "1 is" if count == 1 else f"{count} are"
                self.tell(f"unshutter: {are} off level by 1 degree or more: {self._levelling()}")
        if steps := dict.fromkeys(chain.from_iterable(self._next_steps.values())):
            self.tell(f"unshutter: what to try for photos left unchanged: {'; '.join(steps)}")
        return exit_code(self.counts["failed"], self.total)


def _next_steps(verdict: Verdict, told_moving: bool) -> Iterator[str]:
    """Suggests options for a photo that was left unchanged because it does not show clearly how it moved."""
    code = verdict.reason.code if verdict.reason is not None else None
    if code in _MAY_HAVE_MOVED and not told_moving:
        yield "if the camera moved: --moving"
    if code in _BY_ITSELF:
        yield "with a frame taken just before or after: --before or --after"
    if code is Code.WHICH_WAY:
        yield "if you know which way the camera moved: --moving left, right, up or down"
    if code in _UNSURE_WHICH:
        yield "what else fits: unshutter estimate --candidates PHOTO"
    if code in _REPORTED:
        yield "draw lines along what is straight: unshutter serve"


def _about_edges(outcome: Outcome) -> str:
    """Describes how areas that the photo did not see were handled; empty if that is what the user asked for."""
    share = outcome.area_left
    words = ["borrowed from neighbours"] if outcome.edges == "borrow" else []
    if outcome.edges == "fill":
        words.append("corners filled")
    elif outcome.edges == "keep" and share is not None:
        words.append(f"not cropped, please look: {percent(share)} would be left; --edges fill mirrors it in the rest")
    elif share is not None and share < LEAST_GOOD_CROP:
        words.append(f"cropped to {percent(share)}, please look: --edges keep or fill would keep its size")
    elif share is not None and share < 1:
        words.append(f"cropped to {percent(share)}")
    return ", ".join(words)


def _spoken(seconds: float) -> str:
    hours, rest = divmod(round(seconds), 3600)
    return f"{hours} h {rest // 60} min" if hours else f"{rest // 60} min {rest % 60} s" if rest >= 60 else f"{rest} s"


def each_photo(inputs: Inputs, begun: Iterable[Begun], one: Callable[[Begun, Tell], None]) -> int:
    """Calls ``one`` for each photo, continuing past failures; returns the exit code."""
    files = list(inputs.photos)
    failed = len(inputs.unreadable)
    with Progress(len(files)) as bar:
        for folder, reason in inputs.unreadable:
            bar.tell(f"unshutter: cannot read folder {folder}: {reason}")
        for photo, each in zip(files, begun, strict=True):
            try:
                with errors_in_one_line(photo):
                    one(each, bar.tell)
            except UnshutterError as error:
                if len(files) == 1:
                    raise
                if isinstance(error, PreviewError):
                    inputs.pass_over(MADE_BY_US, photo.suffix)
                    continue
                failed += 1
                bar.tell(f"unshutter: {error}")
            bar.advance()
        if inputs.passed_over:
            bar.tell(f"unshutter: {inputs.not_taken()}")
    return exit_code(failed, len(files) + len(inputs.unreadable))


def exit_code(failed: int, total: int) -> int:
    """Returns 1 if something failed, and prints how many photos did."""
    if failed:
        tell(f"unshutter: {failed} of {total} photos failed")
    return 1 if failed else 0


def about(verdict: Verdict) -> str:
    """Describes the verdict, why a video inside the photo was not used, and what the user can do."""
    unused = verdict.finding.video_unused
    why_unused = "" if unused is None else f"{unused}: not used"
    return "; ".join(filter(None, (verdict.described(), why_unused, _advice(verdict))))


def _advice(verdict: Verdict) -> str:
    """Names the option with which the photo would be changed; empty if there is none."""
    if verdict.lean is not None:
        return f"off level by {verdict.lean.deg:.1f} degrees, give or take {verdict.lean.error_deg:.1f}"
    if verdict.reason is None or verdict.confidence is None:
        return ""
    enough = verdict.least_confidence
    if enough is not None:
        within = verdict.reason.code in (Code.HARDLY_HELPS, Code.MOVED_TOO_LITTLE)  # its error: no size to speak of
        how = "undo it all the same" if within else f"move it by up to {pixels(verdict.reason.px)}"
        return f"--min-confidence {enough:g} would {how}"
    if verdict.reason.code is Code.WHICH_WAY:
        return "--moving left, right, up or down says which"
    return "--moving says that it did" if verdict.reason.code is Code.UNSURE_WHETHER_MOVED else ""
