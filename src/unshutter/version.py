"""What is installed: the version, other packages that add methods and commands, and how to install optional parts."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, suggestion

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

__version__ = "1.1.0"  # defined only here (pyproject.toml reads it)


def plugins(group: str) -> EntryPoints:
    """Returns the entry points of installed packages in ``unshutter.estimators`` or ``unshutter.commands``."""
    from importlib.metadata import entry_points  # slow to import, and rarely needed

    return entry_points(group=group)


def import_method(name: str) -> None:
    """Imports the module of another package's method, and so its kinds of motion; all methods' if none has the name."""
    points = plugins("unshutter.estimators")
    for point in points.select(name=name) or points:
        try:
            import_module(point.load().home.partition(":")[0])
        except Exception as error:  # another package's import may raise anything
            raise UnshutterError(f"cannot load the installed estimator '{point.name}': {error}") from None


def extra(name: str) -> str:
    """Returns the command that installs an extra from where unshutter itself was installed."""
    sources = _sources()
    return f"pip install {shlex.quote(f'{sources}[{name}]' if sources else f'unshutter[{name}]')}"


def lab(name: str = "") -> str:
    """Returns the command that installs unshutter-lab, or one of its extras, from the place of unshutter itself."""
    sources = _sources()
    package = str(sources / "lab") if sources else "unshutter-lab"
    return f"pip install {shlex.quote(f'{package}[{name}]' if name else package)}"


def choices(word: str, known: Iterable[str], group: str) -> str:
    """Suggests a name instead of an unknown one; ``group`` is that of the packages which may add more."""
    known = list(known)
    more = "" if plugins(group) else f"; unshutter-lab adds more: {lab()}"
    is_variant = any(word.startswith(f"{name}-") for name in known)  # such as kandula2020-research
    close = "" if more and is_variant else suggestion(word, known)
    return close or f"choose one of {', '.join(known)}{more}"


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
