"""What can be installed besides the core: the extras, and unshutter-lab; with the command that installs each here."""

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
    """What installed packages, the lab among them, add to ``unshutter.estimators`` or ``unshutter.commands``."""
    from importlib.metadata import entry_points  # slow to import, and rarely needed

    return entry_points(group=group)


def extra(name: str) -> str:
    """The command that installs an extra, from the place that unshutter itself comes from.

    Args:
        name: of the extra, ``web``.
    """
    sources = _sources()
    return f"pip install {shlex.quote(f'{sources}[{name}]' if sources else f'unshutter[{name}]')}"


def lab(name: str = "") -> str:
    """The command that installs unshutter-lab, from the place that unshutter itself comes from.

    Args:
        name: of an extra of its own; empty: none.
    """
    sources = _sources()
    package = str(sources / "lab") if sources else "unshutter-lab"
    return f"pip install {shlex.quote(f'{package}[{name}]' if name else package)}"


def _sources() -> Path | None:
    """The folder of sources that this package lies in, or was installed from; None: a package index."""
    here = Path(__file__).resolve().parents[2]
    if (here / "pyproject.toml").is_file():
        return here
    from importlib.metadata import PackageNotFoundError, distribution
    from urllib.request import url2pathname  # slow to import, too: it brings what talks to servers

    with suppress(PackageNotFoundError, ValueError, KeyError, TypeError):
        url = json.loads(distribution("unshutter").read_text("direct_url.json") or "")["url"]
        folder = Path(url2pathname(url.removeprefix("file://")))
        if url.startswith("file://") and (folder / "pyproject.toml").is_file():
            return folder
    return None
