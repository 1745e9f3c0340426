"""The loop over the photos of a run; what came of each is recorded in the manifest and reported."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, errors_in_one_line
from unshutter.run.ahead import Begun, PreviewError
from unshutter.run.folder import Folder, Judged
from unshutter.run.job import Job, Outcome, Work
from unshutter.run.manifest import Manifest
from unshutter.run.report import Report
from unshutter.run.work import do_job
from unshutter.storage.locations import RunFiles

if TYPE_CHECKING:
    from unshutter.run.workers import Workers


def rectify_all(
    jobs: Sequence[Job], work: Work, record: Record, begun: Iterator[Begun], workers: Workers | None = None
) -> None:
    """Rectifies photos, and then again those that the other photos of their folder decide differently.

    Args:
        begun: the photos, if this process does the work.
        workers: do the work elsewhere; None: this process does it, one photo after another.
    """

    def outcomes(jobs: Sequence[Job], begun: Iterator[Begun]) -> Iterable[tuple[Job, Outcome]]:
        if workers is not None:
            return workers.do(jobs, partial(do_job, work=work), record.start)
        pairs = zip(jobs, begun, strict=False)  # when the last photo is done, no other is begun
        return ((job, do_job(job, work, photo)) for job, photo in pairs if record.start(job))

    try:
        for job, outcome in outcomes(jobs, begun):
            record.end(job, outcome)
        again = record.to_redo()
        for job, outcome in outcomes(again, iter(()) if workers is not None else work.begin(again)):
            record.end(job, outcome)
    except KeyboardInterrupt:
        if workers is not None:
            for job, outcome in workers.stop(record.report.tell):
                record.end(job, outcome)
        raise


@dataclass
class Record:
    """Records what becomes of the photos of a run: in its manifest, with those of their folder, and for the user."""

    report: Report
    files: RunFiles
    overwrite: bool = False  # whether outputs may replace existing files
    manifest: Manifest | None = None
    folder: Folder | None = None  # what the photos say together; None: each is judged by itself

    def start(self, job: Job) -> bool:
        """Whether work on a photo may start, which is recorded or, if it may not, reported."""
        try:
            with errors_in_one_line(job.source):
                job.check_outputs(self.files, self.overwrite)
        except UnshutterError as error:
            self._report_on(job, Outcome(error))
            return False
        if self.manifest is not None:
            self.manifest.begin(job)
        return True

    def end(self, job: Job, outcome: Outcome) -> None:
        """Records what came of a photo."""
        if self.manifest is not None:
            self.manifest.end(job, outcome)
        if self.folder is not None and outcome.error is None:
            digests = {file.path: file.digest for file in outcome.written}
            targets = tuple(replace(target, left=digests.get(target.path)) for target in job.targets)
            self.folder.add(replace(job, targets=targets), Judged.of(job, outcome))
        self._report_on(job, outcome)

    def to_redo(self) -> list[Job]:
        """Returns the jobs of photos that the other photos of their folder decide differently."""
        return [] if self.folder is None else self.folder.to_redo()

    def _report_on(self, job: Job, outcome: Outcome) -> None:
        if outcome.error is None:
            self.report.done(job, outcome)
        elif self.report.total == 1:
            raise outcome.error
        elif isinstance(outcome.error, PreviewError):
            self.report.not_taken(job)
        else:
            self.report.failed(job.source, str(outcome.error), outcome.seconds)
