"""Whether an installed unshutter does what README.md promises, from an empty folder.

    /path/to/python .ci/smoke.py README.md examples/demo.jpg

Each `unshutter` command of the README's shell blocks runs in a folder of its own, in which the names that the README
gives to photos and folders stand for the given photo; so does its first block of Python. The page, `unshutter serve`,
is only asked for its help. unshutter-lab must not be installed: its commands and methods are tried, too, and one line
has to say what to install. Run it with the interpreter that unshutter was installed for; nothing else is needed.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PHOTOS = ["street.jpg", "photo.jpg", "next.jpg", "a.jpg", "b.jpg", "c.jpg"]
FOLDERS = ["holiday", "frames"]
# command of unshutter-lab -> what its message names
FROM_THE_LAB = {
    "train --config segment-transformer": "'train'",
    "rectify street.jpg --estimator kandula2020-research": "'kandula2020-research'",
}
NOT_FOR_A_PHOTO = {"serve": "waits for a browser", "open": "opens one", "video": "needs a clip"}


def commands(page: str) -> list[list[str]]:
    """The `unshutter ...` lines of a page's shell blocks, each as its words."""
    blocks = re.findall(r"^```sh\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    lines = [shlex.split(line, comments=True) for block in blocks for line in block.splitlines()]
    return [words for words in lines if words[:1] == ["unshutter"]]


def first_python(page: str) -> str:
    """The first Python block of a page."""
    found = re.search(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    if found is None:
        sys.exit("smoke: the README has no Python block")
    return found[1]


def lay_out(folder: Path, photo: Path) -> None:
    """Puts the photo where the README's commands expect photos."""
    for name in PHOTOS:
        shutil.copy(photo, folder / name)
    for name in FOLDERS:
        (folder / name).mkdir()
        for k in range(3):
            shutil.copy(photo, folder / name / f"{k}.jpg")


def try_out(what: str, command: list[str], photo: Path) -> None:
    """Runs a command in a fresh folder; ends the program if it fails or changes a photo that it was given."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lay_out(folder, photo)
        given = {path: path.read_bytes() for path in folder.rglob("*.jpg")}
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
        if done.returncode:
            sys.exit(f"smoke: exit code {done.returncode} of {what}\n{done.stdout}{done.stderr}")
        if any(path.read_bytes() != data for path, data in given.items()):
            sys.exit(f"smoke: {what} changed a photo that it was given")
    print(f"ok: {what}")


def refuse(program: str, words: list[str], name: str, photo: Path) -> None:
    """Ends the program unless a command is refused with exit code 2 and one line that says what to install."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(photo, Path(folder) / PHOTOS[0])
        done = subprocess.run([program, *words], cwd=folder, capture_output=True, text=True, timeout=60, check=False)
    lines = done.stderr.splitlines()
    if done.returncode != 2 or len(lines) != 1 or name not in lines[0] or "pip install unshutter-lab" not in lines[0]:
        sys.exit(f"smoke: exit code {done.returncode} of {shlex.join(words)}\n{done.stdout}{done.stderr}")
    print(f"ok: {shlex.join(words)}: {lines[0]}")


def main() -> None:
    page, photo = Path(sys.argv[1]).read_text(encoding="utf-8"), Path(sys.argv[2]).resolve()
    program = shutil.which("unshutter", path=str(Path(sys.executable).parent))
    if program is None:
        sys.exit(f"smoke: no program `unshutter` beside {sys.executable}")
    asked = commands(page)
    if not asked:
        sys.exit("smoke: the README has no `unshutter` command")
    for words, missing in FROM_THE_LAB.items():
        refuse(program, words.split(), missing, photo)
    for words in [["unshutter", "--version"], ["unshutter", "models"], *asked]:
        arguments = [words[1], "--help"] if words[1] in NOT_FOR_A_PHOTO else words[1:]
        try_out(shlex.join(["unshutter", *arguments]), [program, *arguments], photo)
    try_out("the first Python block", [sys.executable, "-c", first_python(page)], photo)


if __name__ == "__main__":
    main()
