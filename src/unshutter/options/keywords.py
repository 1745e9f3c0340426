"""The keywords of Python's functions: their signatures, docstrings and values, from the description of options.

Static tools (editors, pyright) read the keywords from a TypedDict, which stands next to the dataclass that describes
the same options; a test compares the two. All else is taken from the dataclass.
"""

from __future__ import annotations

import functools
import inspect
import textwrap
import typing
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from unshutter.options.description import options_of

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")

_MARK = "**options: "  # the line of a docstring that the options' own lines replace
_WIDTH = 120


def takes_options(keywords: type, *kinds: type) -> Callable[[F], F]:
    """A decorator for functions that end in ``**options: Unpack[KEYWORDS]``.

    It gives the function the signature and the docstring of all these keywords, and has it refuse others.

    Args:
        keywords: the TypedDict.
        kinds: dataclasses of options; the first that has an option describes it.
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
    """A dataclass of options with the values that keywords give; other keywords are for others.

    Raises:
        UsageError: a value that it does not take.
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
    """A docstring whose line for ``**options`` gives way to one for each that it does not document itself."""
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
