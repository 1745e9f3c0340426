"""Whether unshutter-lab, installed beside unshutter, adds what its README promises, from an empty folder.

    /path/to/python .ci/smoke_lab.py examples/demo.jpg

Run it with the interpreter that both were installed for; training and calibration need more (extras), and are only
asked for their help.
"""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

OURS = ("kandula2020-research", "rengarajan2017", "rengarajan2017-vanilla", "rengarajan2016", "purkait2017", "lao2018")
# command -> what its output or a file that it writes shows
COMMANDS = {
    "unshutter models": None,
    "unshutter synthesize street.jpg -o pairs --size 128 --canvas 178": "pairs/manifest.json",
    "unshutter evaluate --data photos --estimators kandula2020-research --per-photo 1 -o out": "out/results.md",
    "unshutter rectify street.jpg --estimator kandula2020-research --min-confidence 0 -o paper.jpg": "paper.jpg",
    "unshutter train --help": None,
    "unshutter calibrate --help": None,
}


def main() -> None:
    photo = Path(sys.argv[1]).resolve()
    program = shutil.which("unshutter", path=str(Path(sys.executable).parent))
    if program is None:
        sys.exit(f"smoke_lab: no program `unshutter` beside {sys.executable}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "photos").mkdir()
        for place in ("street.jpg", "photos/a.jpg"):
            shutil.copy(photo, folder / place)
        for command, written in COMMANDS.items():
            words = [program, *shlex.split(command)[1:]]
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
            if done.returncode or (written and not (folder / written).is_file()):
                sys.exit(f"smoke_lab: exit code {done.returncode} of {command}\n{done.stdout}{done.stderr}")
            if command == "unshutter models" and (missing := [each for each in OURS if each not in done.stdout]):
                sys.exit(f"smoke_lab: `unshutter models` does not list {', '.join(missing)}")
            print(f"ok: {command}")


if __name__ == "__main__":
    main()
