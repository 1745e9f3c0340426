"""PyAV: imported when it is needed, and kept quiet."""

from __future__ import annotations

import os
from functools import cache
from types import ModuleType

from unshutter.errors import UnshutterError


@cache
def av() -> ModuleType:
    """The library that reads and writes films.

    Raises:
        UnshutterError: it is not installed.
    """
    os.environ.setdefault("SVT_LOG", "1")  # that encoder talks on standard error
    try:
        import av
        from av import logging
    except ImportError:
        raise UnshutterError("clips need PyAV: pip install 'unshutter[video]'") from None
    logging.set_level(None)
    return av
