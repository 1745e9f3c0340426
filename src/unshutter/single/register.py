"""The register of methods by name, and the list of ``unshutter models``.

It does not import the methods, so that decoding a photo can start first.

A package of your own can add a method: its entry point in the group ``unshutter.estimators`` names a :class:`Method`::

    [project.entry-points."unshutter.estimators"]
    tilted = "my_package:TILTED"
"""

from __future__ import annotations

import json
import os
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter import version
from unshutter.errors import MissingFileError, UnshutterError, UsageError, shortened
from unshutter.options import DEFAULT_ESTIMATOR
from unshutter.progress import in_columns
from unshutter.single import Method
from unshutter.storage.opened import Opened

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from unshutter.single.estimator import Estimator


_GROUP = "unshutter.estimators"
_WEIGHTS = Path(__file__).parents[1] / "weights"  # importlib.resources gives the same path but takes 10 ms to import
_SCORES = _WEIGHTS / "scores.json"  # written with docs/results, never by hand

METHODS = (
    Method(
        "segment-transformer",
        "line segments of the photo -> a small transformer -> row motion",
        "unshutter.single.methods:SegmentTransformer",
        grey_px=512,
        weights=_WEIGHTS / "segment-transformer.npz",
        takes_weights=True,
        scores=_SCORES,
    ),
    Method(
        "segment-manhattan",
        "segment-transformer's answer and the Manhattan likelihood, weighed against each other",
        "unshutter.single.methods:SegmentManhattan",
        grey_px=768,
        weights=_WEIGHTS / "segment-transformer.npz",
        takes_weights=True,
        scores=_SCORES,
    ),
    Method(
        "manhattan",
        "line segments -> motion, camera and focal length that make them straight and square; no learning",
        "unshutter.single.methods:Manhattan",
        grey_px=768,
        scores=_SCORES,
    ),
    Method(
        "kandula2020",
        "the paper's network on the central square of the photo -> row motion; always an answer, without a confidence",
        "unshutter.single.row_network:Kandula2020",
        weights=_WEIGHTS / "kandula2020.onnx",
        takes_weights=True,
        scores=_SCORES,
    ),
    Method(
        "none",
        "leaves photos unchanged: the baseline of every table",
        "unshutter.single.methods:DoNothing",
        scores=_SCORES,
    ),
)


def names() -> list[str]:
    """Returns the names of all methods: the package's own, then those of other installed packages."""
    built_in = [known.name for known in METHODS]
    return built_in + sorted(version.plugins(_GROUP).names - {known.name for known in METHODS})


def method(name: str) -> Method:
    """Returns the method with that name, or of NAME@FILE; the package's own methods take precedence."""
    name = name.partition("@")[0]
    for known in METHODS:
        if known.name == name:
            return known
    entry = next(iter(version.plugins(_GROUP).select(name=name)), None)
    if entry is None:
        raise UsageError(f"unknown estimator '{shortened(name)}': {version.choices(name, names(), _GROUP)}")
    return _loaded(entry)


def check_name(name: str) -> None:
    """Checks the name of a method, or NAME@FILE."""
    own, _, weights = name.partition("@")
    entry = method(own)
    if weights and not entry.takes_weights:
        raise UsageError(f"estimator '{own}' accepts no other weights: leave out @{weights}")


def weights_file(name: str) -> Path | None:
    """Returns the file of NAME@FILE, or None for a name alone."""
    _, _, weights = name.partition("@")
    return Path(weights) if weights else None


def load(name: str = DEFAULT_ESTIMATOR) -> Estimator:
    """Returns the estimator with that name, ready for any number of photos; built once per process.

    Args:
        name: one of :func:`names`, or NAME@FILE to run it with your own weights from a training run (.npz; ONNX
            for unshutter-lab's networks).

    Raises:
        UsageError: there is no such method, or it takes no weights.
        UnshutterError: the weights cannot be used, or the package providing the method is broken.

    Examples:
        >>> estimator = unshutter.load("manhattan")  # built once, for many photos
        >>> unshutter.rectify("street.jpg", estimator=estimator).changed
        True
    """
    check_name(name)
    own, _, weights = name.partition("@")
    if weights and not os.path.isfile(weights):
        raise MissingFileError(f"cannot read weights {weights}: no such file")
    return _built(own, Opened.at(weights) if weights else None)


@lru_cache(maxsize=4)
def _built(own: str, file: Opened | None) -> Estimator:
    """Builds an estimator, once for each file of weights, and again when the file is replaced."""
    entry = method(own)
    estimator = _class_of(entry)(entry, file.path if file else entry.weights)
    if file:
        estimator.prepare()  # rejects a bad file here rather than at the first photo
    return estimator


def _class_of(entry: Method) -> type[Estimator]:
    from unshutter.single.estimator import Estimator  # not at the top: it imports NumPy

    module, _, name = entry.home.partition(":")
    kind = getattr(import_module(module), name, None)
    if not (isinstance(kind, type) and issubclass(kind, Estimator)):
        raise UnshutterError(f"cannot load estimator '{entry.name}': {entry.home} is not an Estimator")
    return kind


def _loaded(point: EntryPoint) -> Method:
    """Loads the method that another package's entry point names."""
    failure = f"cannot load the installed estimator '{point.name}'"
    try:
        entry = point.load()
    except Exception as error:  # another package's import may raise anything
        raise UnshutterError(" ".join(f"{failure}: {type(error).__name__}: {error}".split())) from None
    if not isinstance(entry, Method) or entry.name != point.name:
        raise UnshutterError(f"{failure}: {point.value} is not a Method of that name")
    return entry


# below the table of methods and their scores
_EXPLANATION = """\
weights: size of the file that was learned. Then, for each set of photos that we distorted: the median error that is
left, in px of a picture 256 rows high (none: the error before), and the share of the photos that got better.
The default helps fewer photos than some: it leaves those of which it is not sure, which count as not better. In return,
it rarely bends a photo that was right; methods that change every photo do (docs/results/undistorted.md).\
""".splitlines()


def describe_methods() -> str:
    """Lists all methods that can be used without further files, the default first, and explains the figures."""
    known = [method(name) for name in sorted(names(), key=lambda name: name != DEFAULT_ESTIMATOR)]
    by_file = {each.scores: json.loads(each.scores.read_text(encoding="utf-8")) for each in known if each.scores}
    # set of photos -> figures
    scores = {each.name: by_file[each.scores].get(each.name, {}) if each.scores else {} for each in known}
    places = list(dict.fromkeys(place for each in scores.values() for place in each))  # sets of photos
    rows = [["name", "weights", *places]]
    for each in known:
        size = f"{each.weights.stat().st_size / 1e6:.1f} MB" if each.weights else "-"
        own = [scores[each.name].get(place) for place in places]
        figures = [f"{s['epe_median']:.2f} {100 * s['improved']:.0f} %" if s else "-" for s in own]
        rows.append([each.name, size, *figures])
    lines = [in_columns(rows)]
    if places:
        lines += ["", *_EXPLANATION]
    lines.append("")
    for each in known:
        lines.append(f"{each.name}{' (default)' if each.name == DEFAULT_ESTIMATOR else ''}: {each.summary}")
    return "\n".join(lines)
