"""``unshutter completion``."""

from __future__ import annotations

from dataclasses import dataclass, field

from unshutter.cli.arguments import Command
from unshutter.cli.completion import SHELLS, completion_script


@dataclass(frozen=True)
class Arguments:
    """What the command takes."""

    shell: str = field(metadata={"help": "The shell that is to complete.", "positional": True, "choices": SHELLS})


def run(arguments: Arguments) -> int:
    """Prints the script."""
    print(completion_script(arguments.shell))
    return 0


COMMAND = Command(
    """Print what a shell needs to complete unshutter's commands, options and their values.

bash: unshutter completion bash > ~/.local/share/bash-completion/completions/unshutter
zsh:  unshutter completion zsh > FOLDER/_unshutter
fish: unshutter completion fish > ~/.config/fish/completions/unshutter.fish

For zsh, FOLDER is one of those in $fpath.""",
    Arguments,
    run,
)
