"""Readout times of cameras, mode by mode: the table for clips that do not tell it themselves.

Source: cameras.json, which names the profile of Gyroflow's collection (CC0) that each time was read from.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from unshutter.errors import UsageError

_SAME_RATE, _SAME_TIME = 0.01, 0.1  # shares: 29.97 and 30 frames a second are one mode; 16.7 and 17.7 ms agree
# Where QuickTime and Android files keep the names, as FFmpeg calls these tags.
_MAKES = ("make", "com.apple.quicktime.make", "com.android.manufacturer")
_MODELS = ("model", "com.apple.quicktime.model", "com.android.model")


@dataclass(frozen=True)
class CameraMode:
    """A camera in one of its modes.

    Attributes:
        brand, model: of the camera.
        lens: one of its lenses or fields of view; empty where it does not matter, or the lens can be changed.
        width, height: of a frame [px].
        fps: frames per second.
        readout_ms: time in which a frame is read out [ms].
        note: what else the time holds for.
        profile: the file of Gyroflow's collection that says so.
    """

    brand: str
    model: str
    lens: str
    width: int
    height: int
    fps: float
    readout_ms: float
    note: str
    profile: str

    @property
    def name(self) -> str:
        """Of the camera, with its lens."""
        return " ".join(filter(None, (self.brand, self.model, self.lens)))

    @property
    def mode(self) -> str:
        """The mode in words."""
        return f"{self.width}x{self.height} px at {self.fps:g} frames/s"

    def fits(self, width: int, height: int, fps: float) -> bool:
        """Whether frames of this size and rate are taken in this mode, upright or not."""
        return {width, height} == {self.width, self.height} and abs(fps / self.fps - 1) <= _SAME_RATE


@cache
def table() -> tuple[CameraMode, ...]:
    """All that is known, by brand, model, lens and mode."""
    text = (files("unshutter") / "video" / "cameras.json").read_text(encoding="utf-8")
    return tuple(CameraMode(**mode) for mode in json.loads(text)["modes"])


def listed(word: str | None = None) -> list[CameraMode]:
    """The modes of the cameras whose name has a word in it, whatever its case and spaces; None: all.

    Raises:
        UsageError: there is none.
    """
    matches = [mode for mode in table() if _plain(word or "") in _plain(mode.name)]
    if not matches:
        raise UsageError(f"no camera of the table is called '{word}': `unshutter cameras` lists them")
    return matches


def as_text(modes: Iterable[CameraMode]) -> str:
    """A line for each mode."""
    rows = [(mode.name, mode.mode, f"{mode.readout_ms:.1f} ms", mode.note) for mode in modes]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        f"{name.ljust(widths[0])}  {mode.ljust(widths[1])}  {time.rjust(widths[2])}  {note}".rstrip()
        for name, mode, time, note in rows
    )


def readout_ms(name: str, width: int, height: int, fps: float) -> float:
    """The readout time of a camera that the user names [ms].

    Args:
        name: brand, model and lens, as far as they are needed to tell it from others.
        width, height: of the clip's frames [px].
        fps: frames per second.

    Raises:
        UsageError: the table does not have the camera or the mode, or has several times for it.
    """
    known = listed(name)
    exact = [mode for mode in known if _plain(name) in _names(mode)]
    known = exact or known
    matches = [mode for mode in known if mode.fits(width, height, fps)]
    this = f"{width}x{height} px at {fps:.4g} frames/s"
    if not matches:
        modes = ", ".join(dict.fromkeys(mode.mode for mode in known))
        raise UsageError(f"the table has no time for '{name}' with {this}, only for {modes}: say it with --readout-ms")
    if not _agree(matches):
        several = ", ".join(f"{mode.name} ({mode.readout_ms:.1f} ms)" for mode in matches)
        raise UsageError(f"'{name}' with {this} could be {several}: say which")
    return _mean(matches)


def of_tags(tags: Mapping[str, str], width: int, height: int, fps: float) -> tuple[str, float] | None:
    """The camera that a clip's tags name, and its readout time in this mode [ms].

    None where the tags name none, or the table does not know it in this mode. A camera whose times depend on the lens
    is not known: tags do not say which one it was.
    """
    said = {key.lower(): value for key, value in tags.items()}  # Matroska's are in upper case
    make, model = (next((said[key] for key in keys if said.get(key)), "") for keys in (_MAKES, _MODELS))
    names = {_plain(model), _plain(make + model)} - {""}
    matches = [mode for mode in table() if not mode.lens and mode.fits(width, height, fps) and names & _names(mode)]
    if not model or not matches or not _agree(matches):
        return None
    return matches[0].name, _mean(matches)


def _names(mode: CameraMode) -> set[str]:
    """What a camera may be called."""
    whole = (mode.model, f"{mode.brand}{mode.model}", f"{mode.model}{mode.lens}", mode.name)
    return {_plain(name) for name in whole}


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _agree(modes: list[CameraMode]) -> bool:
    times = [mode.readout_ms for mode in modes]
    return max(times) <= (1 + _SAME_TIME) * min(times)


def _mean(modes: list[CameraMode]) -> float:
    return sum(mode.readout_ms for mode in modes) / len(modes)
