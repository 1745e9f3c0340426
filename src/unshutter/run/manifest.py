"""The manifest in an output folder: records which results are finished, so that an interrupted run can resume.

It is a journal of one JSON record per line, to which one run at a time adds. Before work on a result begins, a record
announces it; when the result exists under its final name, a second record describes it. If the run stops in between,
the next run finds a result that was begun but not finished, and repeats it. Truncated records are ignored.

Whether a result is finished is judged by its size and time, which are quick to look up. It is replaced only if it still
has the digest recorded for it.
"""

from __future__ import annotations

import json
import os
import time
from dataclasses import MISSING, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

from unshutter.errors import UnshutterError
from unshutter.options import Rectify
from unshutter.reasons import JsonObject
from unshutter.run.folder import Judged
from unshutter.run.job import Job, Outcome
from unshutter.single.register import weights_file
from unshutter.storage.files import digest, fingerprint
from unshutter.storage.journals import journal_in
from unshutter.storage.locations import full_name, way
from unshutter.version import __version__

NAME = "unshutter-manifest"
State = Literal["finished", "another's", "open"]


# options of a result that the first digests contained, or whose defaults may still change
_ALWAYS_COUNTED = {"estimator", "focal_px", "quality", "readout", "reference", "roll_deg", "strength", "edges"}
_ALWAYS_COUNTED |= {"tilt_deg", "min_confidence"}


def _digest_of(request: Rectify, motion: str | None) -> str:
    """Returns a digest of all options that affect results. Newer options are included only if not at their defaults."""
    weights = weights_file(request.find.estimator)
    facts = {"motion": motion, "weights": "" if weights is None else fingerprint(weights), "overwrite": None}
    find = request.find
    neighbours = request.neighbours
    for group in (find, find.camera, find.decision, request.undo, request.save, neighbours, neighbours.clock):
        for each in fields(group):
            value = vars(group)[each.name]
            if each.name in _ALWAYS_COUNTED or (each.default is not MISSING and value != each.default):
                facts[each.name] = value
    for name in ("format", "keep_names"):  # already part of the result's name
        facts.pop(name, None)
    from hashlib import sha256  # imported here: see storage/files.py

    return sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:16]


def _size(recorded: object) -> str | None:
    """Returns the part of a recorded fingerprint that is a file's size."""
    return recorded.partition(":")[0] if isinstance(recorded, str) else None


class Manifest:
    """The known state of the results in a folder; nothing is written before the first record, or if it is read-only.

    Results are recorded relative to the folder, which can then be moved with them, or by their whole paths. Raises
    UnshutterError if the existing manifest cannot be read, or another run is writing to it.
    """

    def __init__(
        self,
        folder: Path,
        request: Rectify,
        motion: str | None = None,
        whole_paths: bool = False,
        read_only: bool = False,
    ):
        self.run = os.urandom(6).hex()
        self._folder = folder
        self._request = request
        self._motion = motion
        self._whole_paths = whole_paths
        self._entries: dict[str, JsonObject] = {}
        self._journal = journal_in(folder, NAME, self.run, read_only)
        try:
            self._read()
        except UnshutterError:
            self._journal.close()
            raise
        self._known = frozenset(self._entries)  # when it was opened

    @cached_property
    def _options(self) -> str:
        return _digest_of(self._request, self._motion)

    def compared(self, job: Job) -> tuple[State, Job]:
        """Classifies the existing results of a job, and adds what the manifest knows about them to it.

        A manifest, which anybody may have written, is not sufficient reason to replace a file: the file must have the
        recorded digest, which is computed when the job runs.

        Returns:
            finished: they are there, unmodified, from this photo with these options. another's: they come from
            another photo. open: there is work to do.
        """
        entry = self._entries.get(self._key(job.picture))
        if entry is None:
            return "open", job
        keys = [self._key(target) for target in job.outputs]
        now = [fingerprint(target) for target in job.outputs]
        recorded = entry.get("outputs", {})
        digests = entry.get("digests")
        left: dict[Path, str | None] = {
            target: digests.get(key)
            for target, key, found in zip(job.outputs, keys, now, strict=True)
            if isinstance(digests, dict) and found and _size(found) == _size(recorded.get(key))
        }
        targets = tuple(replace(target, left=left.get(target.path)) for target in job.targets)
        known = replace(job, targets=targets, may_repeat=entry["state"] == "begun")
        source_is = fingerprint(job.source)
        if entry.get("source") != full_name(job.source) and entry.get("source_is") != source_is:
            return "another's", known
        same = (entry.get("source_is"), entry.get("options")) == (source_is, self._options) and source_is is not None
        # a result is unmodified by its size and time, or, if it was copied, by its digest
        is_whole = all(
            recorded.get(key) == found
            or (key in recorded and recorded[key] is None)  # it was not written, so this is somebody else's
            or (left.get(target) is not None and digest(target) == left[target])
            for target, key, found in zip(job.outputs, keys, now, strict=True)
        )
        return "finished" if entry["state"] == "done" and same and is_whole else "open", known

    def has_begun(self, job: Job) -> bool:
        """Whether another run has begun work on a result since this manifest was opened."""
        key = self._key(job.picture)
        if key not in self._known and key not in self._entries:
            self._read()
        return key not in self._known and key in self._entries

    def _read(self) -> None:
        for line in self._journal.read().splitlines():
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

    def begin(self, job: Job) -> None:
        """Records that work on a result begins, before it does."""
        self._journal.add(json.dumps(self._record(job, "begun")))
        self._journal.flush()

    def end(self, job: Job, outcome: Outcome) -> None:
        """Records that a job has ended, successfully or not."""
        if outcome.error is not None:
            self._journal.add(json.dumps({**self._record(job, "failed"), "error": str(outcome.error)}))
            return
        written = {file.path: file for file in outcome.written}
        files = {self._key(place): written.get(place) for place in job.outputs}
        outputs = {key: None if file is None else file.fingerprint for key, file in files.items()}
        digests = {key: None if file is None else file.digest for key, file in files.items()}
        origin = {"source_is": outcome.source_is, "options": self._options, "outputs": outputs, "digests": digests}
        about = {"seconds": round(outcome.seconds, 3), "unshutter": __version__}
        verdict = outcome.verdict.as_json() if outcome.verdict else {}
        judged = Judged.of(job, outcome)
        folder = (judged.as_json() if judged else {}) | (job.burst.as_json() if job.burst else {})
        self._journal.add(json.dumps({**self._record(job, "done"), **origin, **verdict, **folder, **about}))

    def judged(self, job: Job) -> Judged | None:
        """Returns what became of a photo whose result is finished; None if that says nothing about other photos."""
        return Judged.from_json(self._entries.get(self._key(job.picture), {}))

    def _record(self, job: Job, state: str) -> JsonObject:
        at = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        return {
            "target": self._key(job.picture),
            "state": state,
            "source": full_name(job.source),
            "run": self.run,
            "at": at,
        }

    def _key(self, target: Path) -> str:
        inside = None if self._whole_paths else way(self._folder, target)
        return str(inside or full_name(target))

    def close(self) -> None:
        """Writes pending records and lets other runs use the manifest."""
        self._journal.close()
