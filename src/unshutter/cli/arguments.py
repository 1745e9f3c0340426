"""Builds a command line from a frozen dataclass: fields become arguments, nested dataclasses groups of options.

A field's type determines how its argument is parsed, its default whether it may be omitted, and ``option(default,
help)`` what ``--help`` prints; argparse does the rest. (cyclopts could do all of this, but decoding cannot start before
the photo's name is known: import and parsing take 39 ms with cyclopts and 4 with argparse; a 12-megapixel photo takes
470 in all.)
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, TypeGuard

from unshutter.errors import UsageError, shortened, suggestion
from unshutter.options.fields import Group, Option, describe, options_of, with_values
from unshutter.storage.files import check_plain
from unshutter.storage.objects import local_file

HELP_ALL = "--help-all"
_HELP = frozenset(("-h", "--help", HELP_ALL))
_KINDS = {int: "a whole number", float: "a number"}
_METAVAR = {int: "N", float: "NUMBER", Path: "PATH", str: "TEXT"}


@dataclass(frozen=True)
class Command:
    """A command of the program."""

    description: str  # what it does: a one-line summary, then an empty line and further details
    arguments: type  # dataclass of its arguments
    run: Callable[[Any], int]  # runs it with such a value; returns the exit code
    # message for a command that was interrupted: the state of its results
    when_stopped: str = "finished results are kept"
    # options in the short help with their one-line descriptions; empty: the help shows all options
    essentials: Mapping[str, str] = field(default_factory=dict)

    @property
    def summary(self) -> str:
        """The summary for a list of commands."""
        line = self.description.partition("\n")[0].rstrip(".")
        return line[:1].lower() + line[1:]


def parse(name: str, command: Command, words: Sequence[str]) -> Any:
    """Parses the words that follow a command's name into its arguments."""
    parser = _Parser(name, command)
    add_arguments(parser, command.arguments)
    end = words.index("--") if "--" in words else len(words)
    # "--" itself remains, because it also ends lists of values
    names = [*words[end : end + 1], *(f"./{word}" if word.startswith("-") else word for word in words[end + 1 :])]
    words = words[:end]
    if not _HELP.isdisjoint(words):
        print((parser if HELP_ALL in words else _short_parser(name, command)).format_help())
        raise SystemExit
    parser.check_flags(words, command.arguments)
    known, extra = parser.parse_known_intermixed_args([*_with_bare_values(words, command.arguments), *names])
    for flag in (word for word in extra if word.startswith("-")):
        parser.error(f"unknown option {shortened(flag)}: leave it out")
    if extra:
        places = [each.key.upper() for each in options_of(command.arguments) if _placed(each)]
        takes = f"takes one {places[-1]}" if places else "takes options only"
        parser.error(f"{takes}: leave out {shortened(' '.join(extra))}")
    values = vars(known)
    for each in options_of(command.arguments):
        if each.more.get("names") == "input" and not each.several and values[each.key] is not None:
            check_plain(Path(values[each.key]))
    return with_values(command.arguments, lambda option: values[option.key])


def _with_bare_values(words: Sequence[str], kind: type) -> list[str]:
    """Adds the default value to each flag that may be used without one and is not followed by a value.

    argparse would use whatever follows as its value, even a file name.
    """
    bare = {_flag(each): each for each in options_of(kind) if "bare" in each.more}
    followers = [*words[1:], ""][: len(words)]
    return [
        f"{word}={bare[word].more['bare']}" if word in bare and not _is_value(following, bare[word]) else word
        for word, following in zip(words, followers, strict=True)
    ]


def _is_value(word: str, option: Option) -> bool:
    """Whether a word is a choice of the option, or the number that it takes."""
    if option.choices:
        return word in option.choices
    try:
        float(word)
    except ValueError:
        return False
    return True


class _Parser(argparse.ArgumentParser):
    """An argparse parser that raises UsageErrors of one line."""

    def __init__(self, name: str, command: Command):
        super().__init__(
            prog=f"unshutter {name}",
            usage=f"%(prog)s {_usage(command.arguments)}",
            description=_wrapped(command.description),
            formatter_class=lambda prog: argparse.RawDescriptionHelpFormatter(prog, max_help_position=28),
            allow_abbrev=False,
            add_help=False,
        )
        for names, shown in ((("-h", "--help"), "this"), ((HELP_ALL,), "all options")):
            self.add_argument(*names, action="store_true", help=f"show {shown}", default=argparse.SUPPRESS)

    def check_flags(self, words: Sequence[str], kind: type) -> None:
        """Checks that the command knows every flag among the words, and that every choice has one of its values."""
        options = {_flag(each): each for each in options_of(kind) if not _placed(each)}
        known = {*_HELP, *options}
        for word, following in zip(words, [*words[1:], "-"], strict=False):
            flag = word.partition("=")[0]
            choices = options[word].choices if word in options and "bare" not in options[word].more else ()
            if choices and following.startswith("-"):
                self.error(f"{word} needs a value: {', '.join(choices)}")
            if len(flag) > 2 and flag.startswith("--") and " " not in word and flag not in known:
                self.error(f"unknown option {shortened(flag)}: {suggestion(flag, known) or 'leave it out'}")

    def error(self, message: str) -> NoReturn:
        message = message.removeprefix("argument ").replace("expected one argument", "needs a value")
        raise UsageError(f"{' '.join(message.split())} (see {self.prog} --help)")


def _parsed(word: str, option: Option, program: str) -> Any:
    """Parses a value of an option, for argparse; raises UsageError if it is not one."""
    name = option.key.upper() if _placed(option) else _flag(option)
    if word == "-" and not option.more.get("pipe"):
        raise UsageError(f"{name}: '-' is not accepted here: give a file name, or leave it out (see {program} --help)")
    if option.choices:
        value = option.more.get("also", {}).get(word.lower(), word)
        if value in option.choices:
            return value
        guess = suggestion(value, option.choices)
        takes = f"{', '.join(option.choices)}, not '{shortened(word)}'{f': {guess}' if guess else ''}"
        raise UsageError(f"{name} takes {takes} (see {program} --help)")
    try:
        return _path(word) if option.type is Path else option.type(word)
    except ValueError:
        kind = _KINDS.get(option.type, "another value")
        raise UsageError(f"{name} takes {kind}, not '{shortened(word)}' (see {program} --help)") from None


def _short_parser(name: str, command: Command) -> argparse.ArgumentParser:
    """Creates the parser for the short help: positional arguments and essential options, one line each."""
    options = list(options_of(command.arguments))
    parser = _Parser(name, replace(command, description=command.description.partition("\n")[0]))
    for each in options:
        if _placed(each) or not command.essentials or each.key in command.essentials:
            names, properties = _argument(each, parser.prog)
            properties["help"] = command.essentials.get(each.key, properties["help"])
            if each.choices:
                properties["metavar"] = "CHOICE"
            parser.add_argument(*reversed(names), **properties)
    if command.essentials:
        hidden = sum(each.key not in command.essentials for each in options)
        parser.epilog = f"{hidden} more options: unshutter {name} {HELP_ALL}"
    return parser


def _wrapped(text: str) -> str:
    """Wraps the paragraphs of a text to the width of the terminal."""
    width = max(shutil.get_terminal_size().columns - 2, 20)
    paragraphs = (" ".join(paragraph.split()) for paragraph in text.split("\n\n"))
    return "\n\n".join(textwrap.fill(paragraph, width) for paragraph in paragraphs)


def _usage(kind: type) -> str:
    places = [(each, each.key.upper() + (" ..." if each.several else "")) for each in describe(kind) if _placed(each)]
    return " ".join([*(f"[{name}]" if each.more.get("optional") else name for each, name in places), "[options]"])


def as_typed(arguments: Any, **changed: Any) -> list[str]:
    """Returns the words that parse into these arguments: positional ones, then options that differ from defaults."""
    placed: list[str] = []
    flags: list[str] = []
    for each in describe(type(arguments)):
        if isinstance(each, Group):
            flags += as_typed(getattr(arguments, each.key), **changed)
            continue
        value = changed.get(each.key, getattr(arguments, each.key))
        values = [str(one) for one in value] if each.several and value is not None else [str(value)]
        if _placed(each):
            placed += [f"./{one}" if one.startswith("-") else one for one in values]
        elif value != each.default:
            flags += [each.more.get("short") or _flag(each), *([] if each.type is bool else values)]
    return placed + flags


def add_arguments(parser: argparse.ArgumentParser, kind: type, group: Any = None) -> list[argparse.Action]:
    """Adds the arguments of a dataclass to a group, if one is given, with a group for each nested dataclass."""
    added: list[argparse.Action] = []
    for each in describe(kind):
        if isinstance(each, Group):
            added += add_arguments(parser, each.kind, parser.add_argument_group(each.title))
        else:
            names, properties = _argument(each, parser.prog)
            added.append((group or parser).add_argument(*names, **properties))
    return added


def _argument(option: Option, program: str) -> tuple[list[str], dict[str, Any]]:
    """Returns the names and properties of an argument for argparse."""
    properties: dict[str, Any] = {"help": option.help.replace("%", "%%")}
    if option.several:
        properties["nargs"] = "*" if option.more.get("optional") else "+"
    if option.type is bool:
        properties["action"] = "store_true"
    else:
        properties["type"] = partial(_parsed, option=option, program=program)
    if option.choices:
        properties["choices"] = option.choices
    elif option.type is not bool:
        properties["metavar"] = option.more.get("metavar") or _METAVAR[option.type]
    if "bare" in option.more:
        properties |= {"nargs": "?", "const": option.more["bare"]}  # shown as [SECONDS]
    if _placed(option):
        return [option.key], properties | {"metavar": option.key.upper()}
    if option.default is not dataclasses.MISSING:
        properties["default"] = option.default
    else:
        properties["required"] = True
    short = option.more.get("short")
    return [_flag(option), *([short] if short else [])], properties | {"dest": option.key}


def _path(word: str) -> Path:
    """Parses a path, or a URL that leads to a file on this machine."""
    if (file := local_file(word)) is None:
        raise UsageError(f"{word} is a URL: give a file or folder on this machine")
    return file


def _placed(each: Option | Group) -> TypeGuard[Option]:
    return isinstance(each, Option) and each.more.get("positional", False)


def _flag(option: Option) -> str:
    return f"--{option.name}"
