"""Estimators: from what can be seen in one photo to its Motion.

To add one: write a file in this folder with a class that fulfils :class:`Estimator`, and add its line to
``ESTIMATORS``.
"""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module

from unshutter.errors import UsageError
from unshutter.estimators.base import Estimator, View

# name -> module:class, imported only when asked for
ESTIMATORS = {
    "segment-transformer": "unshutter.estimators.segment_transformer:SegmentTransformer",
    "none": "unshutter.estimators.none:DoNothing",
}
DEFAULT = "segment-transformer"


@lru_cache(maxsize=4)
def load(name: str = DEFAULT) -> Estimator:
    """The estimator of that name, ready to be used for any number of photos; built once per process.

    Raises:
        UsageError: no estimator has this name.
    """
    if name not in ESTIMATORS:
        raise UsageError(f"unknown estimator '{name}': choose one of {', '.join(ESTIMATORS)}")
    module, _, class_name = ESTIMATORS[name].partition(":")
    return getattr(import_module(module), class_name)()


__all__ = ["DEFAULT", "ESTIMATORS", "Estimator", "View", "load"]
