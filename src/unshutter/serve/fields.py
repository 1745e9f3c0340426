"""From the fields of a form or query to options: they are named as the flags of the command line, without dashes."""

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
CANDIDATES = "candidates"  # field of a form that asks for all motions that fit; no option of a picture
_YES, _NO = ("true", "1", "on", "yes"), ("false", "0", "off", "no", "")


@dataclass(frozen=True)
class ByHand:
    """What a person draws and sets instead of trusting the estimate; the page and its API alone offer it.

    Raises:
        UsageError: a number out of range.
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
        UsageError: lines or numbers by hand for a photo with neighbours.
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
        """The options as the command line has them."""
        return Rectify.of(find=self.find, undo=self.undo, save=self.save, neighbours=self.neighbours)


def read(form: Mapping[str, str], photo: Callable[[str], Path]) -> PhotoOptions:
    """The options in a form or query.

    Args:
        form: field -> text.
        photo: where the open photo of an id lies; fields that name a file on the command line name one here.

    Raises:
        UsageError: a field that is not known, or a value that it does not take.
    """
    _check_known(form, PhotoOptions)
    options = with_values(PhotoOptions, _values(form, photo))
    if "@" in options.find.estimator:
        raise UsageError("weights of your own are for the command line: name a method alone")
    return options


def read_clip(form: Mapping[str, str]) -> RectifyClip:
    """The options of a clip in a form or query.

    Args:
        form: field -> text.

    Raises:
        UsageError: a field that is not known, or a value that it does not take.
    """
    _check_known(form, RectifyClip)
    return with_values(RectifyClip, _values(form, Path))


def fields(kind: type = PhotoOptions) -> Iterator[Option]:
    """All options that a form may give, those of groups among them."""
    return (option for option in options_of(kind) if option.on_page)


def truth(name: str, text: str) -> bool:
    """The truth value that a field says.

    Raises:
        UsageError: it says none.
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
    """Gives the value of each option in a form."""

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
