"""pyvips: imported when it is needed, kept quiet, its failures turned into one line."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from unshutter.errors import UnshutterError


@cache
def libvips() -> Any:
    """pyvips, without libvips's log: it repeats to standard error what errors say, and not always as text."""
    first = "pyvips" not in sys.modules  # else the log is its importer's affair
    if first:
        os.environ.setdefault("VIPS_WARNING", "1")
    import pyvips

    if first:
        getattr(pyvips, "_remove_log_handler", lambda: None)()
    return pyvips


@contextmanager
def refusing(what: str) -> Iterator[None]:
    """Failures of libvips become an UnshutterError: ``what`` and the cause."""
    vips = libvips()
    _take_notes()
    try:
        yield
    except (vips.Error, UnicodeDecodeError) as error:  # pyvips takes libvips's notes for text
        told = _take_notes() if isinstance(error, UnicodeDecodeError) else f"{error.detail}\n{error.message}"
        raise UnshutterError(f"{what}: {_cause(told)}") from None


def _take_notes() -> str:
    """What libvips has complained of since the last time."""
    vips = libvips()
    notes = vips.ffi.string(vips.vips_lib.vips_error_buffer()).decode(errors="replace")
    vips.vips_lib.vips_error_clear()
    return notes


def _cause(notes: str) -> str:
    """The cause in libvips's many lines of complaint: the system's, else the first."""
    lines = [line.strip() for line in notes.splitlines() if line.strip()]
    system = [line.removeprefix("system error: ") for line in lines if line.startswith("system error: ")]
    told = [line for line in system if not line.startswith("Unknown error")]
    lines = [line for line in lines if "bad seek" not in line]  # how libheif finds the end of a stream
    return (told or lines or ["unknown"])[0]
