"""What an installation takes on disc: the core, and what each extra adds to it, as the table of docs/guide/install.md.

    python benchmarks/install_size.py [--wheel dist/unshutter-1.0.0-py3-none-any.whl] [EXTRA ...]

Each is installed into an environment of its own, with the newest versions that pip finds; pip itself is not counted.
"""

from __future__ import annotations

import argparse
import platform
import subprocess
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).parent.parent
EXTRAS = ["plot", "exr", "heic", "raw", "video", "dask", "web", "colmap"]


def installed_bytes(requirement: str) -> int:
    """Bytes on disc of a requirement with all that it needs, in a fresh environment."""
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        before = _bytes_below(Path(folder))
        command = [str(Path(folder) / "bin" / "python"), "-m", "pip", "install", "-q", requirement]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        return _bytes_below(Path(folder)) - before


def _bytes_below(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("extras", nargs="*", default=EXTRAS)
    parser.add_argument("--wheel", default=str(ROOT), help="what to install; default: this repository")
    given = parser.parse_args()
    core = installed_bytes(given.wheel)
    print(f"Python {platform.python_version()}, {platform.system()} {platform.machine()}\n")
    print("| extra | adds, MB |\n|---|---|")
    print(f"| none: the core | {core / 1e6:.0f} |")
    for extra in given.extras:
        print(f"| `{extra}` | {(installed_bytes(f'{given.wheel}[{extra}]') - core) / 1e6:.1f} |", flush=True)


if __name__ == "__main__":
    main()
