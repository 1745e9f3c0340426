"""Settings of ``unshutter serve``, and the form fields for options of photos and clips.

Fields of a query are named after command-line flags, without dashes in front.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TypeVar

from unshutter.errors import UnshutterError, UsageError, as_flag, shortened, visible
from unshutter.frames.pyav import VIDEO_FORMATS
from unshutter.options import MAX_PIXELS, Find, Neighbours, Rectify, Save, Undo, check_count, option
from unshutter.options.clip_options import RectifyClip
from unshutter.options.fields import Group, Option, check_values, describe, options_of, with_values
from unshutter.options.picture_formats import TABLE
from unshutter.reasons import JsonObject
from unshutter.single.register import names
from unshutter.video.calibrate.cameras import table

T = TypeVar("T")

_PORT = 8720
LOCAL_HOSTS = ("127.0.0.1", "localhost", "::1")
_TOKEN = re.compile(r"[A-Za-z0-9_-]{8,200}")
_MOST_MB = 100_000
_PHOTO_MB, _CLIP_MB = 400, 4000  # one minute of 4K video from a phone takes about 400 MB
_YES = ("true", "1", "on", "yes")
_NO = ("false", "0", "off", "no", "")
_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string", Path: "string"}


@dataclass(frozen=True)
class Settings:
    """How the page is served."""

    port: int = option(_PORT, f"Port to listen on; 0 picks a free one. Default: {_PORT}.")
    open: bool = option(False, "Open the page in the browser.")
    until_closed: bool = option(
        False, "End the page soon after its last tab was closed. There is one such page at a time: unshutter open."
    )
    max_mb: int | None = option(
        None, f"Refuse photos and clips above this size, in megabytes. Default: {_PHOTO_MB}; clips {_CLIP_MB}."
    )
    max_pixels: int = option(MAX_PIXELS, "Refuse photos with more pixels. Default: 1 000 000 000.")
    token: str | None = option(
        None,
        "Access token in the link of the page, at least 8 letters and digits. Default: a new one every time.",
        names="word",
    )
    host: str = option("127.0.0.1", "Address to listen on. Default: 127.0.0.1, this machine only.", names="word")
    i_know: bool = option(
        False, "With {--host}: I know that everyone who reaches this address and sees the link can use the page."
    )

    def __post_init__(self) -> None:
        if self.until_closed and self.host != "127.0.0.1":
            raise UsageError("{--until-closed} is for pages on this machine: leave out {--host}")
        if not 0 <= self.port <= 65_535:
            raise UsageError(f"{{--port}} must lie between 0 and 65535, got {self.port}")
        if self.max_mb is not None and not 1 <= self.max_mb <= _MOST_MB:
            raise UsageError(f"{{--max-mb}} must lie between 1 and {_MOST_MB}, got {self.max_mb}")
        check_count("max-pixels", self.max_pixels)
        if self.token is not None and not _TOKEN.fullmatch(self.token):
            raise UsageError("{--token} needs at least 8 characters, of letters, digits, - and _ only")
        if self.host not in LOCAL_HOSTS and not self.i_know:
            raise UsageError(
                f"{{--host}} {self.host} lets other machines use the page, and the photos travel there unencrypted: "
                "add {--i-know} if that is what you want"
            )

    @property
    def max_bytes(self) -> int:
        """Largest photo [bytes]."""
        return (self.max_mb or _PHOTO_MB) * 1_000_000

    @property
    def max_clip_bytes(self) -> int:
        """Largest clip [bytes]."""
        return (self.max_mb or _CLIP_MB) * 1_000_000


@dataclass(frozen=True)
class ByHand:
    """What a person draws and sets instead of trusting the estimate; only the page offers it."""

    lines: str = option(
        "",
        "Lines drawn along things, as JSON: [[kind, x, y, x, y, ...], ...]. The kind is upright, level or straight; "
        "positions are shares of the upright photo's width and height.",
        names="word",
    )
    lean_deg: float | None = option(
        None, "How far sideways motion slants upright things, in degrees. Default: as estimated.", limits=(-30, 30)
    )
    bend_percent: float | None = option(
        None, "How far it bends them, in percent of the lines that were read. Default: as estimated.", limits=(-20, 20)
    )
    turn_deg: float | None = option(
        None, "How far the camera turned during readout, in degrees. Default: as estimated.", limits=(-20, 20)
    )

    def __post_init__(self) -> None:
        check_values(self)

    def __bool__(self) -> bool:
        return self != ByHand()


@dataclass(frozen=True)
class PhotoOptions:
    """The options of a photo that the page offers."""

    find: Find = field(default_factory=Find)
    neighbours: Neighbours = field(default_factory=Neighbours)
    undo: Undo = field(default_factory=Undo)
    save: Save = field(default_factory=Save)
    hand: ByHand = field(default_factory=ByHand)

    def __post_init__(self) -> None:
        if self.hand and self.neighbours:
            raise UsageError("lines and numbers by hand cannot be combined with neighbours: leave out one of them")

    @property
    def rectify(self) -> Rectify:
        """The equivalent options of the command line."""
        return Rectify(find=self.find, undo=self.undo, save=self.save, neighbours=self.neighbours).settled()


def read(form: Mapping[str, str], photo: Callable[[str], Path]) -> PhotoOptions:
    """Parses the options of a photo; ``photo`` returns the path of an open photo, which names a neighbour."""
    options = _parsed(PhotoOptions, form, photo)
    if "@" in options.find.estimator:
        raise UsageError("your own weights work only on the command line: give the name of a method")
    return options


def read_clip(form: Mapping[str, str]) -> RectifyClip:
    """Parses the options of a clip."""
    return _parsed(RectifyClip, form, Path)


def fields(kind: type = PhotoOptions) -> Iterator[Option]:
    """Returns all options that a form can set, including those in groups."""
    return (option for option in options_of(kind) if option.on_page)


def refusal(error: UnshutterError) -> JsonObject:
    """Describes an error in a line that names options as forms do.

    If there are any, ``said`` is the line taken apart, text and options in turn: the page shows their labels.
    """
    error.spell = _as_field
    pieces = [visible(piece) for piece in error.pieces]
    return {"error": str(error), **({"said": pieces} if len(pieces) > 1 else {})}


def _as_field(option: str) -> str:
    known = any(option == each.name for kind in (PhotoOptions, RectifyClip) for each in fields(kind))
    return option if known else as_flag(option)


def _parsed(kind: type[T], form: Mapping[str, str], photo: Callable[[str], Path]) -> T:
    known = {option.name for option in fields(kind)}
    for name in form:
        if name not in known:
            raise UsageError(f"unknown field '{shortened(name)}': choose one of {', '.join(sorted(known))}")

    def value(option: Option) -> object:
        text = form.get(option.name, "")
        if text == "" or not option.on_page:
            return option.default
        return photo(text) if option.type is Path else _value(option, text)

    return with_values(kind, value)


def _value(option: Option, text: str) -> object:
    if option.type is bool:
        if text.lower() not in (*_YES, *_NO):
            raise UsageError(f"field '{option.name}' takes true or false, got '{shortened(text)}'")
        return text.lower() in _YES
    if option.choices and text not in option.choices:
        raise UsageError(f"field '{option.name}' takes one of {', '.join(option.choices)}, got '{shortened(text)}'")
    try:
        return option.type(text)
    except ValueError:
        raise UsageError(f"field '{option.name}' takes a number, got '{shortened(text)}'") from None


@cache
def page_module() -> str:
    """Generates a JavaScript module with ``photo`` and ``clip``: name -> schema with the group and known values;
    and ``videos``, the endings of videos' names.
    """
    choices = {"estimator": {"enum": names()}, "format": {"titles": {row.name: row.title for row in TABLE}}}
    known = {"camera": sorted({mode.name for mode in table()})}
    lines = ["// Made by the program from its one description of options (page/settings.py).\n"]
    for word, kind in (("photo", PhotoOptions), ("clip", RectifyClip)):
        described = {
            option.name: _schema(option)
            | {"group": group, "examples": known.get(option.name, [])}
            | choices.get(option.name, {})
            for option, group in _with_groups(kind)
        }
        lines.append(f"export const {word} = {json.dumps(described)};\n")
    lines.append(f"export const videos = {json.dumps(list(VIDEO_FORMATS))};\n")
    return "".join(lines)


def _with_groups(kind: type, group: str = "") -> Iterator[tuple[Option, str]]:
    """Yields the options that a form can set, each with the name of its options dataclass in lower case."""
    for each in describe(kind):
        if isinstance(each, Group):
            yield from _with_groups(each.kind, each.kind.__name__.lower())
        elif each.on_page:
            yield each, group


def _schema(option: Option) -> JsonObject:
    schema: JsonObject = {"type": _TYPES[option.type], "description": option.help}
    if option.choices:
        schema["enum"] = list(option.choices)
    if option.default is not None:
        schema["default"] = option.default
    if "bare" in option.more:
        schema["bare"] = option.more["bare"]
    if option.limits is not None:
        schema["minimum"], schema["maximum"] = option.limits
    return schema
