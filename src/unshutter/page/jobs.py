"""Jobs of worker processes, called by name, so that the server need not load NumPy and OpenCV."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from unshutter.page import clip_jobs, photo_jobs
else:

    class _Jobs:
        """A module whose functions run in worker processes; only they load it."""

        def __init__(self, module: str):
            self._module = module

        def __getattr__(self, name: str) -> Callable[..., Any]:
            return partial(_run, self._module, name)

    clip_jobs, photo_jobs = _Jobs("unshutter.page.clip_jobs"), _Jobs("unshutter.page.photo_jobs")

__all__ = ["clip_jobs", "photo_jobs"]


def _run(module: str, name: str, *arguments: object) -> Any:
    return getattr(import_module(module), name)(*arguments)
