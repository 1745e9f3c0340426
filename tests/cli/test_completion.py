"""Completion, as the shells do it that are at hand."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import shtab

from unshutter.cli import main, summaries
from unshutter.cli.other_commands import SHELLS
from unshutter.single.register import names

# bash calls a function with the words so far; _shtab_unshutter is the one that the script registers
BASH = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
_shtab_unshutter unshutter "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""
# what is typed (the last word is completed) -> what is offered
TYPED = [
    (["rec"], {"rectify"}),
    (["rectify", "--edg"], {"--edges"}),
    (["rectify", "--edges", "c"], {"crop"}),
    (["rectify", "str"], {"street.jpg"}),
    (["rectify", "-o", "a.jpg", "str"], {"street.jpg"}),
    (["rectify", "street.jpg", "--output", "str"], {"street.jpg"}),
    (["estimate", "street.jpg", "--estimator", "segment-"], {"segment-transformer", "segment-manhattan"}),
    (["completion", "z"], {"zsh"}),
]


def script(shell: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    if sys.platform == "win32" or shutil.which(shell) is None:
        pytest.skip(f"no {shell} is at hand")
    assert main(["completion", shell]) == 0
    path = folder / f"script.{shell}"
    path.write_text(capsys.readouterr().out)
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "street.jpg").touch()
    return tmp_path


def answers(command: list[str], folder: Path) -> list[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout.splitlines()


@pytest.mark.parametrize(("typed", "offered"), TYPED)
def test_bash(typed: list[str], offered: set[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = script("bash", folder, capsys)
    assert set(answers(["bash", "-c", BASH, "bash", made.name, "unshutter", *typed], folder)) == offered


@pytest.mark.parametrize(("typed", "offered"), TYPED)
def test_fish(typed: list[str], offered: set[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = script("fish", folder, capsys)
    asked = f"source {made.name}; complete -C 'unshutter {' '.join(typed)}'"
    assert {line.partition("\t")[0] for line in answers(["fish", "-c", asked], folder)} == offered


def test_zsh_can_read_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = script("zsh", folder, capsys)
    subprocess.run(["zsh", "-n", made], check=True)
    assert made.read_text().startswith("#compdef unshutter\n")


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_that_is_offered_gets_all_methods(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in [*summaries(), *names()])


def test_other_shells_are_refused_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["completion", "dos"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "fish" in told
    monkeypatch.setattr(shtab, "SUPPORTED_SHELLS", ["bash"])
    assert main(["completion", "fish"]) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "pip install --upgrade shtab" in told
