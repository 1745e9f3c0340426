"""Optional parts, the extras and unshutter-lab, and the commands that install them here."""

from __future__ import annotations

import json
import shlex
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

LAB_METHODS = frozenset(
    ("kandula2020", "rengarajan2017", "rengarajan2017-vanilla", "rengarajan2016", "purkait2017", "lao2018")
)
LAB_COMMANDS = frozenset(("synthesize", "evaluate", "train", "calibrate"))


def plugins(group: str) -> EntryPoints:
    """Returns the entry points of installed packages in ``unshutter.estimators`` or ``unshutter.commands``."""
    from importlib.metadata import entry_points  # slow to import, and rarely needed

    return entry_points(group=group)


def extra(name: str) -> str:
    """Returns the command that installs an extra from where unshutter itself was installed.

    Args:
        name: the extra, such as ``web``.
    """
    sources = _sources()
    return f"pip install {shlex.quote(f'{sources}[{name}]' if sources else f'unshutter[{name}]')}"


def lab(name: str = "") -> str:
    """Returns the command that installs unshutter-lab from where unshutter itself was installed.

    Args:
        name: one of the lab's own extras; empty: none.
    """
    sources = _sources()
    package = str(sources / "lab") if sources else "unshutter-lab"
    return f"pip install {shlex.quote(f'{package}[{name}]' if name else package)}"


def _sources() -> Path | None:
    """Returns the source folder that this package is in or was installed from; None if installed from an index."""
    here = Path(__file__).resolve().parents[2]
    if (here / "pyproject.toml").is_file():
        return here
    from importlib.metadata import PackageNotFoundError, distribution
    from urllib.request import url2pathname  # also slow to import: it loads the HTTP client

    with suppress(PackageNotFoundError, ValueError, KeyError, TypeError):
        url = json.loads(distribution("unshutter").read_text("direct_url.json") or "")["url"]
        folder = Path(url2pathname(url.removeprefix("file://")))
        if url.startswith("file://") and (folder / "pyproject.toml").is_file():
            return folder
    return None
