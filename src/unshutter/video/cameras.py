"""Readout times of cameras by mode: the table for clips that do not contain their own.

The file cameras.csv names the source of its times (lens profiles shared by users of Gyroflow) and their licence (CC0).
Some profiles contradict each other, the lenses of a phone differ, and not every mode is listed: each answer consists of
a range, a typical value and how closely the clip's mode is matched.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from importlib.resources import files

from unshutter.errors import UsageError

_SAME_RATE, _SAME_TIME = 0.012, 0.1  # shares: 29.97 and 30 frames per second are one mode; 16.7 and 17.7 ms agree
# Tags of QuickTime and Android files that hold the names, as FFmpeg calls them.
_MAKES = ("make", "com.apple.quicktime.make", "com.android.manufacturer")
_MODELS = ("model", "com.apple.quicktime.model", "com.android.model")
# GoPro files name only their firmware, which begins with the camera's code.
_GOPROS = {
    "HD4.01": "HERO4 Silver",
    "HD4.02": "HERO4 Black",
    "HD5.02": "HERO5 Black",
    "HD5.03": "HERO5 Session",
    "HD6.01": "HERO6 Black",
    "HD7.01": "HERO7 Black",
    "HD8.01": "HERO8 Black",
    "HD9.01": "HERO9 Black",
    "H19.03": "Max",
    "H21.01": "HERO10 Black",
    "H22.01": "HERO11 Black",
    "H23.01": "HERO12 Black",
    "H24.01": "HERO13 Black",
}
_ROMAN = {"2": "ii", "3": "iii", "4": "iv", "5": "v"}
# One camera has many names: Alpha 7 IV, a7IV, A7 Mark IV, ILCE-7M4.
_SPELLINGS = (
    (r"[^a-z0-9_+]+", " "),
    (r"\b(?:ilce|alpha) ?(?=[0-9])", "a"),
    (r"\b(?:eos|lumix|dc|dmc|galaxy|cam)\b", ""),
    (r"\b(?:mark|mk) ?", ""),
    (r"(?:_|(?<=[a-z0-9])m)([2-5])\b", lambda match: _ROMAN[match[1]]),
    (r"[^a-z0-9+]", ""),
)


class Match(StrEnum):
    """How closely a table entry matches the mode of a clip."""

    MODE = "this mode"
    OTHER_RATE = "this frame size at another rate"
    OTHER_MODE = "other modes of this camera"


@dataclass(frozen=True)
class CameraMode:
    """A camera in one of its modes: one line of the table.

    Attributes:
        brand, model: brand and model, as spelled in a profile.
        lens: one of its lenses or fields of view; empty if the profiles do not name it, or it does not matter.
        width, height: size of a frame [px].
        fps: frames per second.
        readout_ms: readout time of a frame [ms], the median of the profiles.
        least_ms, most_ms: range of the profiles [ms].
        profiles: number of profiles.
        upward: whether the last stored row is read first, for instance in a phone held upside down.
        note: further conditions of the time.
    """

    brand: str
    model: str
    lens: str
    width: int
    height: int
    fps: float
    readout_ms: float
    least_ms: float
    most_ms: float
    profiles: int = 1
    upward: bool = False
    note: str = ""

    @property
    def name(self) -> str:
        """Name of the camera, with its lens."""
        return " ".join(filter(None, (self.brand, self.model, self.lens)))

    @property
    def mode(self) -> str:
        """Description of the mode."""
        return f"{self.width}x{self.height} px at {self.fps:g} frames/s"

    @property
    def time(self) -> str:
        """Description of the readout time; a range if the profiles disagree."""
        one = _agree(self.least_ms, self.most_ms)
        return f"{self.readout_ms:.1f} ms" if one else f"{self.least_ms:.1f} to {self.most_ms:.1f} ms"

    @property
    def notes(self) -> list[str]:
        """Further remarks about the mode."""
        upward = "read from the bottom up: the camera was upside down" if self.upward else ""
        return [note for note in (self.note, upward) if note]

    def has_size(self, size: tuple[int, int]) -> bool:
        """Whether its frames have this (width, height), in either orientation."""
        return set(size) == {self.width, self.height}

    def has_rate(self, rate: float) -> bool:
        """Whether it records this many frames per second."""
        return abs(rate / self.fps - 1) <= _SAME_RATE


@dataclass(frozen=True)
class ListedReadout:
    """The table's readout time for a clip.

    Attributes:
        low, typical, high: range of the matching times, and the one to use [ms]; none above the frame interval.
        camera: brand and model.
        match: how closely the mode is matched.
        profiles: number of profiles.
    """

    low: float
    typical: float
    high: float
    camera: str
    match: Match
    profiles: int

    @property
    def is_certain(self) -> bool:
        """Whether it is a single value: of this very mode, with profiles that agree."""
        return self.match is Match.MODE and _agree(self.low, self.high)


@cache
def table() -> tuple[CameraMode, ...]:
    """Returns all known modes, sorted by brand, model, lens and mode."""
    text = (files("unshutter") / "video" / "cameras.csv").read_text(encoding="utf-8")
    lines = csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))
    return tuple(
        CameraMode(
            line["brand"],
            line["model"],
            line["lens"],
            int(line["width"]),
            int(line["height"]),
            float(line["fps"]),
            float(line["readout_ms"]),
            float(line["least"]),
            float(line["most"]),
            int(line["profiles"]),
            line["direction"] == "bottom-up",
            line["note"],
        )
        for line in lines
    )


# ---- the readout time of a clip ----------------------------------------------------------------------------


def find(make: str, model: str, size: tuple[int, int], rate: float) -> ListedReadout | None:
    """Looks up the readout time of a camera in a mode; returns None if the camera is not in the table.

    Args:
        make: brand, as spelled in the camera's files; may be empty.
        model: model, with or without the brand.
        size: (width, height) of a frame [px], in either orientation.
        rate: frames per second.
    """
    return _range([mode for mode in table() if _is_of(mode, make, model)], size, rate)


def find_tagged(tags: Mapping[str, str], size: tuple[int, int], rate: float) -> ListedReadout | None:
    """Looks up the readout time of the camera named in a clip's tags, like :func:`find`."""
    return find(*camera_of(tags), size, rate)


def find_named(name: str, size: tuple[int, int], rate: float) -> ListedReadout:
    """Looks up the readout time of a camera that the user names by brand, model and lens, as far as needed.

    Raises:
        UsageError: the camera or this frame size is not in the table, or the name fits several lenses or cameras with
            different times.
    """
    known = listed(name)
    known = [mode for mode in known if _spelled(name) in _names(mode)] or known
    this = f"{size[0]}x{size[1]} px at {rate:.4g} frames/s"
    matches = [mode for mode in known if mode.has_size(size) and mode.has_rate(rate)]
    if not matches:
        modes = ", ".join(dict.fromkeys(mode.mode for mode in known))
        raise UsageError(f"the table has no time for '{name}' with {this}, only for {modes}: say it with --readout-ms")
    names = {_spelled(mode.name) for mode in matches}
    if len(names) > 1 and not _agree(min(m.least_ms for m in matches), max(m.most_ms for m in matches)):
        several = ", ".join(f"{mode.name} ({mode.time})" for mode in matches)
        raise UsageError(f"'{name}' with {this} could be {several}: say which")
    time = _range(matches, size, rate)
    assert time is not None
    return time


def camera_of(tags: Mapping[str, str]) -> tuple[str, str]:
    """Returns (make, model) of the camera named in a clip's tags; empty if there are none."""
    values = {key.lower(): value for key, value in tags.items()}  # Matroska writes them in upper case
    make, model = (next((values[key] for key in keys if values.get(key)), "") for keys in (_MAKES, _MODELS))
    code = values.get("firmware", "")[:6]
    return ("GoPro", _GOPROS[code]) if not model and code in _GOPROS else (make, model)


def _range(modes: list[CameraMode], size: tuple[int, int], rate: float) -> ListedReadout | None:
    """Returns the readout time from the modes of one camera that match the given one most closely."""
    of_size = [mode for mode in modes if mode.has_size(size)]
    same = [mode for mode in of_size if mode.has_rate(rate)]
    match = Match.MODE if same else Match.OTHER_RATE if of_size else Match.OTHER_MODE
    closest = same or of_size or modes
    if not closest:
        return None
    times = sorted(mode.readout_ms for mode in closest for _ in range(mode.profiles))
    values = (min(mode.least_ms for mode in closest), times[len(times) // 2], max(mode.most_ms for mode in closest))
    low, typical, high = (min(value, 1000 / rate) for value in values)
    first = closest[0]
    return ListedReadout(low, typical, high, f"{first.brand} {first.model}", match, len(times))


# ---- names -------------------------------------------------------------------------------------------------


def listed(word: str | None = None) -> list[CameraMode]:
    """Returns the modes of cameras whose name contains a word, in any case and spelling; all if the word is None.

    Raises:
        UsageError: there is no such camera.
    """
    plain, spelled = _plain(word or ""), _spelled(word or "")
    matches = [mode for mode in table() if plain in _plain(mode.name) or (spelled and spelled in _spelled(mode.name))]
    if not matches:
        raise UsageError(f"no camera of the table is called '{word}': `unshutter cameras` lists them")
    return matches


def as_text(modes: Iterable[CameraMode]) -> str:
    """Formats the modes, one per line."""
    rows = [(mode.name, mode.mode, mode.time, ", ".join(mode.notes)) for mode in modes]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        f"{name.ljust(widths[0])}  {mode.ljust(widths[1])}  {time.rjust(widths[2])}  {note}".rstrip()
        for name, mode, time, note in rows
    )


def _is_of(mode: CameraMode, make: str, model: str) -> bool:
    """Whether a mode belongs to the camera named in a file, with any of its lenses."""
    brand = _plain(mode.brand)
    first = (re.findall(r"[a-z0-9]+", make.lower()) or [""])[0]
    if first and not brand.startswith(first) and not first.startswith(brand):
        return False
    spelled = _spelled(model)
    return bool(spelled) and spelled.removeprefix(brand) == _spelled(mode.model).removeprefix(brand)


def _names(mode: CameraMode) -> set[str]:
    """Returns the possible names of a camera."""
    whole = (mode.model, f"{mode.brand} {mode.model}", f"{mode.model} {mode.lens}", mode.name)
    return {_spelled(name) for name in whole}


@cache
def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


@cache
def _spelled(name: str) -> str:
    """Returns a name in the normalised spelling used for searching the table."""
    name = name.lower()
    for pattern, instead in _SPELLINGS:
        name = re.sub(pattern, instead, name)
    return name


def _agree(least_ms: float, most_ms: float) -> bool:
    return most_ms <= (1 + _SAME_TIME) * least_ms
