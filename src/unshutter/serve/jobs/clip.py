"""Jobs on a whole clip: find its readout time, and rectify it as ``unshutter video`` does."""

from __future__ import annotations

import hashlib
import json
import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnknownRatioError
from unshutter.serve.jobs.cache import OpenFile, errors_of, put
from unshutter.video.options import RectifyClip

if TYPE_CHECKING:
    from unshutter.frames.self_calibration import ReadoutRatio
    from unshutter.video.clip import Clip

_REPORTED = ("frames", "rectified", "left", "declined", "left_out", "readout_ms")
_NOTE_S = 0.2  # between two notes of progress


@dataclass
class ProgressFile:
    """The file in which a worker notes its progress, for the server to read.

    Attributes:
        file: its path.
    """

    file: Path
    _noted_s: float = field(default=-math.inf, init=False)

    def read(self) -> dict[str, Any] | None:
        """``what`` is counted, how many are ``done``, of ``total``; None: nothing was begun yet."""
        try:
            return json.loads(self.file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None

    def note(self, what: str, done: int, total: int) -> None:
        """Notes the progress, a few times a second at most."""
        now = time.monotonic()
        if now - self._noted_s < _NOTE_S and done < total:
            return
        self._noted_s = now
        text = json.dumps({"what": what, "done": done, "total": total})
        put(self.file, lambda part: part.write_text(text, encoding="utf-8"))


def readout(open_file: OpenFile, wanted: RectifyClip) -> dict[str, Any]:
    """The readout time of a clip's camera, given or found: ``ratio``, ``ms``, their errors, and where from.

    Raises:
        UnshutterError: the clip cannot be read, or does not tell it.
    """
    with errors_of(open_file):
        return _readout(open_file, wanted)


def rectified(open_file: OpenFile, target: Path, wanted: RectifyClip, progress: ProgressFile) -> dict[str, Any]:
    """Writes a clip as `unshutter video` does; returns what was done.

    Args:
        open_file: the clip.
        target: what is written.
        wanted: what is done.
        progress: where to note progress.

    Raises:
        UsageError, UnshutterError: see :func:`unshutter.video.clip_rectification.rectify_clip`.
    """
    progress.note("frames", 0, 0)
    names = {target: target.name, target.parent: "the folder"}
    with errors_of(open_file, names):
        return _rectified(open_file, target, wanted, progress)


def ratio_of(
    open_file: OpenFile, clip: Clip, wanted: RectifyClip, progress: ProgressFile | None = None
) -> ReadoutRatio:
    """The readout ratio of a clip, given or found; what was found is kept beside the clip.

    Raises:
        UnshutterError: the clip does not tell it.
    """
    from unshutter.frames.self_calibration import ReadoutRatio
    from unshutter.geometry.readout import Readout
    from unshutter.reasons import Reason
    from unshutter.video.readout_search import readout_ratio_of_clip

    given = wanted.shutter.ratio(clip.interval_s)
    if given is not None:
        return ReadoutRatio(given, 0.0, "given")
    part = wanted.span(clip.duration_s)
    file = open_file.path.with_name(f"readout-{digest(wanted.shutter, part)}.json")
    if not file.exists():
        try:
            readout = Readout.parse(wanted.shutter.readout)
            ratio = readout_ratio_of_clip(clip, readout, wanted.shutter, part, progress.note if progress else None)
            record = {"value": ratio.value, "error": ratio.error, "source": ratio.source, "camera": ratio.camera}
        except UnknownRatioError as error:
            record = {"declined": error.reason.as_json()}
        put(file, lambda new: new.write_text(json.dumps(record), encoding="utf-8"))
    record = json.loads(file.read_text(encoding="utf-8"))
    if "declined" in record:
        reason = Reason.from_json(record["declined"])
        raise UnknownRatioError(str(reason), reason)
    return ReadoutRatio(**record)


def digest(*values: object) -> str:
    """A name for what was found with these options."""
    return hashlib.sha256(repr(values).encode()).hexdigest()[:16]


def _readout(open_file: OpenFile, wanted: RectifyClip) -> dict[str, Any]:
    from unshutter.video.clip import Clip

    clip = Clip.look(open_file.path)
    found, interval_ms = ratio_of(open_file, clip, wanted), 1000 * clip.interval_s
    return {
        "ratio": found.value,
        "ratio_sd": found.error,
        "ms": found.value * interval_ms,
        "ms_sd": found.error * interval_ms,
        "found_by": found.source,
    }


def _rectified(open_file: OpenFile, target: Path, wanted: RectifyClip, progress: ProgressFile) -> dict[str, Any]:
    from unshutter.video.clip import Clip
    from unshutter.video.clip_rectification import rectify_clip

    ratio = ratio_of(open_file, Clip.look(open_file.path), wanted, progress)
    outcome = rectify_clip(str(open_file.path), str(target), wanted, ratio, progress.note)
    return {name: value for name, value in outcome.as_json().items() if name in _REPORTED}
