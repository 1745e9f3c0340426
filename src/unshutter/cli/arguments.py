"""From a frozen dataclass to a command line: its fields are the arguments, dataclasses among them groups of options.

A field's type says how its word is read, its default whether it may be left out, ``option(default, help)`` what
``--help`` prints. argparse does the rest. (cyclopts would do all of this, but no photo can be decoded before its name
is known: cyclopts takes 39 ms to import and to parse, argparse 4, and a whole 12-megapixel photo 470.)
"""

from __future__ import annotations

import argparse
import dataclasses
import types
import typing
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from unshutter.errors import UsageError
from unshutter.options import Names
from unshutter.storage.urls import local_file

_METAVAR = {int: "N", float: "NUMBER", Path: "PATH", str: "TEXT"}


@dataclass(frozen=True)
class Command:
    """A command of the program.

    Attributes:
        description: what it does: a line, and after an empty one what else there is to know.
        arguments: dataclass of what it takes.
        run: does it; takes such a value, returns the exit code.
        when_stopped: what is true once it was stopped in the middle.
    """

    description: str
    arguments: type
    run: Callable[[Any], int]
    when_stopped: str = "what was finished is kept"

    @property
    def summary(self) -> str:
        """What it does, as it stands in a list of commands."""
        line = self.description.partition("\n")[0].rstrip(".")
        return line[:1].lower() + line[1:]


def positional(help: str, names: Names, optional: bool = False) -> Any:
    """A field that is given by its place, without a flag; a list may be left empty if it is optional."""
    return field(metadata={"help": help, "names": names, "positional": True, "optional": optional})


def required(help: str, names: Names, short: str | None = None) -> Any:
    """A field whose flag must be given."""
    return field(metadata={"help": help, "names": names, "short": short})


def parse(name: str, command: Command, words: Sequence[str]) -> Any:
    """The command's arguments from the words that follow its name.

    Raises:
        UsageError: words that the command does not know, or values that it does not take.
        SystemExit: help was asked for, and printed.
    """
    parser = _Parser(f"unshutter {name}", command.description, _usage(command.arguments))
    add_arguments(parser, command.arguments)
    return _made(command.arguments, parser.parse_intermixed_args(words))


class _Parser(argparse.ArgumentParser):
    """argparse's, whose complaints are UsageErrors of one line."""

    def __init__(self, prog: str, description: str, usage: str):
        super().__init__(
            prog=prog,
            usage=f"%(prog)s {usage}",
            description=description,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{' '.join(message.split())} (see {self.prog} --help)")


def _usage(kind: type) -> str:
    names = [(each, each.name.upper() + (" ..." if _is_list(type_) else "")) for each, type_ in _fields(kind)]
    places = [f"[{name}]" if each.metadata.get("optional") else name for each, name in names if _placed(each)]
    return " ".join([*places, "[options]"])


def outputs(kind: type) -> list[str]:
    """The options that name what a command writes, as flags: ``--output``."""
    found = []
    for each, type_ in _fields(kind):
        if _is_group(type_):
            found += outputs(type_)
        elif each.metadata.get("names") == "output":
            found.append(_flag(each))
    return found


def add_arguments(parser: argparse.ArgumentParser, kind: type) -> None:
    """Adds the arguments of a dataclass; a group for each dataclass in it."""
    _add_to(parser, parser, kind)


def _add_to(parser: argparse.ArgumentParser, group: Any, kind: type) -> None:
    for each, type_ in _fields(kind):
        if _is_group(type_):
            title = (type_.__doc__ or "").partition("\n")[0].rstrip(".")
            _add_to(parser, parser.add_argument_group(title), type_)
        else:
            flags, how = _argument(each, type_)
            group.add_argument(*flags, **how)


def _argument(each: dataclasses.Field, type_: Any) -> tuple[list[str], dict[str, Any]]:
    """Names and properties of an argument, as argparse wants them."""
    how: dict[str, Any] = {"help": each.metadata["help"].replace("%", "%%")}
    inner = _without_none(type_)
    if _is_list(inner):
        inner = typing.get_args(inner)[0]
        how["nargs"] = "*" if each.metadata.get("optional") else "+"
    if inner is bool:
        how["action"] = "store_true"
    elif "choices" in each.metadata:
        how["choices"] = [str(choice) for choice in each.metadata["choices"]]
    elif typing.get_origin(inner) is typing.Literal:
        how["choices"] = typing.get_args(inner)
    else:
        if inner in (Path, str) and "names" not in each.metadata:
            raise TypeError(f"say what the option '{each.name}' names (options/fields.py)")
        how |= {"type": _path if inner is Path else inner, "metavar": each.metadata.get("metavar") or _METAVAR[inner]}
    if _placed(each):
        return [each.name], how | {"metavar": each.name.upper()}
    if each.default is not dataclasses.MISSING:
        how["default"] = each.default
    else:
        how["required"] = True
    short = each.metadata.get("short")
    return [_flag(each), *([short] if short else [])], how | {"dest": each.name}


def _path(word: str) -> Path:
    """A path, or what a URL of a file of this machine leads to.

    Raises:
        UsageError: a URL that leads elsewhere.
    """
    if "://" not in word:
        return Path(word)
    if (file := local_file(word)) is None:
        raise UsageError(f"{word} is not on this machine, and this needs a file or folder that is")
    return file


def _made(kind: type, given: argparse.Namespace) -> Any:
    """The dataclass with the values that were given."""
    values = vars(given)
    return kind(
        **{each.name: _made(type_, given) if _is_group(type_) else values[each.name] for each, type_ in _fields(kind)}
    )


def _fields(kind: type) -> Iterator[tuple[dataclasses.Field, Any]]:
    """Fields of a dataclass that can be given, with their types: those with a help, and groups."""
    hints = typing.get_type_hints(kind)
    fields = ((each, hints[each.name]) for each in dataclasses.fields(kind))
    return ((each, type_) for each, type_ in fields if each.metadata or _is_group(type_))


def _is_group(type_: Any) -> bool:
    return dataclasses.is_dataclass(type_)


def _placed(each: dataclasses.Field) -> bool:
    return each.metadata.get("positional", False)


def _flag(each: dataclasses.Field) -> str:
    return f"--{each.name.replace('_', '-')}"


def _is_list(type_: Any) -> bool:
    return typing.get_origin(type_) is list


def _without_none(type_: Any) -> Any:
    """T of ``T | None``."""
    if isinstance(type_, types.UnionType) or typing.get_origin(type_) is typing.Union:
        (type_,) = (t for t in typing.get_args(type_) if t is not type(None))
    return type_
