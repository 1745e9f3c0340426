"""Parses form and query fields into options. Fields are named after command-line flags, without dashes in front."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from unshutter.errors import UsageError
from unshutter.options import Find, Neighbours, Rectify, Save, Undo, option
from unshutter.options.description import Option, options_of, with_values
from unshutter.video.options import RectifyClip

MOST_LEAN_DEG, MOST_BEND_PERCENT, MOST_TURN_DEG = 30, 20, 20
CANDIDATES = "candidates"  # form field that requests all motions that fit; not an option of the photo
_YES, _NO = ("true", "1", "on", "yes"), ("false", "0", "off", "no", "")


@dataclass(frozen=True)
class ByHand:
    """What a person draws and sets instead of trusting the estimate; the page and its API alone offer it.

    Raises:
        UsageError: a number is out of range.
    """

    lines: str = option(
        "",
        "Lines drawn along things, as JSON: [[kind, x, y, x, y, ...], ...]. The kind is upright, level or straight; "
        "positions are shares of the upright photo's width and height.",
        names="word",
    )
    lean_deg: float | None = option(
        None,
        "How far sideways motion slants upright things, in degrees. Default: as estimated.",
        limits=(-MOST_LEAN_DEG, MOST_LEAN_DEG),
    )
    bend_percent: float | None = option(
        None,
        "How far it bends them, in percent of the lines that were read. Default: as estimated.",
        limits=(-MOST_BEND_PERCENT, MOST_BEND_PERCENT),
    )
    turn_deg: float | None = option(
        None,
        "How far the camera turned during readout, in degrees. Default: as estimated.",
        limits=(-MOST_TURN_DEG, MOST_TURN_DEG),
    )

    def __post_init__(self) -> None:
        for name, value, most in (
            ("lean", self.lean_deg, MOST_LEAN_DEG),
            ("bend", self.bend_percent, MOST_BEND_PERCENT),
            ("turn", self.turn_deg, MOST_TURN_DEG),
        ):
            if value is not None and not abs(value) <= most:
                raise UsageError(f"the {name} must lie between -{most} and {most}, got {value:g}")

    def __bool__(self) -> bool:
        return self != ByHand()


@dataclass(frozen=True)
class PhotoOptions:
    """The options of a photo that the page and its API offer.

    Raises:
        UsageError: lines or numbers were set by hand for a photo with neighbours.
    """

    find: Find = field(default_factory=Find)
    neighbours: Neighbours = field(default_factory=Neighbours)
    undo: Undo = field(default_factory=Undo)
    save: Save = field(default_factory=Save)
    hand: ByHand = field(default_factory=ByHand)

    def __post_init__(self) -> None:
        if self.hand and self.neighbours:
            raise UsageError("lines and numbers by hand are for a photo without neighbours: leave one or the other out")

    @property
    def rectify(self) -> Rectify:
        """The equivalent options of the command line."""
        return Rectify.of(find=self.find, undo=self.undo, save=self.save, neighbours=self.neighbours)


def read(form: Mapping[str, str], photo: Callable[[str], Path]) -> PhotoOptions:
    """Parses the options of a photo from a form or query.

    Args:
        form: field -> text.
        photo: returns the path of the open photo with an id; fields for file options contain such ids.

    Raises:
        UsageError: a field is unknown or its value is invalid.
    """
    _check_known(form, PhotoOptions)
    options = with_values(PhotoOptions, _values(form, photo))
    if "@" in options.find.estimator:
        raise UsageError("weights of your own are for the command line: name a method alone")
    return options


def read_clip(form: Mapping[str, str]) -> RectifyClip:
    """Parses the options of a clip from a form or query.

    Args:
        form: field -> text.

    Raises:
        UsageError: a field is unknown or its value is invalid.
    """
    _check_known(form, RectifyClip)
    return with_values(RectifyClip, _values(form, Path))


def fields(kind: type = PhotoOptions) -> Iterator[Option]:
    """Returns all options that a form can set, including those in groups."""
    return (option for option in options_of(kind) if option.on_page)


def truth(name: str, text: str) -> bool:
    """Parses a Boolean field.

    Raises:
        UsageError: the text is not a Boolean value.
    """
    if text.lower() not in (*_YES, *_NO):
        raise UsageError(f"field '{name}' takes true or false, got '{text:.40}'")
    return text.lower() in _YES


def _check_known(form: Mapping[str, str], kind: type) -> None:
    known = {option.name for option in fields(kind)}
    for name in form:
        if name not in known:
            raise UsageError(f"unknown field '{name:.40}': choose one of {', '.join(sorted(known))}")


def _values(form: Mapping[str, str], photo: Callable[[str], Path]) -> Callable[[Option], Any]:
    """Returns a function that looks up the value of an option in a form."""

    def value(option: Option) -> Any:
        text = form.get(option.name, "")
        if text == "" or not option.on_page:
            return option.default
        return photo(text) if option.type is Path else _value(option, text)

    return value


def _value(option: Option, text: str) -> Any:
    if option.type is bool:
        return truth(option.name, text)
    if option.choices and text not in option.choices:
        raise UsageError(f"field '{option.name}' takes one of {', '.join(option.choices)}, got '{text:.40}'")
    try:
        return option.type(text)
    except ValueError:
        raise UsageError(f"field '{option.name}' takes a number, got '{text:.40}'") from None
