"""The manifest in an output folder: which results are finished, from what, and how; so that a run can go on.

It is a journal, one JSON record a line, only ever added to. Before work on a result begins, a record says so; when
the result lies there under its name, a second one says what it is. Whatever happens in between, the next run finds
a result that was begun and not finished, and does it again. A record that was cut short counts for nothing.

In a folder it is one file, ``unshutter-manifest.jsonl``, that several runs may add to at once. Objects cannot be
added to: behind a URL each run writes pieces, ``unshutter-manifest/RUN-NUMBER.jsonl``, and in the end one of them.
"""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any, Literal

from unshutter.batch.work import Job, Outcome
from unshutter.errors import UnshutterError
from unshutter.storage.places import Place, Remote, absolute, fingerprint, make_folder, remove
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
        self._read_to = 0  # bytes of the journal
        self._news: set[str] = set()  # results that other runs have had to do with since this one started
        self._lines: list[str] = []  # of this run, for objects
        self._pieces: list[int] = [0]  # how many of the lines were written with each
        if isinstance(folder, Remote):
            for name in folder.files():
                if name.startswith(f"{NAME}/") and name.endswith(".jsonl"):
                    self._take((folder / name).read())
        else:
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
        if isinstance(self._folder, Remote):
            return
        path = self._folder / f"{NAME}.jsonl"
        try:
            with path.open("rb") as stream:
                stream.seek(self._read_to)
                added = stream.read()
        except FileNotFoundError:
            return
        except OSError as error:
            raise UnshutterError(f"cannot read {path}: {error.strerror}") from None
        whole = added[: added.rfind(b"\n") + 1]
        self._read_to += len(whole)
        self._take(whole)

    def _take(self, journal: bytes) -> None:
        for line in journal.splitlines():
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
        if isinstance(target, Remote):
            return target.url.removeprefix(f"{self._folder}/")
        folder = self._folder if isinstance(self._folder, Path) else Path()
        path, root = os.path.abspath(target), os.path.abspath(folder)
        return Path(path).relative_to(root).as_posix() if path.startswith(root + os.sep) else Path(path).as_posix()

    def _add(self, record: dict[str, Any]) -> None:
        text = json.dumps(record) + "\n"
        if isinstance(self._folder, Remote):
            self._take(text.encode())
            self._lines.append(text)
            return
        path = self._folder / f"{NAME}.jsonl"
        make_folder(self._folder)
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
            try:
                size = os.fstat(descriptor).st_size
                torn = size > 0 and _last_byte(descriptor, size) != b"\n"  # by a run that ended in the middle
                data = (("\n" if torn else "") + text).encode()
                if os.write(descriptor, data) < len(data):
                    raise OSError(28, "No space left on device")
            finally:
                os.close(descriptor)
        except OSError as error:
            raise UnshutterError(f"cannot write {path}: {error.strerror}") from None
        self.refresh()

    def flush(self) -> None:
        """Writes what is not yet written; to be called between :meth:`begin` and the work.

        Raises:
            UnshutterError: the manifest cannot be written.
        """
        if isinstance(self._folder, Remote) and len(self._lines) > self._pieces[-1]:
            self._piece(self._folder, len(self._pieces)).write("".join(self._lines[self._pieces[-1] :]).encode())
            self._pieces.append(len(self._lines))

    def close(self) -> None:
        """Writes what is not yet written, and makes one of the pieces.

        Raises:
            UnshutterError: the manifest cannot be written.
        """
        self.flush()
        if isinstance(self._folder, Remote) and len(self._pieces) > 2:
            self._piece(self._folder, 0).write("".join(self._lines).encode())
            for number in range(1, len(self._pieces)):
                remove(self._piece(self._folder, number))

    def _piece(self, folder: Remote, number: int) -> Remote:
        return folder / NAME / f"{self.run}-{number:06}.jsonl"


def _last_byte(descriptor: int, size: int) -> bytes:
    os.lseek(descriptor, size - 1, os.SEEK_SET)
    return os.read(descriptor, 1)
