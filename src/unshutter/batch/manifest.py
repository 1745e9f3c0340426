"""The manifest in an output folder: which results are finished, from what, and how; so that a run can go on.

It is a journal, one JSON record a line, only ever added to. Before work on a result begins, a record says so; when
the result lies there under its name, a second one says what it is. Whatever happens in between, the next run finds
a result that was begun and not finished, and does it again. A record that was cut short counts for nothing.

How it is stored, for files and for objects behind a URL, :mod:`unshutter.storage.journal` says.
"""

from __future__ import annotations

import json
import os
import time
from typing import Any, Literal

from unshutter.batch.work import Job, Outcome
from unshutter.storage.journal import open_journal
from unshutter.storage.places import Place, absolute, fingerprint, way
from unshutter.version import __version__

NAME = "unshutter-manifest"
Verdict = Literal["finished", "ours", "another's", "unknown"]


class Manifest:
    """What is known about the results in a folder; nothing is written before the first record.

    Args:
        folder: that results go to.
        options: digest of the options that make a result what it is.

    Raises:
        UnshutterError: there is a manifest that cannot be read.
    """

    def __init__(self, folder: Place, options: str):
        self.run = os.urandom(6).hex()
        self._folder = folder
        self._options = options
        self._entries: dict[str, dict[str, Any]] = {}
        self._news: set[str] = set()  # results that other runs have had to do with since this one started
        self._journal = open_journal(folder, NAME, self.run)
        self.refresh()
        self._news.clear()

    # ---- what is known ---------------------------------------------------------------------------------

    def verdict(self, job: Job) -> Verdict:
        """What there is where a job's results go.

        Returns:
            finished: they are there, from this very photo with these very options, as they were left. ours: what is
            there was begun or made by a run from this photo, and may be replaced. another's: it was made from
            another photo. unknown: if there is something, unshutter did not leave it so.
        """
        entry = self._entries.get(self._key(job.target))
        if entry is None:
            return "unknown"
        source_is = fingerprint(job.source)
        if entry.get("source") != str(absolute(job.source)) and entry.get("source_is") != source_is:
            return "another's"
        targets = {self._key(target): target for target in (job.target, job.motion_target) if target is not None}
        left = entry.get("outputs", {})
        intact = all(left.get(key) == fingerprint(target) for key, target in targets.items())
        if entry["state"] == "done" and intact:
            same = (entry.get("source_is"), entry.get("options")) == (source_is, self._options)
            return "finished" if same and source_is is not None else "ours"
        untouched = all(fingerprint(target) in (None, left.get(key)) for key, target in targets.items())
        return "ours" if entry["state"] == "begun" or untouched else "unknown"

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
        outputs = {self._key(job.target): outcome.target_is}
        if job.motion_target is not None:
            outputs[self._key(job.motion_target)] = outcome.motion_is
        made = {"source_is": outcome.source_is, "options": self._options, "outputs": outputs}
        about = {"seconds": round(outcome.seconds, 3), "unshutter": __version__}
        self._add({**self._record(job, "done"), **made, **about})

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
        """A result's name: its way from the folder, so that the folder may be moved."""
        inside = way(self._folder, target)
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
