"""Writes the list of all options, made from the commands themselves, into reference/options.md.

    python docs/options.py

A test compares the page with the code. Needs unshutter-lab, whose commands are listed, too.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from unshutter.cli import COMMANDS, command_named
from unshutter.cli.arguments import Command, add_arguments

BEGIN = "<!-- made by docs/options.py from here on -->"
PAGE = Path(__file__).with_name("reference") / "options.md"
LABORATORY = ("synthesize", "evaluate", "train", "calibrate")


def page() -> str:
    """The page: what is written by hand, and then each command."""
    before, begin, _ = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    return before + begin + "\n\n" + "\n\n".join(reference()) + "\n"


def reference() -> Iterator[str]:
    """The part of each command. An option that an earlier command describes in the same words is only named."""
    described: dict[str, str] = {}  # row -> command
    for name in (*COMMANDS, *LABORATORY):
        yield "\n\n".join(section(name, command_named(name), described))


def section(name: str, command: Command, described: dict[str, str]) -> Iterator[str]:
    """Heading, description, a table with a row for the title of each group, and the names of known options."""
    parser = argparse.ArgumentParser(add_help=False)
    add_arguments(parser, command.arguments)
    yield f"## unshutter {name}"
    yield command.description
    groups: dict[str, list[argparse.Action]] = {}  # arguments and options without a group share a table
    for group in parser._action_groups:
        title = "" if group.title in ("positional arguments", "options") else str(group.title)
        groups.setdefault(title, []).extend(group._group_actions)
    table: list[str] = []
    known: dict[str, list[str]] = {}  # an earlier command -> options that it describes
    for title, actions in groups.items():
        rows = [row(action) for action in actions]
        new = [each for each in rows if each not in described]
        table += [f"| **{title}** | |"] * bool(title and new) + new
        for each in rows:
            if each in described:
                flags = each[2 : each.rindex("`", 0, each.index(" | ")) + 1]
                known.setdefault(described[each], []).append(flags)
        described |= dict.fromkeys(new, name)
    if table:
        yield "| option | what it does |\n|---|---|\n" + "\n".join(table)
    for other, flags_of_it in known.items():
        yield f"As for [{other}](#unshutter-{other}): {', '.join(flags_of_it)}."


def row(action: argparse.Action) -> str:
    """An argument: what is typed, and what it does."""
    value = "" if action.nargs == 0 else str(action.metavar or "")
    if action.choices:
        value = ", ".join(map(str, action.choices))
    typed = ", ".join(f"`{flag}`" for flag in reversed(action.option_strings)) or f"`{value}`"
    shown = f"{typed} {value}" if action.option_strings and value else typed
    return f"| {shown} | {' '.join(str(action.help).replace('%%', '%').replace('|', chr(92) + '|').split())} |"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
