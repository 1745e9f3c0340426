"""Readout times of cameras by mode: the table for clips that do not contain their own.

The file cameras.csv names the source of its times (lens profiles shared by users of Gyroflow) and their licence (CC0).
Some profiles contradict each other, the lenses of a phone differ, and not every mode is listed: each answer consists of
a range, a typical value and how closely the clip's mode is matched.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import TypeVar

from unshutter.errors import UsageError, shortened, similar
from unshutter.progress import in_columns
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.reasons import JsonObject

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
_SIMILAR_RATE = 1.3  # ratio of frame rates within which readout times are similar
_KINDS = {
    "phones": "apple samsung xiaomi redmi realme poco oneplus huawei honor zte ulefone oppo vivo nothing google",
    "action cameras and drones": (
        "gopro dji insta360 xtu runcam walksnail hawkeye caddx tomate sioeye foxeer akaso sjcam parrot autel skydio"
    ),
    "cameras": "sony canon nikon panasonic fujifilm blackmagic sigma red leica kinefinity olympus om hasselblad z",
}


@dataclass(frozen=True)
class Profile:
    """What a table lists of a camera in one of its modes: one line."""

    brand: str
    model: str
    # one of its lenses or fields of view; empty if the profiles do not name it, or it does not matter
    lens: str
    width: int  # columns of a frame [px]
    height: int  # rows of a frame [px]

    def as_json(self) -> JsonObject:
        """Returns the columns of the table by name; times in ms, sizes in px."""
        return dict(vars(self))

    @property
    def camera(self) -> str:
        """Brand and model; the brand once, even if the model begins with it."""
        begins = self.model.lower().startswith(self.brand.lower())
        return f"{self.brand} {self.model[len(self.brand) if begins else 0 :].strip()}".strip()

    @property
    def name(self) -> str:
        """Name of the camera, with its lens, unless that is called like the camera."""
        return self.camera if self.lens in ("", self.brand, self.model) else f"{self.camera} {self.lens.strip()}"


@dataclass(frozen=True)
class CameraMode(Profile):
    """The readout time of a camera in one of its modes."""

    fps: float  # frames per second
    readout_ms: float  # readout time of a frame [ms], the median of the profiles
    least_ms: float  # shortest of the profiles [ms]
    most_ms: float  # longest of the profiles [ms]
    profiles: int = 1  # number of profiles
    note: str = ""  # further conditions of the time

    @property
    def mode(self) -> str:
        """Description of the mode."""
        return f"{self.width}x{self.height} px at {self.fps:g} frames/s"

    @property
    def time(self) -> str:
        """Description of the readout time; a range if the profiles disagree."""
        one = _agree(self.least_ms, self.most_ms)
        return f"{self.readout_ms:.1f} ms" if one else f"{self.least_ms:.1f} to {self.most_ms:.1f} ms"

    def has_size(self, size: tuple[int, int]) -> bool:
        """Whether its frames have this (width, height), in either orientation."""
        return set(size) == {self.width, self.height}

    def has_rate(self, rate: float) -> bool:
        """Whether it records this many frames per second."""
        return abs(rate / self.fps - 1) <= 0.012  # 29.97 and 30 frames per second are one mode


ProfileT = TypeVar("ProfileT", bound=Profile)


@cache
def table() -> tuple[CameraMode, ...]:
    """Returns all known modes, sorted by brand, model, lens and mode."""
    return tuple(
        CameraMode(
            *begin_of(line),
            fps=float(line["fps"]),
            readout_ms=float(line["readout_ms"]),
            least_ms=float(line["least"]),
            most_ms=float(line["most"]),
            profiles=int(line["profiles"]),
            note=line["note"],
        )
        for line in lines_of("cameras.csv")
    )


def begin_of(line: Mapping[str, str]) -> tuple[str, str, str, int, int]:
    """Returns what a line of a table says of a :class:`Profile`: brand, model, lens, width and height."""
    return line["brand"], line["model"], line["lens"], int(line["width"]), int(line["height"])


def lines_of(table: str) -> csv.DictReader[str]:
    """Returns the lines of a table that comes with the package."""
    text = (files("unshutter") / "video" / "calibrate" / table).read_text(encoding="utf-8")
    return csv.DictReader(line for line in text.splitlines() if not line.startswith("#"))


# ---- the readout time of a clip ----------------------------------------------------------------------------


def listed_time(tags: Mapping[str, str], named: str | None, size: tuple[int, int], rate: float) -> ReadoutTime | None:
    """Looks up the readout time of a clip's camera; returns None if it is not in the table.

    It is known if the profiles of this very mode agree; otherwise it comes with their range.

    Args:
        named: brand, model and lens of the camera, as far as needed, if the user names it.
        size: (width, height) of a frame [px], in either orientation.
        rate: frames per second.
    """
    if named is None:
        return find(*camera_of(tags), size, rate)
    time = find_named(named, size, rate)
    return time if time.plausible_s else replace(time, camera=named)


def usual_time(tags: Mapping[str, str], interval_s: float) -> ReadoutTime:
    """Returns the usual readout time of cameras of a clip's kind, with its range."""
    import numpy as np

    make = camera_of(tags)[0].lower().split()
    kind = next((kind for kind, brands in _KINDS.items() if make and make[0] in brands.split()), "")
    rate = 1 / interval_s
    similar = [mode for mode in table() if 1 / _SIMILAR_RATE < mode.fps / rate < _SIMILAR_RATE]
    brands = _KINDS.get(kind, "").split()
    modes = [mode for mode in similar if not kind or mode.brand.lower().split()[0] in brands] or similar
    times = [mode.readout_ms for mode in modes] or [1000 * interval_s * share for share in (0.2, 0.5, 1.0)]
    low, usual, high = map(float, np.percentile(times, (5, 50, 95)))
    return ReadoutTime.of_ms(usual, ReadoutSource.USUAL, kind or "cameras and phones", (low, high))


def find(make: str, model: str, size: tuple[int, int], rate: float) -> ReadoutTime | None:
    """Looks up a camera by the brand, which may be empty, and the model that its files name."""
    return _range(tagged(table(), make, model), size, rate)


def find_named(name: str, size: tuple[int, int], rate: float) -> ReadoutTime:
    """Looks up the readout time of a camera that the user names by brand, model and lens, as far as needed."""
    known = closest(listed(name), name)
    this = f"{size[0]}x{size[1]} px at {rate:.4g} frames/s"
    matches = [mode for mode in known if mode.has_size(size) and mode.has_rate(rate)]
    if not matches:
        modes = ", ".join(dict.fromkeys(mode.mode for mode in known))
        raise UsageError(
            f"the table has no time for '{shortened(name)}' with {this}, only for {modes}: give {{--readout-ms}}"
        )
    names = {_spelled(mode.name) for mode in matches}
    if len(names) > 1 and not _agree(min(m.least_ms for m in matches), max(m.most_ms for m in matches)):
        several = ", ".join(f"{mode.name} ({mode.time})" for mode in matches)
        raise UsageError(f"'{shortened(name)}' with {this} could be {several}: give the full name")
    time = _range(matches, size, rate)
    assert time is not None
    return time


def camera_of(tags: Mapping[str, str]) -> tuple[str, str]:
    """Returns (make, model) of the camera named in a clip's tags; empty if there are none."""
    values = {key.lower(): value for key, value in tags.items()}  # Matroska writes them in upper case
    make, model = (next((values[key] for key in keys if values.get(key)), "") for keys in (_MAKES, _MODELS))
    code = values.get("firmware", "")[:6]
    return ("GoPro", _GOPROS[code]) if not model and code in _GOPROS else (make, model)


def _range(modes: list[CameraMode], size: tuple[int, int], rate: float) -> ReadoutTime | None:
    """Returns the readout time by the modes of one camera that match the given one most closely."""
    of_size = [mode for mode in modes if mode.has_size(size)]
    same = [mode for mode in of_size if mode.has_rate(rate)]
    match = "in this mode" if same else "in this frame size at other rates" if of_size else "in its other modes"
    closest = same or of_size or modes
    if not closest:
        return None
    times = sorted(mode.readout_ms for mode in closest for _ in range(mode.profiles))
    longest = 1000 / rate
    low = min(min(mode.least_ms for mode in closest), longest)
    typical = min(times[len(times) // 2], longest)
    high = min(max(mode.most_ms for mode in closest), longest)
    camera = closest[0].camera
    known = same and _agree(low, high)
    if known:
        return ReadoutTime.of_ms(typical, ReadoutSource.TABLE, camera)
    return ReadoutTime.of_ms(typical, ReadoutSource.TABLE, f"{camera} {match}", (low, high))


# ---- names -------------------------------------------------------------------------------------------------


def listed(word: str | None = None) -> list[CameraMode]:
    """Returns the modes of cameras whose name contains a word, in any case and spelling; all if the word is None."""
    matches = named(table(), word or "")
    if not matches:
        near = _near_names(word or "")
        guess = f"did you mean {' or '.join(near)}?" if near else "`unshutter cameras` lists them"
        raise UsageError(f"the table has no camera called '{shortened(word)}': {guess}")
    return matches


def _near_names(word: str) -> list[str]:
    """Returns the names of cameras that are spelled most like a word, at most a few."""
    longest = max(word.split(), key=len, default="")
    modes = [mode for mode in table() if _is_named(mode.camera, longest)] or table()
    names = {_plain(name): mode.camera for mode in modes for name in (mode.model, mode.camera)}
    return list(dict.fromkeys(names[each] for each in similar(_plain(word), names, 3)))


def describe_cameras(modes: Iterable[CameraMode]) -> str:
    """Formats the cameras, one per line, with the number of their modes and the range of their readout times."""
    by_camera: dict[str, list[CameraMode]] = {}
    for mode in modes:
        by_camera.setdefault(_spelled(mode.camera), []).append(mode)
    rows = []
    for of_one in by_camera.values():
        least = min(mode.least_ms for mode in of_one)
        most = max(mode.most_ms for mode in of_one)
        time = f"{least:.1f} ms" if least == most else f"{least:.1f} to {most:.1f} ms"
        rows.append((of_one[0].camera, f"{len(of_one)} mode{'s' if len(of_one) > 1 else ''}", time))
    return in_columns(rows)


def describe_modes(modes: Iterable[CameraMode]) -> str:
    """Formats the modes, one per line."""
    return in_columns([(mode.name, mode.mode, mode.time, mode.note) for mode in modes], right=2)


def tagged(profiles: Iterable[ProfileT], make: str, model: str) -> list[ProfileT]:
    """Returns the profiles of the camera that a file names by make, which may be empty, and model."""
    return [profile for profile in profiles if _is_of(profile, make, model)]


def named(profiles: Iterable[ProfileT], word: str) -> list[ProfileT]:
    """Returns the profiles of cameras whose name, with the lens, contains a word, in any case and spelling."""
    return [profile for profile in profiles if _is_named(profile.name, word)]


def closest(profiles: list[ProfileT], name: str) -> list[ProfileT]:
    """Returns the profiles of the camera that has just this name, without longer names; all if there is none."""
    return [profile for profile in profiles if _spelled(name) in _names(profile)] or profiles


def _is_of(profile: Profile, make: str, model: str) -> bool:
    brand = _plain(profile.brand)
    first = (re.findall(r"[a-z0-9]+", make.lower()) or [""])[0]
    if first and not brand.startswith(first) and not first.startswith(brand):
        return False
    spelled = _spelled(model)
    return bool(spelled) and spelled.removeprefix(brand) == _spelled(profile.model).removeprefix(brand)


def _is_named(name: str, word: str) -> bool:
    spelled = _spelled(word)
    return _plain(word) in _plain(name) or bool(spelled and spelled in _spelled(name))


def _names(profile: Profile) -> set[str]:
    whole = (profile.model, profile.camera, f"{profile.model} {profile.lens}", profile.name)
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
    return most_ms <= 1.1 * least_ms  # 16.7 and 17.7 ms agree
