"""Describes options in one place, for the command line, forms, OpenAPI and Python keywords.

An option is a field of a frozen dataclass, created with :func:`option`, which defines its type, default and help;
:func:`describe` reads them.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
import textwrap
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

from unshutter.errors import UsageError

# What an option's value names: a file or folder that is read, one that is written, or neither.
Names = Literal["input", "output", "word"]

T = TypeVar("T")


def option(default: Any, help: str, **more: Any) -> Any:
    """Defines a field that is an option.

    Args:
        default: value if the option is not used.
        help: description of the option, for all interfaces.
        more: ``names`` (:data:`Names`), required for paths and text: a test gives every option that names an output the
            names of all inputs; ``metavar``, ``choices``, ``limits`` (minimum and maximum of a number) and ``short``
            (``-o``); ``bare``, the value of the flag alone if the command line accepts it without a value;
            ``page=False`` if the page and its API do not offer the option.
    """
    return field(default=default, metadata={"help": help, **more})


def check_time(name: str, time: float | None, unit: str) -> None:
    """Checks a time; None is allowed.

    Raises:
        UsageError: it is not positive.
    """
    if time is not None and not 0 < time < math.inf:
        raise UsageError(f"the {name} must take a positive time, got {time:g} {unit}")


@dataclass(frozen=True)
class Option:
    """An option as described by its field.

    Attributes:
        key: its name in Python, such as ``roll_deg``.
        type: type of its value, or of each value of a list, without None.
        default: value if the option is not used; ``dataclasses.MISSING`` if it is required.
        help: description of the option.
        choices: allowed values; empty: any value of the type.
        several: whether it takes a list of values.
        more: further metadata of the field, see :func:`option`.
    """

    key: str
    type: type
    default: Any
    help: str
    choices: tuple[str, ...] = ()
    several: bool = False
    more: typing.Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The name in forms and, after two dashes, on the command line: ``roll-deg``."""
        return self.key.rstrip("_").replace("_", "-")

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
    """A group of options that belong together, defined by their own dataclass.

    Attributes:
        key: name of the field that holds them.
        kind: the dataclass.
    """

    key: str
    kind: type

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


def with_values(kind: type[T], value: Callable[[Option], Any]) -> T:
    """Creates a dataclass of options.

    Args:
        kind: the dataclass.
        value: returns the value of an option.

    Raises:
        UsageError: values are invalid or exclude each other.
    """
    return kind(
        **{
            each.key: with_values(each.kind, value) if isinstance(each, Group) else value(each)
            for each in describe(kind)
        }
    )


def _option(each: dataclasses.Field, annotation: Any) -> Option:
    inner = _without_none(annotation)
    several = get_origin(inner) is list
    if several:
        (inner,) = get_args(inner)
    choices = tuple(map(str, each.metadata.get("choices", ())))
    if get_origin(inner) is Literal:
        inner, choices = str, get_args(inner)
    if not choices and inner in (Path, str) and "names" not in each.metadata:
        raise TypeError(f"say what the option '{each.name}' names (options/description.py)")
    return Option(each.name, inner, each.default, each.metadata["help"], choices, several, each.metadata)


def _without_none(annotation: Any) -> Any:
    """Extracts T from ``T | None``."""
    if isinstance(annotation, types.UnionType) or get_origin(annotation) is typing.Union:
        (annotation,) = (one for one in get_args(annotation) if one is not type(None))
    return annotation


F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")

_MARK = "**options: "  # the docstring line that is replaced by the lines of the options
_WIDTH = 120


def takes_options(keywords: type, *kinds: type) -> Callable[[F], F]:
    """Decorates a function that ends in ``**options: Unpack[KEYWORDS]``.

    The function gets the signature and documentation of all these keywords, and rejects others.

    Args:
        keywords: the TypedDict.
        kinds: dataclasses of options; the first one that has an option provides its description.
    """

    def decorate(function: F) -> F:
        signature = inspect.signature(function)
        own = [each for each in signature.parameters.values() if each.kind is not each.VAR_KEYWORD]
        known = {each.name for each in own} | keywords.__annotations__.keys()

        @functools.wraps(function)
        def checked(*arguments: Any, **options: Any) -> Any:
            for name in options.keys() - known:
                raise TypeError(f"{function.__name__}() got an unexpected keyword argument '{name}'")
            return function(*arguments, **options)

        parameters = [*own, *_parameters(keywords, kinds)]
        checked.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        checked.__doc__ = _with_options(function.__doc__ or "", keywords, kinds)
        return typing.cast(F, checked)

    return decorate


def from_keywords(kind: type[T], options: Mapping[str, Any]) -> T:
    """Creates a dataclass of options from keywords; keywords that are not among its options are ignored.

    Raises:
        UsageError: a value is invalid.
    """
    return kind(**{each.key: options[each.key] for each in options_of(kind) if each.key in options})


def _parameters(keywords: type, kinds: tuple[type, ...]) -> list[inspect.Parameter]:
    defaults = {each.key: each.default for kind in reversed(kinds) for each in options_of(kind)}
    return [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=defaults.get(name),
            annotation=getattr(annotation, "__forward_arg__", annotation),
        )
        for name, annotation in keywords.__annotations__.items()
    ]


def _with_options(docstring: str, keywords: type, kinds: tuple[type, ...]) -> str:
    """Replaces a docstring's line for ``**options`` with one line for each option not documented in the docstring."""
    helps = {each.key: each.help for kind in reversed(kinds) for each in options_of(kind)}
    lines: list[str] = []
    for line in docstring.splitlines():
        indent = line[: len(line) - len(line.lstrip())]
        if not line.lstrip().startswith(_MARK):
            lines.append(line)
            continue
        for name in keywords.__annotations__:
            if f"{indent}{name}: " not in docstring:
                lines += textwrap.wrap(
                    f"{name}: {helps[name]}", _WIDTH, initial_indent=indent, subsequent_indent=f"{indent}    "
                )
    return "\n".join(lines)
