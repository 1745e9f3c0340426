"""Estimators: from what can be seen in one photo to its Motion.

To add one: write a file in this folder with a class that fulfils :class:`Estimator`, and add its line to
``ESTIMATORS``.
"""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module
from inspect import signature
from pathlib import Path

from unshutter.default_estimator import DEFAULT_ESTIMATOR as DEFAULT
from unshutter.errors import UnshutterError, UsageError
from unshutter.estimators.base import Estimator, View

# name -> module:class, imported only when asked for
ESTIMATORS = {
    "segment-transformer": "unshutter.estimators.methods.segment_transformer:SegmentTransformer",
    "kandula2020": "unshutter.estimators.methods.kandula2020:Kandula2020",
    "rengarajan2016": "unshutter.estimators.methods.rengarajan2016:Rengarajan2016",
    "purkait2017": "unshutter.estimators.methods.purkait2017:Purkait2017",
    "lao2018": "unshutter.estimators.methods.lao2018:Lao2018",
    "segment-manhattan": "unshutter.estimators.methods.segment_manhattan:SegmentManhattan",
    "manhattan": "unshutter.estimators.methods.manhattan:Manhattan",
    "none": "unshutter.estimators.methods.none:DoNothing",
}
# those for which the package has no weights: NAME@FILE only
UNSHIPPED = {"rengarajan2017": "unshutter.estimators.methods.rengarajan2017:Rengarajan2017"}


@lru_cache(maxsize=4)
def load(name: str = DEFAULT) -> Estimator:
    """The estimator of that name, ready to be used for any number of photos; built once per process.

    Args:
        name: one of ``ESTIMATORS``; NAME@FILE runs it, or one of ``UNSHIPPED``, with the weights (ONNX) in a
            file, say of a network of your own.

    Raises:
        UsageError: no estimator has this name, or it takes no weights.
        UnshutterError: the weights cannot be used.
    """
    check_name(name)
    name, _, weights = name.partition("@")
    module, _, class_name = (ESTIMATORS | UNSHIPPED)[name].partition(":")
    kind = getattr(import_module(module), class_name)
    if not weights:
        return kind()
    if "weights" not in signature(kind).parameters:
        raise UsageError(f"estimator '{name}' has no weights that could be others: leave out @{weights}")
    if not Path(weights).is_file():
        raise UnshutterError(f"cannot read weights {weights}: no such file")
    estimator = kind(weights)
    getattr(estimator, "prepare", lambda: None)()  # what is wrong with the file is told here
    return estimator


def check_name(name: str) -> None:
    """Passes for the name of an estimator, or NAME@FILE.

    Raises:
        UsageError: no estimator has this name.
    """
    own, _, weights = name.partition("@")
    if own in UNSHIPPED and not weights:
        raise UsageError(f"no weights of {own} are shipped: train it (docs/training) and say {own}@FILE.onnx")
    if own not in ESTIMATORS and own not in UNSHIPPED:
        raise UsageError(f"unknown estimator '{name}': choose one of {', '.join(ESTIMATORS)}")


__all__ = ["DEFAULT", "ESTIMATORS", "Estimator", "View", "check_name", "load"]
