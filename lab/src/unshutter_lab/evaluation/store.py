"""Stores the records of a run on disc as they are measured, so that an interrupted run can be resumed."""

from __future__ import annotations

import hashlib
import json
import os
from functools import cache
from pathlib import Path
from typing import Any

import unshutter
import unshutter_lab
from unshutter.errors import UnshutterError, UsageError
from unshutter.storage.places import write_place
from unshutter.storage.plain_files import add_text
from unshutter_lab.evaluation.cases.case import Record

_NAME = "records.jsonl"
_DIGITS = 5
_CALIBRATION = "calibration.json"


class Store:
    """A file with the settings of the run in its first line, then one JSON line per case and estimator.

    Args:
        folder: created if missing.
        settings: everything that affects the figures except the code, whose digest is added.
        overwrite: whether records from other settings or code may be discarded.
        calibrated: whether the figures depend on the shipped calibration.

    Raises:
        UsageError: the folder holds another run.
        UnshutterError: the folder is not writable.
    """

    def __init__(self, folder: Path, settings: dict[str, Any], overwrite: bool, calibrated: bool = True):
        self._path = folder / _NAME
        self._done: dict[tuple[str, str], list[Record]] = {}
        head = {"settings": settings, "code": code_digest(calibrated)}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not self._resumed(head, overwrite):
                write_place(f"{json.dumps(head)}\n".encode(), self._path)
        except OSError as error:
            raise UnshutterError(f"cannot write to folder {folder}: {error.strerror}") from None

    def missing(self, key: str, names: list[str]) -> list[str]:
        """Returns the names that have no records for a case yet."""
        return [name for name in names if (key, name) not in self._done]

    def add(self, key: str, names: list[str], records: list[Record]) -> None:
        """Writes the records of a case to disc.

        Raises:
            UnshutterError: they cannot be written.
        """
        lines = ""
        for name in names:
            own = [_rounded(record) for record in records if record["estimator"] == name]
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
        if (head_of_file := _parsed(lines[0]) if lines else None) != head:
            if head_of_file is None and lines and not overwrite:
                raise UsageError(f"{self._path} is not the record of a run: choose another --output, or --overwrite it")
            if head_of_file is not None and not overwrite:
                other = "settings" if head_of_file.get("settings") != head["settings"] else "code"
                raise UsageError(
                    f"{self._path.parent} holds a run with other {other}: choose another --output, or --overwrite it"
                )
            return False
        whole = [record for line in lines[1:] if (record := _parsed(line))]
        self._done = {(record["key"], record["estimator"]): record["records"] for record in whole}
        if len(whole) < len(lines) - 1:  # the run was killed in the middle of a line
            rest = [json.dumps(record) for record in (head, *whole)]
            write_place("".join(f"{line}\n" for line in rest).encode(), self._path)
        return True


@cache
def code_digest(calibrated: bool = True) -> str:
    """Returns the digest of the code and weights of both distributions, which distinguishes old records from new ones.

    Args:
        calibrated: whether to include the shipped calibration.
    """
    digest = hashlib.sha256()
    for root in (Path(unshutter.__file__).parent, Path(unshutter_lab.__file__).parent):
        for path in sorted(root.rglob("*")):
            if path.suffix in (".py", ".npz", ".onnx") or (calibrated and path.name == _CALIBRATION):
                digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _rounded(record: Record) -> Record:
    """Rounds off the last digits, which vary with threads and processors."""
    return {key: round(value, _DIGITS) if isinstance(value, float) else value for key, value in record.items()}


def _parsed(line: str) -> dict | None:
    try:
        value = json.loads(line)
    except ValueError:
        return None
    return value if isinstance(value, dict) else None
