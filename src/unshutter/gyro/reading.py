"""Reads gyro logs from files: Gyroflow's .gcsv directly, logs of cameras and flight controllers by telemetry-parser."""

from __future__ import annotations

import os
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.gyro.log import GRAVITY, GyroLog
from unshutter.storage.plain_files import check_plain

_HEADS = ("GYROFLOW IMU LOG", "CAMERA IMU LOG")  # first lines of .gcsv files
_LARGEST = 1 << 30  # bytes
_LONGEST_HEAD = 100  # lines


def log_of_file(path: str | os.PathLike[str]) -> GyroLog:
    """Reads a log from a file next to its clip.

    Raises:
        UnshutterError: the file cannot be read, or contains no log.
    """
    place = Path(path)
    try:
        check_plain(place)
        if place.stat().st_size > _LARGEST:
            raise UnshutterError(f"{place} is too large for a gyro log")
        with place.open("rb") as stream:
            is_gcsv = stream.readline(200).strip().decode("utf-8", "replace").upper() in _HEADS
        if is_gcsv:
            return _gcsv(place.name, place.read_text("utf-8", "replace").splitlines())
    except OSError as error:
        raise UnshutterError(f"cannot read gyro log {place}: {error.strerror}") from None
    log = log_by_parser(place)
    if log is None:
        raise UnshutterError(f"{place}: no gyro log that can be read; Gyroflow's .gcsv logs always can")
    return log


def log_by_parser(path: str | os.PathLike[str]) -> GyroLog | None:
    """Reads the gyro log in a clip or a logger's file by telemetry-parser; None if there is no log or no parser."""
    try:
        telemetry_parser = import_module("telemetry_parser")  # an extra without wheels for some Python versions
    except ImportError:
        return None
    try:
        parser = telemetry_parser.Parser(os.fspath(path))
        samples = parser.normalized_imu()
        name = " ".join(filter(None, (parser.camera, parser.model)))
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException:  # panics of its Rust code are not Exceptions
        return None
    turns = [(sample["timestamp_ms"], *sample["gyro"]) for sample in samples if sample.get("gyro")]
    forces = [(sample["timestamp_ms"], *sample["accl"]) for sample in samples if sample.get("accl")]
    if not turns:
        return None
    turned, force = np.array(turns, np.float64), np.array(forces, np.float64).reshape(-1, 4)
    force[:, 0] /= 1000
    try:
        return GyroLog(turned[:, 0] / 1000, np.radians(turned[:, 1:]), name, force, on_clip_clock=True)
    except UnshutterError:  # unusable, for example with too few samples
        return None


def _gcsv(name: str, lines: Iterable[str]) -> GyroLog:
    """Parses a log in Gyroflow's format: lines ``key,value``, a line that names the columns, and the samples.

    Raises:
        UnshutterError: it has no valid columns, samples or values.
    """
    told, columns, rows = {}, [], []
    for line in lines:
        words = [word.strip() for word in line.split(",")]
        if columns:
            rows.append(words)
        elif {"t", "gx", "gy", "gz"} <= {word.lower() for word in words}:
            columns = [word.lower() for word in words]
        elif len(words) > 1:
            told[words[0].lower()] = words[1]
        if not columns and len(told) > _LONGEST_HEAD:
            break
    if not columns:
        raise UnshutterError(f"{name}: no line names the log's columns (t,gx,gy,gz,...)")
    rows = [row for row in rows if len(row) == len(columns)]  # the last line may be truncated
    try:
        scale = {key: float(told.get(key, usual)) for key, usual in (("tscale", 1), ("gscale", 1), ("ascale", 1))}
        values = np.array(rows, np.float64).reshape(-1, len(columns))
        readout_ms = abs(float(told.get("frame_readout_time", 0))) or None
    except ValueError:
        raise UnshutterError(f"{name}: the log has values that are not numbers") from None
    times = values[:, columns.index("t")] * scale["tscale"]
    rates = values[:, [columns.index(key) for key in ("gx", "gy", "gz")]] * scale["gscale"]
    force = np.zeros((0, 4))
    if {"ax", "ay", "az"} <= set(columns):
        along = values[:, [columns.index(key) for key in ("ax", "ay", "az")]] * scale["ascale"] * GRAVITY
        force = np.concatenate([times[:, None], along], axis=1)
    return GyroLog(times, rates, name, force, readout_ms)
