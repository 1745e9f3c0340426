"""Jobs on a whole clip: find its readout time, and rectify it as ``unshutter video`` does."""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import time
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnknownRatioError, UnshutterError
from unshutter.serve.jobs.cache import Held, in_one_line, put
from unshutter.video.options import RectifyClip

if TYPE_CHECKING:
    from unshutter.frames.ratio import ReadoutRatio
    from unshutter.video.clip import Clip

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


def readout(held: Held, wanted: RectifyClip) -> dict[str, Any]:
    """The readout time of a clip's camera, given or found: ``ratio``, ``ms``, their errors, and where from.

    Raises:
        UnshutterError: the clip cannot be read, or does not tell it.
    """
    return in_one_line(held, lambda: _readout(held, wanted))


def rectified(held: Held, target: Path, wanted: RectifyClip, progress: ProgressFile) -> dict[str, Any]:
    """Writes a clip as `unshutter video` does; returns what was done.

    Args:
        held: the clip.
        target: what is written.
        wanted: what is done.
        progress: where to note progress.

    Raises:
        UsageError, UnshutterError: see :func:`unshutter.video.rectifying.rectify_clip`.
    """
    progress.note("frames", 0, 0)
    try:
        with redirect_stderr(io.StringIO()):  # what is told there, the page says itself
            return in_one_line(held, lambda: _rectified(held, target, wanted, progress))
    except UnshutterError as error:
        raise type(error)(str(error).replace(f"{target.parent}{os.sep}", "")) from None


def ratio_of(held: Held, clip: Clip, wanted: RectifyClip, progress: ProgressFile | None = None) -> ReadoutRatio:
    """The readout ratio of a clip, given or found; what was found is kept beside the clip.

    Raises:
        UnshutterError: the clip does not tell it.
    """
    from unshutter.frames.ratio import ReadoutRatio
    from unshutter.geometry.readout import Readout
    from unshutter.reasons import Reason
    from unshutter.video.readout_search import found_or_listed

    given = wanted.shutter.ratio(clip.interval_s)
    if given is not None:
        return ReadoutRatio(given, 0.0, "given")
    part = wanted.span(clip.duration_s)
    file = held.path.with_name(f"readout-{digest(wanted.shutter, part)}.json")
    if not file.exists():
        try:
            with redirect_stderr(io.StringIO()):  # the page says itself what was found
                how = (Readout.parse(wanted.shutter.readout), wanted.shutter, part)
                found = found_or_listed(clip, *how, progress.note if progress else None)
            told = {"value": found.value, "error": found.error, "source": found.source}
        except UnknownRatioError as error:
            told = {"why": error.reason.as_json()}
        put(file, lambda new: new.write_text(json.dumps(told), encoding="utf-8"))
    told = json.loads(file.read_text(encoding="utf-8"))
    if "why" in told:
        reason = Reason.from_json(told["why"])
        raise UnknownRatioError(str(reason), reason)
    return ReadoutRatio(**told)


def digest(*values: object) -> str:
    """A name for what was found with these options."""
    return hashlib.sha256(repr(values).encode()).hexdigest()[:16]


def _readout(held: Held, wanted: RectifyClip) -> dict[str, Any]:
    from unshutter.video.clip import Clip

    clip = Clip.look(held.path)
    found, interval_ms = ratio_of(held, clip, wanted), 1000 * clip.interval_s
    return {
        "ratio": found.value,
        "ratio_sd": found.error,
        "ms": found.value * interval_ms,
        "ms_sd": found.error * interval_ms,
        "found_by": found.source,
    }


def _rectified(held: Held, target: Path, wanted: RectifyClip, progress: ProgressFile) -> dict[str, Any]:
    from unshutter.video.clip import Clip
    from unshutter.video.rectifying import rectify_clip

    clip = Clip.look(held.path)
    found = ratio_of(held, clip, wanted, progress)
    given = wanted.shutter.ratio(clip.interval_s) is not None
    done = rectify_clip(str(held.path), str(target), wanted, None if given else found, progress.note)
    return {
        "frames": done.frames,
        "rectified": done.rectified,
        "left": dict(done.reasons),
        "left_out": done.left_out,
        "readout_ms": 1000 * clip.interval_s * found.value,
    }
