"""The results of a run: request, environment, and a record per picture and estimator; JSON and CSV.

Records are stored on disc as they are measured, so that an interrupted run can be resumed.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import unshutter
import unshutter_lab
from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import Motion
from unshutter.storage.files import add_text, write_file
from unshutter.version import __version__
from unshutter_lab.evaluation.answers import PREFIX
from unshutter_lab.evaluation.case import Case, Example, Record
from unshutter_lab.evaluation.protocols import PROTOCOLS, Request

_NAME = "records.jsonl"
_DIGITS = 5
_CALIBRATION = "calibration.json"


class Store:
    """A file with the settings of the run in its first line, then one JSON line per case and estimator.

    Args:
        folder: created if missing; must not hold another run.
        settings: everything that affects the figures except the code, whose digest is added.
        overwrite: whether records from other settings or code may be discarded.
        calibrated: whether the figures depend on the shipped calibration.
    """

    def __init__(self, folder: Path, settings: dict[str, Any], overwrite: bool, calibrated: bool = True):
        self._path = folder / _NAME
        self._done: dict[tuple[str, str], list[Record]] = {}
        head = {"settings": settings, "code": code_digest(calibrated)}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not self._resumed(head, overwrite):
                write_file(f"{json.dumps(head)}\n".encode(), self._path)
        except OSError as error:
            raise UnshutterError(f"cannot write to folder {folder}: {error.strerror}") from None

    def missing(self, key: str, names: list[str]) -> list[str]:
        """Returns the names that have no records for a case yet."""
        return [name for name in names if (key, name) not in self._done]

    def add(self, key: str, names: list[str], records: list[Record]) -> None:
        """Writes the records of a case to disc."""
        lines = ""
        for name in names:
            own = [record for record in records if record["estimator"] == name]
            # without the last digits, which vary with threads and processors
            own = [{k: round(v, _DIGITS) if isinstance(v, float) else v for k, v in each.items()} for each in own]
            self._done[key, name] = own
            lines += json.dumps({"key": key, "estimator": name, "records": own}) + "\n"
        add_text(self._path, lines)

    def records(self, keys: list[str], names: list[str]) -> list[Record]:
        """Returns the records of these cases and names, in this order."""
        return [r for key in keys for name in names for r in self._done.get((key, name), [])]

    def _resumed(self, head: dict, overwrite: bool) -> bool:
        """Reads existing records; returns False if the run starts afresh."""
        if not os.path.lexists(self._path):
            return False
        lines = self._path.read_text(encoding="utf-8", errors="replace").splitlines()
        before = _parsed(lines[0]) if lines else None
        if before != head:
            problem = f"{self._path} is not a record of a run"
            if before is not None:
                other = "settings" if before.get("settings") != head["settings"] else "code"
                problem = f"{self._path.parent} contains a run with other {other}"
            if lines and not overwrite:
                raise UsageError(f"{problem}: choose another --output, or --overwrite it")
            return False
        whole = [record for line in lines[1:] if (record := _parsed(line))]
        self._done = {(record["key"], record["estimator"]): record["records"] for record in whole}
        if len(whole) < len(lines) - 1:  # the run was killed in the middle of a line
            rest = [json.dumps(record) for record in (head, *whole)]
            write_file("".join(f"{line}\n" for line in rest).encode(), self._path)
        return True


@cache
def code_digest(calibrated: bool = True) -> str:
    """Returns the digest of both distributions' code, weights and calibration: records of other code are not used."""
    digest = hashlib.sha256()
    for root in (Path(unshutter.__file__).parent, Path(unshutter_lab.__file__).parent):
        for path in sorted(root.rglob("*")):
            if path.suffix in (".py", ".npz", ".onnx") or (calibrated and path.name == _CALIBRATION):
                digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _parsed(line: str) -> dict | None:
    try:
        value = json.loads(line)
    except ValueError:
        return None
    return value if isinstance(value, dict) else None


FORMAT = "unshutter-evaluation/1"
_LIBRARIES = ("numpy", "opencv-python-headless", "onnxruntime", "pyvips")
_EXAMPLES = (0.3, 0.55, 0.8, 0.95)  # quantiles of the pictures, ordered by distortion
_CURVE_ROWS = 33
_FORMER_NAMES = {"environment": "about", "oracles": "rivals"}  # of keys, in files of earlier versions


@dataclass(frozen=True)
class Results:
    """The data of all tables and plots."""

    request: Request  # the request of the run
    estimators: list[str]  # their names, in the order of the tables
    oracles: list[str]  # names judged along with them that know the truth or see more than one photo
    records: list[Record]  # one per picture and estimator
    environment: dict[str, str] = field(default_factory=dict)  # versions, digest of the code, and kind of machine
    # example -> name -> {"row" [0 ... 1], "tx" [px at 256 rows], "rz" [deg]}.
    curves: dict[str, dict[str, dict[str, list[float]]]] = field(default_factory=dict)

    @classmethod
    def of(cls, request: Request, estimators: list[str], oracles: list[str], records: list[Record]) -> Results:
        """Returns results measured by this process."""
        environment = {"unshutter": __version__, "code": code_digest(), "machine": platform.machine()}
        environment["python"] = platform.python_version()
        for library in _LIBRARIES:
            with suppress(PackageNotFoundError):
                environment[library] = version(library)
        return cls(request, estimators, oracles, records, environment)

    @property
    def names(self) -> list[str]:
        """Names of estimators and oracles."""
        return [*self.estimators, *self.oracles]

    @property
    def command(self) -> str:
        """The command that reproduces these figures."""
        r = self.request
        words = ["unshutter evaluate --protocol", r.protocol]
        words += ["--data", *(str(folder) for folder in r.data)] if r.data else []
        words += ["--trajectory", str(r.trajectory)] if r.trajectory else []
        words += ["--photos", str(r.photos)] if r.photos else []
        words += ["--per-photo", str(r.per_photo)] if PROTOCOLS[r.protocol].kind in ("motion", "places") else []
        words += ["--readout-ratio", *(f"{ratio:g}" for ratio in r.readout_ratio)] if r.readout_ratio else []
        answers = [name.removeprefix(PREFIX) for name in self.estimators if name.startswith(PREFIX)]
        words += ["--answers", *answers] if answers else []
        loaded = [name for name in self.estimators if not name.startswith(PREFIX)]
        return " ".join([*words, "--seed", str(r.seed), "--estimators", ",".join(loaded)])

    def with_examples(self, examples: list[Example]) -> Results:
        """Returns these results with the curves of some pictures added."""
        return replace(self, curves={e.title: {n: _curve(m) for n, m in e.curves.items()} for e in examples})

    def to_json(self) -> str:
        """Returns all results as JSON."""
        data = {"format": FORMAT, "command": self.command, **asdict(self)}
        return json.dumps(data, default=str, allow_nan=False)

    @classmethod
    def load(cls, path: Path) -> Results:
        """Reads the file written by :meth:`to_json`."""
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            request: dict[str, Any] = data["request"]
            request["data"] = tuple(Path(p) for p in request["data"])
            request["readout_ratio"] = tuple(request.get("readout_ratio", ()))
            request["trajectory"] = Path(request["trajectory"]) if request["trajectory"] else None
            data |= {name: data[former] for name, former in _FORMER_NAMES.items() if former in data}
            known = {key: data[key] for key in ("estimators", "oracles", "records", "environment", "curves")}
            return cls(Request(**request), **known)
        except OSError as error:
            raise UnshutterError(f"cannot read results {path}: {error.strerror}") from None
        except (ValueError, KeyError, TypeError):
            raise UnshutterError(f"{path} contains no results of unshutter evaluate") from None

    def to_csv(self) -> str:
        """Returns the records as CSV, one per line."""
        return pd.DataFrame(self.records, dtype=object).to_csv(index=False, lineterminator="\n")

    @cached_property
    def frame(self) -> Any:
        """The records, one per row (pandas.DataFrame)."""
        return pd.DataFrame(self.records)

    def chosen(self, **criteria: str) -> Any:
        """Returns the records with these values (suite, group, estimator) (pandas.DataFrame)."""
        return self.frame[(self.frame[list(criteria)] == pd.Series(criteria, dtype=object)).all(axis=1)]

    def values(self, key: str, **criteria: str) -> np.ndarray:
        """Returns one figure of the records with these values, where known."""
        return self.chosen(**criteria)[key].dropna().to_numpy(np.float64)

    def distinct(self, key: str) -> list[str]:
        """Returns the distinct values of a key, in the order of the records."""
        return self.frame[key].unique().tolist()


def examples_of(cases: list[Case], records: list[Record]) -> list[Case]:
    """Returns a few cases to show, from little to much distortion; the first few if the distortion is unknown."""
    pictures: Any = pd.DataFrame(records).drop_duplicates(["suite", "group", "photo", "draw"])
    if "epe_nothing" not in pictures or len(pictures) != len(cases) or pictures["epe_nothing"].isna().any():
        return cases[: len(_EXAMPLES)]
    order = np.argsort(pictures["epe_nothing"].to_numpy(), kind="stable")
    return list(dict.fromkeys(cases[order[int(share * (len(order) - 1))]] for share in _EXAMPLES))


def _curve(motion: Motion) -> dict[str, list[float]]:
    rows = np.linspace(0, motion.height - 1, _CURVE_ROWS)
    known = np.arange(motion.height)
    tx, rz = np.interp(rows, known, motion.tx_px) * 256 / motion.height, np.interp(rows, known, motion.rz_rad)
    share = np.linspace(0, 1, _CURVE_ROWS)
    return {"row": share.tolist(), "tx": tx.round(3).tolist(), "rz": np.degrees(rz).round(4).tolist()}
