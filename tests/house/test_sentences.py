"""The program branches on codes and types: nothing looks into a message, compares one, or rewrites one."""

import re
from pathlib import Path

import pytest

import unshutter

HERE = Path(unshutter.__file__).parent
ROOMS = (
    "api.py",
    "frames",
    "motion",
    "options",
    "page",
    "photo",
    "rectification",
    "run/plan.py",
    "single",
    "storage",
    "video",
)
_SENTENCE = r"(?:str\((?:error|reason|told|message)\)|(?:\w+\.)*(?:reason|message|why))"
_LOOKS = re.compile(
    rf"\bin {_SENTENCE}(?!\.?\w|\()"  # "words" in str(error)
    rf"|(?<!for )(?<![\w.]){_SENTENCE} (?:==|!=|in) "  # reason == STOOD_STILL
    rf"|[=!]= {_SENTENCE}(?![\w.(])"
    rf"|{_SENTENCE}\.(?:replace|r?partition|remove(?:suf|pre)fix|startswith|endswith|find|index)\("
    r"|\bre\.\w+\([^\n]*str\(error\)"
)


@pytest.mark.parametrize(
    "line",
    [
        "if WHAT_TO_DO in str(error): raise",
        "return found.reason if WHAT_TO_DO in found.reason else other",
        'return "camera" if camera.reason == STOOD_STILL else "dense"',
        "untold = [each for each in all if each.reason != STOOD_STILL]",
        'why = str(error).removesuffix(": say so")',
        'return message.partition("(")[2]',
        'raise type(error)(str(error).replace(str(path), "the clip"))',
        'line = re.sub("/tmp/.*", "", str(error))',
        'cause = "no motion" if STILL == made.reason else ""',
    ],
)
def test_the_search_finds_what_it_is_for(line: str) -> None:
    assert _LOOKS.search(line)


@pytest.mark.parametrize(
    "line",
    [
        "if motion.reason is not None and motion.reason.code is Code.STOOD_STILL:",
        "if found.reason:",
        "for reason in reasons:",
        "self.reason = reason",
        'raise UnshutterError(f"cannot reach it: {error}")',
        "cause = Cause.NO_MOTION if made.reason.code is Code.NOTHING_MOVED else None",
        "if found.reason.code == Code.OTHER_SIZE:",
        "self.reasons[moved.motion.reason] += 1",
    ],
)
def test_the_search_passes_what_is_in_order(line: str) -> None:
    assert not _LOOKS.search(line)


def test_no_branch_depends_on_a_message() -> None:
    files = [
        file for room in ROOMS for file in ([HERE / room] if room.endswith(".py") else (HERE / room).rglob("*.py"))
    ]
    assert len(files) > 80
    looks = [
        f"{file.relative_to(HERE)}:{number}: {line.strip()}"
        for file in files
        for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1)
        if _LOOKS.search(line)
    ]
    assert looks == []
