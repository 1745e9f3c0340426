"""From the fields of a form or query to options: they are named as the flags of the command line, without dashes."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from unshutter.errors import UsageError
from unshutter.options import Find, Neighbours, Rectify, Save, Undo
from unshutter.video.options import RectifyClip

# Files have no times or names of their own here, a sequence is more than a photo, and a clip is a film.
_NOT_HERE: dict[type, tuple[str, ...]] = {
    Save: ("keep_times", "only_changed", "keep_names"),
    Neighbours: ("sequence",),
    RectifyClip: ("fps", "motion", "save_motion", "preview", "plot", "overwrite", "json_log", "max_pixels"),
}
_YES, _NO = ("true", "1", "on", "yes"), ("false", "0", "off", "no", "")


@dataclass(frozen=True)
class Field:
    """A field that may be given.

    Attributes:
        name: as it is given, ``roll-deg``.
        type: of its value, without None.
        default: where it is not given.
        choices: that it has; empty: any value of its type.
        help: what it means.
    """

    name: str
    type: type
    default: Any
    choices: tuple[str, ...]
    help: str


@dataclass(frozen=True)
class Wanted:
    """What is wanted of a photo, as far as the page can ask for it."""

    find: Find = field(default_factory=Find)
    neighbours: Neighbours = field(default_factory=Neighbours)
    undo: Undo = field(default_factory=Undo)
    save: Save = field(default_factory=Save)

    @property
    def rectify(self) -> Rectify:
        """The same as the command line has it."""
        return Rectify(find=self.find, undo=self.undo, save=self.save, neighbours=self.neighbours)


def read(given: Mapping[str, str], photo: Callable[[str], Path]) -> Wanted:
    """The options in a form or query.

    Args:
        given: field -> text.
        photo: where the open photo of an id lies; fields that name a file on the command line name one here.

    Raises:
        UsageError: a field that is not known, or a value that it does not take.
    """
    _check_known(given, Wanted)
    wanted = _made(Wanted, given, photo)
    if "@" in wanted.find.estimator:
        raise UsageError("weights of your own are for the command line: name a method alone")
    return wanted


def read_clip(given: Mapping[str, str]) -> RectifyClip:
    """The options of a clip in a form or query.

    Args:
        given: field -> text.

    Raises:
        UsageError: a field that is not known, or a value that it does not take.
    """
    _check_known(given, RectifyClip)
    return _made(RectifyClip, given, Path)


def _check_known(given: Mapping[str, str], kind: type) -> None:
    known = {field.name for field in fields(kind)}
    for name in given:
        if name not in known:
            raise UsageError(f"unknown field '{name:.40}': choose one of {', '.join(sorted(known))}")


def fields(kind: type = Wanted) -> Iterator[Field]:
    """All fields that may be given, groups taken apart."""
    for each, type_ in _parts(kind):
        if dataclasses.is_dataclass(type_):
            yield from fields(typing.cast(type, type_))
        else:
            yield _field(each, type_)


def _field(each: dataclasses.Field, type_: Any) -> Field:
    inner = _without_none(type_)
    choices = tuple(map(str, each.metadata.get("choices", ())))
    if get_origin(inner) is typing.Literal:
        inner, choices = str, get_args(inner)
    return Field(each.name.replace("_", "-"), inner, each.default, choices, each.metadata["help"])


def _made(kind: type, given: Mapping[str, str], photo: Callable[[str], Path]) -> Any:
    values = {}
    for each, type_ in _parts(kind):
        name = each.name.replace("_", "-")
        if dataclasses.is_dataclass(type_):
            values[each.name] = _made(typing.cast(type, type_), given, photo)
        elif given.get(name, "") != "":
            of = _field(each, type_)
            values[each.name] = photo(given[name]) if of.type is Path else _value(of, given[name])
    return kind(**values)


def _value(field: Field, text: str) -> Any:
    if field.type is bool:
        if text.lower() not in (*_YES, *_NO):
            raise UsageError(f"field '{field.name}' takes true or false, got '{text:.40}'")
        return text.lower() in _YES
    if field.choices and text not in field.choices:
        raise UsageError(f"field '{field.name}' takes one of {', '.join(field.choices)}, got '{text:.40}'")
    try:
        return field.type(text)
    except ValueError:
        raise UsageError(f"field '{field.name}' takes a number, got '{text:.40}'") from None


def _parts(kind: type) -> Iterator[tuple[dataclasses.Field, Any]]:
    """Fields of a dataclass with their types; those without a help cannot be given."""
    hints = get_type_hints(kind)
    for each in dataclasses.fields(kind):
        is_group = dataclasses.is_dataclass(hints[each.name])
        if is_group or ("help" in each.metadata and each.name not in _NOT_HERE.get(kind, ())):
            yield each, hints[each.name]


def _without_none(type_: Any) -> Any:
    """T of ``T | None``."""
    if isinstance(type_, types.UnionType) or get_origin(type_) is typing.Union:
        (type_,) = (one for one in get_args(type_) if one is not type(None))
    return type_
