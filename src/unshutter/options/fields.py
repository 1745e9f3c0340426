"""Describes options in one place, for the command line, forms, the page and Python keywords.

An option is a field of a frozen dataclass, created with :func:`option`, which defines its type, default and help;
:func:`describe` reads them.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import numbers
import os
import reprlib
import textwrap
import types
import typing
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar, cast, get_args, get_origin

from unshutter.errors import UnshutterError, UsageError, as_keyword, shortened, with_options

# What an option's value names: files or folders that are read, a file that is written, the place of results (a folder,
# or one file: only the command knows which files), or none of these.
Names = Literal["input", "output", "results", "word"]

T = TypeVar("T")


def option(default: Any, help: str, **more: Any) -> Any:
    """Defines a field that is an option.

    Args:
        default: value if the option is not used; ``dataclasses.MISSING`` if it must be given.
        help: description of the option, for all interfaces; names other options as ``{--readout-ms}``.
        more: ``names`` (:data:`Names`), required for paths and text: ``RunFiles`` collects inputs and outputs, and a
            test gives every option that names something written the names of all inputs; ``metavar``, ``choices``,
            ``also`` (other words for them), ``limits`` (minimum and maximum of a number) and ``short`` (``-o``);
            ``bare``, the value of the flag alone
            if the command line accepts it without a value; ``page=False`` if the page does not offer it; ``pipe=True``
            if ``-`` stands for standard input or output.
    """
    return field(default=default, metadata={"help": help, **more})


def positional(help: str, names: Names, optional: bool = False, pipe: bool = False) -> Any:
    """Defines a positional argument; an optional list may be empty, and ``-`` may stand for standard input (pipe)."""
    return field(metadata={"help": help, "names": names, "positional": True, "optional": optional, "pipe": pipe})


LONGEST = 1e9  # of a time, in any unit
_LARGEST = 1e15  # of any number


def check_time(option: str, time: float | None, unit: str) -> None:
    """Checks the time that an option takes; None is allowed."""
    if time is not None and not 0 < time <= LONGEST:
        raise UsageError(f"{{--{option}}} must be above 0 and at most {LONGEST:g} {unit}, got {time:g} {unit}")


def check_count(option: str, number: int | None) -> None:
    """Checks the number of things that an option takes; None is allowed."""
    if number is not None and number < 1:
        raise UsageError(f"{{--{option}}} must be at least 1, got {number}")


@dataclass(frozen=True)
class Option:
    """An option as described by its field."""

    key: str  # its name in Python, such as ``roll_deg``
    type: type  # type of its value, or of each value of a list, without None
    default: Any  # value if the option is not used; ``dataclasses.MISSING`` if it is required
    about: str  # description of the option, with the names of other options in braces
    choices: tuple[str, ...] = ()  # allowed values; empty: any value of the type
    several: bool = False  # whether it takes a list of values
    more: typing.Mapping[str, Any] = field(default_factory=dict)  # further metadata of the field, see :func:`option`

    @property
    def name(self) -> str:
        """The name in forms and, after two dashes, on the command line: ``roll-deg``."""
        return self.key.rstrip("_").replace("_", "-")

    @property
    def help(self) -> str:
        """Description of the option, for the command line and forms."""
        return with_options(self.about)

    @property
    def limits(self) -> tuple[float, float] | None:
        """Minimum and maximum of a number, for forms; None if there are no limits that a form could check."""
        return self.more.get("limits")

    @property
    def on_page(self) -> bool:
        """Whether the page and its API offer the option."""
        return self.more.get("page", True)


@dataclass(frozen=True)
class Group:
    """A group of options that belong together, defined by their own dataclass."""

    key: str  # name of the field that holds them
    kind: type  # the dataclass

    @property
    def title(self) -> str:
        """The title of the group: the first line of its dataclass's docstring."""
        return (self.kind.__doc__ or "").partition("\n")[0].rstrip(".")


@functools.cache
def describe(kind: type) -> tuple[Option | Group, ...]:
    """Returns the options and groups of a dataclass in order; fields without help are skipped."""
    hints = typing.get_type_hints(kind)
    described: list[Option | Group] = []
    for each in dataclasses.fields(kind):
        if dataclasses.is_dataclass(hints[each.name]):
            described.append(Group(each.name, hints[each.name]))
        elif "help" in each.metadata:
            described.append(_option(each, hints[each.name]))
    return tuple(described)


def options_of(kind: type) -> Iterator[Option]:
    """Yields the options of a dataclass, including those of its groups."""
    for each in describe(kind):
        if isinstance(each, Group):
            yield from options_of(each.kind)
        else:
            yield each


def check_values(options: Any) -> None:
    """Checks the values of a dataclass's own options against their choices and limits; None is allowed."""
    for each in describe(type(options)):
        value = None if isinstance(each, Group) else getattr(options, each.key)
        if isinstance(each, Group) or value is None:
            continue
        if each.choices and value not in each.choices:
            raise UsageError(f"{{--{each.name}}} must be one of {', '.join(each.choices)}, got {shortened(value)}")
        if each.limits and not each.limits[0] <= value <= each.limits[1]:
            raise UsageError(f"{{--{each.name}}} must lie between {each.limits[0]} and {each.limits[1]}, got {value:g}")


def with_values(kind: type[T], value: Callable[[Option], Any]) -> T:
    """Creates a dataclass of options."""
    return kind(
        **{
            each.key: with_values(each.kind, value) if isinstance(each, Group) else _not_huge(each, value(each))
            for each in describe(kind)
        }
    )


def _not_huge(each: Option, value: T) -> T:
    """Returns the value of an option; a whole number may have more digits than floating point, and text, can hold."""
    if isinstance(value, int) and not -_LARGEST <= value <= _LARGEST:
        if each.limits:
            raise UsageError(f"{{--{each.name}}} must lie between {each.limits[0]:g} and {each.limits[1]:g}")
        raise UsageError(f"{{--{each.name}}} is too {'large' if value > 0 else 'small'}: leave it out for the default")
    return value


def _option(each: dataclasses.Field, inner: Any) -> Option:
    if isinstance(inner, types.UnionType) or get_origin(inner) is typing.Union:
        (inner,) = (one for one in get_args(inner) if one is not type(None))
    several = get_origin(inner) is list
    if several:
        (inner,) = get_args(inner)
    choices = tuple(map(str, each.metadata.get("choices", ())))
    if get_origin(inner) is Literal:
        inner, choices = str, get_args(inner)
    if not choices and inner in (Path, str) and "names" not in each.metadata:
        raise TypeError(f"say what the option '{each.name}' names (options/fields.py)")
    return Option(each.name, inner, each.default, each.metadata["help"], choices, several, each.metadata)


# ---- as keywords of Python functions --------------------------------------------------------------------------------

F = TypeVar("F", bound=Callable[..., Any])

_ALLOWED = {
    bool: ((bool, numbers.Integral), "True or False"),
    int: (numbers.Integral, "a whole number"),
    float: (numbers.Real, "a number"),
    str: (str, "text"),
    Path: ((str, os.PathLike), "a path"),
}


def from_keywords(kind: type[T], keywords: Mapping[str, Any]) -> T:
    """Creates a dataclass of options from a function's keywords; raises UsageError for a value of the wrong type."""
    return with_values(kind, lambda option: _value(option, keywords.get(option.key, option.default)))


def _value(option: Option, value: Any) -> Any:
    if value is None and option.default is None:
        return None
    is_flag = value is True and option.choices and "bare" in option.more
    value = option.more["bare"] if is_flag else value
    types, allowed = _ALLOWED[option.type]
    check_type(option.key, value, types, f"one of {', '.join(option.choices)}" if option.choices else allowed)
    return Path(value) if option.type is Path and value is not None else value


def check_type(key: str, value: Any, types: Any, allowed: str) -> None:
    """Raises UsageError, which names the keyword and what it allows, if its value is of another type."""
    if not isinstance(value, types):
        raise UsageError(f"{key} must be {allowed}, got {_shown(value)}")


def _shown(value: Any) -> str:
    try:
        return reprlib.repr(value)
    except ValueError:  # thousands of digits
        return "a huge number"


def for_python(*kinds: type) -> Callable[[F], F]:
    """Decorates a public function: its docstring gets the help of keywords that are options, its errors name keywords.

    Where names in several dataclasses are equal, the first counts.
    """

    def decorate(function: F) -> F:
        abouts = {each.key: each.about for kind in reversed(kinds) for each in options_of(kind)}
        head, args, tail = (function.__doc__ or "").partition("Args:\n")
        described, blank, rest = tail.partition("\n\n")
        indent = " " * (len(described) - len(described.lstrip()))
        for name in inspect.signature(function).parameters:
            if name in abouts and f"{indent}{name}: " not in described:
                text = f"{name}: {with_options(abouts[name], as_keyword)}"
                described += "\n" + textwrap.fill(text, 120, initial_indent=indent, subsequent_indent=f"{indent}    ")
        function.__doc__ = head + args + described + blank + rest

        @functools.wraps(function)
        def call(*args: Any, **keywords: Any) -> Any:
            with errors_in_python():
                result = function(*args, **keywords)
            return _yield_in_python(result) if isinstance(result, Generator) else result

        return cast(F, call)

    return decorate


def _yield_in_python(results: Generator[T]) -> Generator[T]:
    with errors_in_python():
        yield from results


def implemented_by(implementation: Callable[..., Any], **kinds: type) -> Callable[[F], F]:
    """Decorates a public function without a body, as :func:`for_python` does, and calls its implementation.

    The implementation gets options of these kinds, made from the keywords, and under their names the other arguments.
    """
    others = inspect.signature(implementation).parameters.keys() - kinds.keys()

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def call(*args: Any, **keywords: Any) -> Any:
            function(*args, **keywords)  # Python refuses what is not in the signature, in its own words
            bound = inspect.signature(function).bind(*args, **keywords)
            bound.apply_defaults()
            arguments = {name: bound.arguments.pop(name) for name in others}
            options = {name: from_keywords(kind, bound.arguments) for name, kind in kinds.items()}
            return implementation(**arguments, **options)

        return cast(F, for_python(*kinds.values())(call))

    return decorate


@contextmanager
def errors_in_python() -> Iterator[None]:
    """Makes UnshutterErrors of the block name keywords instead of flags; also a decorator."""
    try:
        yield
    except UnshutterError as error:
        error.spell = as_keyword
        raise
