"""The manifest in an output folder: which results are finished, from what, and how; so that a run can go on.

It is a journal, one JSON record a line, only ever added to. Before work on a result begins, a record announces it; when
the result exists under its name, a second one describes it. Whatever happens in between, the next run finds
a result that was begun and not finished, and does it again. A record that was cut short counts for nothing.

A result counts as finished by its size and time, which are quick to look up. It is only replaced if it still has the
digest with which it was left.

How it is stored, for files and for objects behind a URL, :mod:`unshutter.storage.journal` says.
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
    """What is known about the results in a folder; nothing is written before the first record.

    Args:
        folder: that it lies in, mostly that of the results.
        options: digest of the options that make a result what it is.
        whole_paths: whether results are recorded by whole paths; by default as seen from the folder, which may then be
            moved with its results.

    Raises:
        UnshutterError: there is a manifest that cannot be read.
    """

    def __init__(self, folder: Place, options: str, whole_paths: bool = False):
        self.run = os.urandom(6).hex()
        self._folder = folder
        self._options = options
        self._whole_paths = whole_paths
        self._entries: dict[str, dict[str, Any]] = {}
        self._news: set[str] = set()  # results that other runs have had to do with since this one started
        self._journal = open_journal(folder, NAME, self.run)
        self.refresh()
        self._news.clear()

    # ---- what is known ---------------------------------------------------------------------------------

    def verdict(self, job: Job) -> Verdict:
        """What there is where a job's results go.

        Returns:
            finished: they are there, from this very photo with these very options, as they were left. another's: they
            were made from another photo. open: there is work to do.
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
        """A job with what is known of results that are there already.

        The word of a manifest, which anybody may have written, is not enough to replace a file: it must be the one
        that was left there, by its digest, which is computed when the job is done.
        """
        entry = self._entries.get(self._key(job.target))
        if entry is None:
            return job
        left = tuple(self._left(entry, target) for target in job.targets)
        return replace(job, left=left, may_repeat=entry["state"] == "begun")

    def _is_as_left(self, entry: dict[str, Any], target: Place) -> bool:
        """Whether a file is the one that was left: by size and time, else (it was copied) by its digest."""
        left = self._left(entry, target)
        recorded = entry.get("outputs", {}).get(self._key(target))
        return recorded == fingerprint(target) or (left is not None and digest(target) == left)

    def _left(self, entry: dict[str, Any], target: Place | None) -> str | None:
        """The digest with which a result was left, if what is there may have it: it has the size."""
        if target is None:
            return None
        key, now = self._key(target), fingerprint(target)
        recorded, digests = entry.get("outputs", {}).get(key), entry.get("digests")
        if now is None or not isinstance(recorded, str) or not isinstance(digests, dict):
            return None
        return digests.get(key) if recorded.partition(":")[0] == now.partition(":")[0] else None

    def begun_by_another(self, job: Job) -> bool:
        """Whether another run has begun this result, and not finished; it may be dead."""
        entry = self._entries.get(self._key(job.target), {})
        return entry.get("state") == "begun" and entry.get("run") != self.run

    def is_contested(self, job: Job) -> bool:
        """Whether another run, too, has begun this result since this one started."""
        return self._key(job.target) in self._news

    def finished_by_another(self, job: Job) -> bool:
        """Whether another run has finished this result since this one started."""
        return self.is_contested(job) and self.verdict(job) == "finished"

    def refresh(self) -> None:
        """Takes in what other runs have added. Not seen: runs that write to objects.

        Raises:
            UnshutterError: the manifest cannot be read.
        """
        for line in self._journal.news().splitlines():
            try:
                record = json.loads(line)
            except (ValueError, RecursionError):  # cut short by the end of its run, or damaged
                continue
            if not (isinstance(record, dict) and isinstance(record.get("target"), str)):
                continue
            target = record["target"]
            if isinstance(record.get("outputs", {}), dict):
                # what a result was when it was last finished stays known while it is done again
                self._entries[target] = {"state": "", **self._entries.get(target, {}), **record}
                if record.get("run") != self.run:
                    self._news.add(target)

    # ---- what is added ---------------------------------------------------------------------------------

    def begin(self, job: Job) -> None:
        """Work on a result begins.

        Raises:
            UnshutterError: the manifest cannot be written.
        """
        self._add(self._record(job, "begun"))

    def end(self, job: Job, outcome: Outcome) -> None:
        """It ended, one way or the other.

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
        """A result's name in the records."""
        inside = None if self._whole_paths else way(self._folder, target)
        return str(inside or absolute(target).as_posix())

    def _add(self, record: dict[str, Any]) -> None:
        self._journal.add(json.dumps(record))
        self.refresh()

    def flush(self) -> None:
        """Writes what is not yet written; to be called between :meth:`begin` and the work.

        Raises:
            UnshutterError: the manifest cannot be written.
        """
        self._journal.flush()

    def close(self) -> None:
        """Ends what this run has to say.

        Raises:
            UnshutterError: the manifest cannot be written.
        """
        self._journal.close()
