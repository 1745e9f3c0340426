"""The manifest in an output folder: records which results are finished, so that an interrupted run can resume.

It is an append-only journal with one JSON record per line. Before work on a result begins, a record announces it; when
the result exists under its final name, a second record describes it. If the run stops in between, the next run finds a
result that was begun but not finished, and repeats it. Truncated records are ignored.

Whether a result is finished is judged by its size and time, which are quick to look up. It is replaced only if it still
has the digest recorded for it.

:mod:`unshutter.storage.journal` stores it, in files and in objects behind a URL.
"""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from typing import Any, Literal

from unshutter.batch.job import Job, Outcome
from unshutter.storage.journal import open_journal
from unshutter.storage.places import Place, absolute, digest, fingerprint, way
from unshutter.version import __version__

NAME = "unshutter-manifest"
Verdict = Literal["finished", "another's", "open"]


class Manifest:
    """The known state of the results in a folder; nothing is written before the first record.

    Args:
        folder: folder that contains the manifest, usually that of the results.
        options: digest of the options that affect results.
        whole_paths: whether to record absolute paths of results; by default, they are relative to the folder, which can
            then be moved with its results.

    Raises:
        UnshutterError: the existing manifest cannot be read.
    """

    def __init__(self, folder: Place, options: str, whole_paths: bool = False):
        self.run = os.urandom(6).hex()
        self._folder = folder
        self._options = options
        self._whole_paths = whole_paths
        self._entries: dict[str, dict[str, Any]] = {}
        self._news: set[str] = set()  # results that other runs have started or finished since this one started
        self._journal = open_journal(folder, NAME, self.run)
        self.refresh()
        self._news.clear()

    # ---- reading ---------------------------------------------------------------------------------------

    def verdict(self, job: Job) -> Verdict:
        """Classifies the existing results of a job.

        Returns:
            finished: they are there, unmodified, from this photo with these options. another's: they come from
            another photo. open: there is work to do.
        """
        entry = self._entries.get(self._key(job.target))
        if entry is None:
            return "open"
        source_is = fingerprint(job.source)
        if entry.get("source") != str(absolute(job.source)) and entry.get("source_is") != source_is:
            return "another's"
        same = (entry.get("source_is"), entry.get("options")) == (source_is, self._options) and source_is is not None
        done = entry["state"] == "done" and same
        return "finished" if done and all(self._is_as_left(entry, target) for target in job.outputs) else "open"

    def prepared(self, job: Job) -> Job:
        """Adds what the manifest knows about existing results to a job.

        A manifest, which anybody may have written, is not sufficient reason to replace a file: the file must have the
        recorded digest, which is computed when the job runs.
        """
        entry = self._entries.get(self._key(job.target))
        if entry is None:
            return job
        left = tuple(self._left(entry, target) for target in job.targets)
        return replace(job, left=left, may_repeat=entry["state"] == "begun")

    def _is_as_left(self, entry: dict[str, Any], target: Place) -> bool:
        """Whether a file is unmodified: by size and time, or (if it was copied) by its digest."""
        left = self._left(entry, target)
        recorded = entry.get("outputs", {}).get(self._key(target))
        return recorded == fingerprint(target) or (left is not None and digest(target) == left)

    def _left(self, entry: dict[str, Any], target: Place | None) -> str | None:
        """Returns the digest recorded for a result if the existing file can have it, judging by its size."""
        if target is None:
            return None
        key, now = self._key(target), fingerprint(target)
        recorded, digests = entry.get("outputs", {}).get(key), entry.get("digests")
        if now is None or not isinstance(recorded, str) or not isinstance(digests, dict):
            return None
        return digests.get(key) if recorded.partition(":")[0] == now.partition(":")[0] else None

    def begun_by_another(self, job: Job) -> bool:
        """Whether another run, which may be dead, has begun this result and not finished it."""
        entry = self._entries.get(self._key(job.target), {})
        return entry.get("state") == "begun" and entry.get("run") != self.run

    def is_contested(self, job: Job) -> bool:
        """Whether another run has also begun this result since this one started."""
        return self._key(job.target) in self._news

    def finished_by_another(self, job: Job) -> bool:
        """Whether another run has finished this result since this one started."""
        return self.is_contested(job) and self.verdict(job) == "finished"

    def refresh(self) -> None:
        """Reads what other runs have added; runs that write to objects are not visible.

        Raises:
            UnshutterError: the manifest cannot be read.
        """
        for line in self._journal.news().splitlines():
            try:
                record = json.loads(line)
            except (ValueError, RecursionError):  # truncated when its run ended, or damaged
                continue
            if not (isinstance(record, dict) and isinstance(record.get("target"), str)):
                continue
            target = record["target"]
            if isinstance(record.get("outputs", {}), dict):
                # details of a finished result are kept while it is repeated
                self._entries[target] = {"state": "", **self._entries.get(target, {}), **record}
                if record.get("run") != self.run:
                    self._news.add(target)

    # ---- writing ---------------------------------------------------------------------------------------

    def begin(self, job: Job) -> None:
        """Records that work on a result begins.

        Raises:
            UnshutterError: the manifest cannot be written.
        """
        self._add(self._record(job, "begun"))

    def end(self, job: Job, outcome: Outcome) -> None:
        """Records that a job has ended, successfully or not.

        Raises:
            UnshutterError: the manifest cannot be written.
        """
        if outcome.error:
            self._add({**self._record(job, "failed"), "error": outcome.error})
            return
        keys = [self._key(target) for target in job.outputs]
        outputs = dict(zip(keys, outcome.outputs_are, strict=False))
        digests = dict(zip(keys, outcome.digests, strict=False))
        origin = {"source_is": outcome.source_is, "options": self._options, "outputs": outputs, "digests": digests}
        about = {"seconds": round(outcome.seconds, 3), "unshutter": __version__}
        verdict = outcome.verdict.as_json() if outcome.verdict else {}
        self._add({**self._record(job, "done"), **origin, **verdict, **about})

    def _record(self, job: Job, state: str) -> dict[str, Any]:
        at = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        return {
            "target": self._key(job.target),
            "state": state,
            "source": str(absolute(job.source)),
            "run": self.run,
            "at": at,
        }

    def _key(self, target: Place) -> str:
        """Returns a result's name in the records."""
        inside = None if self._whole_paths else way(self._folder, target)
        return str(inside or absolute(target).as_posix())

    def _add(self, record: dict[str, Any]) -> None:
        self._journal.add(json.dumps(record))
        self.refresh()

    def flush(self) -> None:
        """Writes pending records; call it between :meth:`begin` and the work.

        Raises:
            UnshutterError: the manifest cannot be written.
        """
        self._journal.flush()

    def close(self) -> None:
        """Writes pending records and closes the journal.

        Raises:
            UnshutterError: the manifest cannot be written.
        """
        self._journal.close()
