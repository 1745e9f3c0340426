"""Runs a calibration: measures all cases in several processes, fits, and writes the file with its provenance."""

from __future__ import annotations

import hashlib
import json
import platform
import subprocess
from collections.abc import Sequence
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.single.prior import NORMAL, MotionKind
from unshutter.single.search import PX, displacement
from unshutter.storage.files import write_file
from unshutter.storage.locations import RunFiles
from unshutter.version import lab
from unshutter_lab.calibration.cases import (
    CROP,
    CROPPED,
    CROPS,
    DRAWN,
    FRAME,
    MOVED,
    STILL,
    WHOLE,
    FrameSearchCase,
    NetworkCase,
    OrdinarySearchCase,
    SearchCase,
    SyntheticSearchCase,
    fit_motion_kinds,
    fit_network_errors,
    scales_and_correlations,
)
from unshutter_lab.evaluation.pair_cases import logs_in, photos_in, pictures_in
from unshutter_lab.evaluation.results import Store, code_digest
from unshutter_lab.evaluation.run import check_jobs, measure
from unshutter_lab.evaluation.synthetic import SyntheticCase

FILE, REPORT = "calibration.json", "report.txt"
# folders in the data folder
NETWORK, PRIOR, ORDINARY, LOGS, CLIPS = "val", "train", "ordinary", "trajectories", "clips"
_RATIO = "readout_ratio.txt"  # holds a clip's readout time in frame intervals
_MIN_ERRORS = 12  # estimates of the network: twice the number of its coefficients
_LIBRARIES = ("numpy", "opencv-python-headless", "pyvips", "scikit-learn", "scipy")
_NAME = "calibration"  # stands for the estimator in the store

Clip = tuple[tuple[Path, ...], float]  # frames and readout ratio


def calibrate(
    data: Path, output: Path, photos: int | None = None, seed: int = 0, jobs: int | None = None, overwrite: bool = False
) -> Path:
    """Measures all parts of the default method except its network; returns the path of the file.

    For the parameters see CalibrateArguments. Photos in ``val`` are for the network's errors, those in ``train`` for
    the prior. The file does not depend on the number of processes.
    """
    check_jobs(jobs)
    _check_libraries()
    folders = {name: photos_in(data / name, photos, seed) for name in (NETWORK, PRIOR, ORDINARY)}
    logs = logs_in(data / LOGS)
    clips = _clips(data / CLIPS)
    inputs = {**folders, LOGS: logs, CLIPS: [*chain.from_iterable(frames for frames, _ in clips)]}
    RunFiles(reads=chain.from_iterable(inputs.values())).check_all_in(output)
    digests = {name: _digest(paths) for name, paths in inputs.items()}
    store = Store(output, {"data": digests, "photos": photos, "seed": seed}, overwrite, calibrated=False)

    known = {
        "kinds": {kind.name: _as_fields(kind) for kind in fit_motion_kinds(logs, seed)},
        "network_errors": _network_errors(_synthetic(NETWORK, folders[NETWORK], DRAWN, seed, logs), store, jobs),
    }
    cases = _search_cases(folders, clips, seed, logs, json.dumps(known))
    usable = measure(cases, [_NAME], store, jobs)
    sections, report = _fits(store.records([case.key for case in usable], [_NAME]))
    counts = {name: {"photos": len(paths), "sha256": digests[name]} for name, paths in folders.items()}
    counts |= {name: {"files": len(inputs[name]), "sha256": digests[name]} for name in (LOGS, CLIPS) if inputs[name]}
    fields = {"provenance": _provenance(counts, len(usable), photos, seed), **known, **sections}
    write_file(as_text(fields).encode(), output / FILE)
    write_file(report.encode(), output / REPORT)
    return output / FILE


def _check_libraries() -> None:
    try:
        import sklearn  # noqa: F401
    except ImportError as error:
        raise UnshutterError(f"calibrate needs the extra: {lab('calibrate')} ({error})") from None


def _as_fields(kind: MotionKind) -> dict[str, Any]:
    scales, correlations = scales_and_correlations(kind.scale)
    freedom = None if kind.freedom == NORMAL else kind.freedom
    fields = {"share": kind.share, "freedom": freedom, "scales": scales.tolist()}
    return {**fields, "correlations": correlations.tolist()}


def _network_errors(photos: list[SyntheticCase], store: Store, jobs: int | None) -> dict[str, Any]:
    usable = measure([NetworkCase(photo) for photo in photos], [_NAME], store, jobs)
    records = store.records([case.key for case in usable], [_NAME])
    if len(records) < _MIN_ERRORS:
        raise UnshutterError(f"the network answers to {len(records)} pictures of {NETWORK}: add photos of buildings")
    answers, truths = (np.array([record[name] for record in records]) for name in ("answer", "truth"))
    sizes = np.array([PX * displacement(answer) for answer in answers])
    errors = fit_network_errors(answers - truths, sizes)
    matrices = {"scales": errors.scales.tolist(), "correlations": errors.correlations.tolist()}
    return {"freedom": errors.freedom, "usual_px": errors.usual_px, **matrices}


def _search_cases(
    folders: dict[str, list[Path]], clips: list[Clip], seed: int, logs: tuple[Path, ...], known: str
) -> list[SearchCase]:
    cases: list[SearchCase] = [
        SyntheticSearchCase(case.suite.name, case.photo, known, case)
        for case in _synthetic(PRIOR, folders[PRIOR], (*MOVED, *STILL, *CROPPED), seed, logs)
    ]
    for path in folders[ORDINARY]:
        crops = [OrdinarySearchCase(CROP, path.name, known, path, crop) for crop in range(CROPS)]
        cases += [OrdinarySearchCase(WHOLE, path.name, known, path, None), *crops]
    for clip, ratio in clips:
        cases += [FrameSearchCase(FRAME, clip[0].parent.name, known, clip, ratio, k) for k in range(len(clip))]
    return cases


def _clips(folder: Path) -> list[Clip]:
    """Returns the clips of a folder, if there is one."""
    clips = []
    for file in sorted(folder.glob(f"*/{_RATIO}")):
        try:
            clips.append((tuple(pictures_in(file.parent)), float(file.read_text(encoding="utf-8"))))
        except (OSError, ValueError) as error:
            raise UnshutterError(f"cannot read the readout ratio in {file}: {error}") from None
    return clips


def _synthetic(
    group: str, photos: list[Path], suites: Sequence[Any], seed: int, logs: tuple[Path, ...]
) -> list[SyntheticCase]:
    return [SyntheticCase(suite, group, path.name, path, 0, seed, logs) for path in photos for suite in suites]


def _fits(records: list[dict[str, Any]]) -> tuple[dict[str, Any], str]:
    """Returns the sections of the file, and a report on their accuracy."""
    from unshutter_lab.calibration.fits import Cases, fit

    fits = {name: fit(Cases.of(records, name), name.replace("_", " ")) for name in ("with_network", "without_network")}
    report = "\n\n".join(each for _, each in fits.values())
    return {name: fields for name, (fields, _) in fits.items()}, f"{report}\n"


def _provenance(counts: dict[str, Any], cases: int, photos: int | None, seed: int) -> dict[str, Any]:
    """Returns the inputs of the file: the same data and versions reproduce the same file."""
    given = {"made_by": "unshutter calibrate", "data": counts, "photos": photos, "cases": cases, "seed": seed}
    versions = {name: version(name) for name in ("unshutter", "unshutter-lab", *_LIBRARIES)}
    code = {"commit": _commit(), "code": code_digest(calibrated=False)}
    return {**given, **code, "versions": {"python": platform.python_version(), **versions}}


def _commit() -> str | None:
    """Returns the commit of the sources, with ", changed" if they differ from it; None outside a repository."""

    def git(*words: str) -> str:
        command = ["git", "-C", str(Path(__file__).parent), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        return git("rev-parse", "HEAD") + (", changed" if git("status", "--porcelain", ".") else "")
    except (OSError, subprocess.CalledProcessError):
        return None


def _digest(paths: Sequence[Path]) -> str:
    """Returns the digest of the contents of files, in this order."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def as_text(sections: dict[str, dict[str, Any]]) -> str:
    """Formats as JSON with one line per entry of each section."""
    parts = []
    for name, section in sections.items():
        lines = (f"  {json.dumps(key)}: {json.dumps(value, separators=(',', ':'))}" for key, value in section.items())
        parts.append(f" {json.dumps(name)}: {{\n" + ",\n".join(lines) + "\n }")
    return "{\n" + ",\n".join(parts) + "\n}\n"
