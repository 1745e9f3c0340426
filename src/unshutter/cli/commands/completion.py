"""``unshutter completion``: generates shell completion scripts with shtab from one parser of all commands."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field

from unshutter.cli import command_named, summaries
from unshutter.cli.arguments import HELP_ALL, Command, add_arguments
from unshutter.errors import UnshutterError

SHELLS = ("bash", "zsh", "fish", "tcsh", "powershell")  # supported by shtab
_FILES = {"PATH", "FILE", "FOLDER"}  # metavars


@dataclass(frozen=True)
class Completion:
    """Arguments of ``unshutter completion``."""

    shell: str = field(metadata={"help": "Shell to write completions for.", "positional": True, "choices": SHELLS})


def run(arguments: Completion) -> int:
    """Prints the completion script."""
    print(completion_script(arguments.shell))
    return 0


def completion_script(shell: str) -> str:
    """Returns the script with which a shell completes commands, options, choices, methods and files.

    Args:
        shell: one of :data:`SHELLS`.

    Raises:
        UnshutterError: the installed shtab does not support the shell.
    """
    import shtab

    if shell not in shtab.SUPPORTED_SHELLS:
        raise UnshutterError(f"shtab {shtab.__version__} knows no {shell}: pip install --upgrade shtab")
    return shtab.complete(_whole_parser(shtab.FILE), shell)


def _whole_parser(files: object) -> argparse.ArgumentParser:
    """Creates a parser of all commands for shtab; it is never used to parse.

    Args:
        files: shtab's marker for arguments that are files or folders.
    """
    whole = argparse.ArgumentParser("unshutter")
    whole.add_argument("--version", action="store_true", help="print the version")
    commands = whole.add_subparsers()
    for name, what in summaries().items():
        command = command_named(name)
        parser = commands.add_parser(name, help=what)
        add_arguments(parser, command.arguments)
        parser.add_argument(HELP_ALL, action="store_true", help="show all options")
        for action in parser._actions:  # argparse offers no public access, and shtab uses it too
            _complete(action, files)
    return whole


def _complete(action: argparse.Action, files: object) -> None:
    """Adds completions that shtab cannot derive from the parser."""
    from unshutter.estimators.register import names

    if action.choices is not None:
        return
    if action.dest in ("estimator", "estimators"):
        action.choices = names()
    elif action.metavar in _FILES or not action.option_strings:
        action.complete = files  # type: ignore[attr-defined]  # read by shtab


COMPLETION = Command(
    """Print a shell completion script for unshutter's commands, options and values.

bash: unshutter completion bash > ~/.local/share/bash-completion/completions/unshutter
zsh:  unshutter completion zsh > FOLDER/_unshutter
fish: unshutter completion fish > ~/.config/fish/completions/unshutter.fish

For zsh, FOLDER is one of those in $fpath.""",
    Completion,
    run,
)
