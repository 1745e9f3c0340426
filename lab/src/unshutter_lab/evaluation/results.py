"""The results of a run: request, environment, and a record per picture and estimator; JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
import platform
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion import Motion
from unshutter.version import __version__
from unshutter_lab.evaluation.cases.case import Case, Example, Record
from unshutter_lab.evaluation.cases.protocols import PROTOCOLS, Request
from unshutter_lab.evaluation.store import code_digest

FORMAT = "unshutter-evaluation/1"
_LIBRARIES = ("numpy", "opencv-python-headless", "onnxruntime", "pyvips")
_EXAMPLES = (0.3, 0.55, 0.8, 0.95)  # quantiles of the pictures, ordered by distortion
_CURVE_ROWS = 33
_FORMER_NAMES = {"environment": "about", "oracles": "rivals"}  # of keys, in files of earlier versions


def _versions() -> dict[str, str]:
    """Returns versions of the libraries that affect figures; those not installed are omitted."""
    versions = {}
    for name in _LIBRARIES:
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


@dataclass(frozen=True)
class Results:
    """The data of all tables and plots.

    Attributes:
        request: the request of the run.
        estimators: their names, in the order of the tables.
        oracles: names judged along with them that know the truth or see more than one photo.
        records: one per picture and estimator.
        environment: versions, digest of the code, and kind of machine.
        curves: example -> name -> {"row" [0 ... 1], "tx" [px at 256 rows], "rz" [deg]}.
    """

    request: Request
    estimators: list[str]
    oracles: list[str]
    records: list[Record]
    environment: dict[str, str] = field(default_factory=dict)
    curves: dict[str, dict[str, dict[str, list[float]]]] = field(default_factory=dict)

    @classmethod
    def of(cls, request: Request, estimators: list[str], oracles: list[str], records: list[Record]) -> Results:
        """Returns results measured by this process."""
        environment = {"unshutter": __version__, "code": code_digest(), "machine": platform.machine()}
        environment |= {"python": platform.python_version(), **_versions()}
        return cls(request, estimators, oracles, records, environment)

    @property
    def names(self) -> list[str]:
        """Names of estimators and oracles."""
        return [*self.estimators, *self.oracles]

    @property
    def command(self) -> str:
        """The command that reproduces these figures."""
        r = self.request
        words = ["unshutter evaluate --protocol", r.protocol, "--data", *(str(folder) for folder in r.data)]
        words += ["--trajectory", str(r.trajectory)] if r.trajectory else []
        words += ["--photos", str(r.photos)] if r.photos else []
        words += ["--per-photo", str(r.per_photo)] if PROTOCOLS[r.protocol].kind == "motion" else []
        words += ["--readout-ratio", *(f"{ratio:g}" for ratio in r.readout_ratio)] if r.readout_ratio else []
        return " ".join([*words, "--seed", str(r.seed), "--estimators", ",".join(self.estimators)])

    def with_examples(self, examples: list[Example]) -> Results:
        """Returns these results with the curves of some pictures added."""
        return replace(self, curves={e.title: {n: _curve(m) for n, m in e.curves.items()} for e in examples})

    def to_json(self) -> str:
        """Returns all results as JSON."""
        data = {"format": FORMAT, "command": self.command, **asdict(self)}
        return json.dumps(data, default=str, allow_nan=False)

    @classmethod
    def load(cls, path: Path) -> Results:
        """Reads the file written by :meth:`to_json`.

        Raises:
            UnshutterError: the file cannot be read or does not contain results.
        """
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
            raise UnshutterError(f"{path} holds no results of unshutter evaluate") from None

    def to_csv(self) -> str:
        """Returns the records as CSV, one per line."""
        columns = list(dict.fromkeys(key for record in self.records for key in record))
        stream = io.StringIO()
        writer = csv.DictWriter(stream, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.records)
        return stream.getvalue()

    def values(self, key: str, **criteria: str) -> np.ndarray:
        """Returns one figure of the records with these values (suite, group, estimator), where known."""
        return values(self.chosen(**criteria), key)

    def chosen(self, **criteria: str) -> list[Record]:
        """Returns the records with these values."""
        return [r for r in self.records if all(r[k] == v for k, v in criteria.items())]

    def distinct(self, key: str) -> list[str]:
        """Returns the distinct values of a key, in the order of the records."""
        return list(dict.fromkeys(r[key] for r in self.records))


def values(records: Iterable[Record], key: str) -> np.ndarray:
    """Returns one figure of each record that has it, as an array."""
    return np.array([r[key] for r in records if r.get(key) is not None], dtype=np.float64)


def examples_of(cases: list[Case], records: list[Record]) -> list[Case]:
    """Returns a few cases to show, from little to much distortion; the first few if the distortion is unknown."""
    distortion = {}  # picture -> EPE without correction
    for record in records:
        picture = (record["suite"], record["group"], record["photo"], record["draw"])
        distortion.setdefault(picture, record.get("epe_nothing"))
    if len(distortion) != len(cases) or None in distortion.values():
        return cases[: len(_EXAMPLES)]
    order = np.argsort(list(distortion.values()), kind="stable")
    return list(dict.fromkeys(cases[order[int(share * (len(order) - 1))]] for share in _EXAMPLES))


def _curve(motion: Motion) -> dict[str, list[float]]:
    rows = np.linspace(0, motion.height - 1, _CURVE_ROWS)
    known = np.arange(motion.height)
    tx, rz = np.interp(rows, known, motion.tx_px) * 256 / motion.height, np.interp(rows, known, motion.rz_rad)
    share = np.linspace(0, 1, _CURVE_ROWS)
    return {"row": share.tolist(), "tx": tx.round(3).tolist(), "rz": np.degrees(rz).round(4).tolist()}
