"""GPMF, the telemetry of GoPro's cameras: its entries, and the angular rates and acceleration in a clip's file.

An entry is a key of four letters, a type, the size of a value, their number, and the values, which may be entries.
A packet of the track holds the samples of about a second, in a stream for each sensor with its scale, the number of
samples so far (TSMP), often a clock (TICK [ms] or STMP [us]) and the axes (ORIN to ORIO, or MTRX).

Source: gopro/gpmf-parser, README (keys, types, units).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.photo.boxes import inside
from unshutter.video.file.mp4 import Chunk, Movie, NotPlainError

_HEAD = 8  # bytes of an entry before its values
_NESTED = b"\0"  # type of entries that hold entries
_KINDS = {
    **{b"b": ">i1", b"B": ">u1", b"s": ">i2", b"S": ">u2", b"l": ">i4", b"L": ">u4"},
    **{b"j": ">i8", b"J": ">u8", b"f": ">f4", b"d": ">f8"},
}
_CLOCKS = {b"STMP": 1e-6, b"TICK": 1e-3}  # their units [s]


class DamagedLogError(UnshutterError):
    """A gyro log of which nothing can be read."""


class Entry(NamedTuple):
    """An entry of GPMF."""

    key: bytes  # four letters
    kind: bytes  # type of the values
    size: int  # bytes of a value, which may consist of several numbers
    content: bytes  # the values

    @property
    def numbers(self) -> np.ndarray:
        """The values [N, numbers of each]; raises ValueError if they are not numbers."""
        kind = np.dtype(_KINDS.get(self.kind, "V1"))
        if kind.kind == "V" or not self.size or self.size % kind.itemsize:
            raise ValueError("not numbers")
        return np.frombuffer(self.content, kind).reshape(-1, self.size // kind.itemsize).astype(np.float64)


def entries(data: bytes, deepest: int = 8) -> Iterator[Entry]:
    """Yields the entries that hold values, at whatever depth, up to the first that is cut off."""
    for entry in _level(data):
        if entry.kind != _NESTED:
            yield entry
        elif deepest:
            yield from entries(entry.content, deepest - 1)


def _level(data: bytes) -> Iterator[Entry]:
    at = 0
    while at + _HEAD <= len(data):
        key, kind, size, many = struct.unpack_from(">4scBH", data, at)
        length = size * many
        if at + _HEAD + length > len(data):
            return
        yield Entry(key, kind, size, data[at + _HEAD : at + _HEAD + length])
        at += _HEAD + length + -length % 4


def packets(movie: Movie) -> Iterator[tuple[Chunk, bytes]]:
    """Yields the packets of a file's GPMF tracks, with their place and time: the file's, as its edit lists say."""
    for track in movie.tracks:
        if track.sample_kind == b"gpmd":
            begin_s = track.begin_s(movie.timescale)
            for packet in track.packets()[:100_000]:
                shown = packet._replace(at_s=packet.at_s + begin_s)
                yield shown, movie.read_at(packet.start, min(packet.size, 1 << 22))


def settings(movie: Movie) -> dict[bytes, bytes]:
    """Returns the camera's settings in a clip's file, which stand outside the track, by their keys."""
    for name, content in movie.others:
        for inner, data in inside(content) if name == b"udta" else ():
            if inner == b"GPMF":
                return {entry.key: entry.content for entry in entries(data)}
    return {}


# ---- gyro and acceleration ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Telemetry:
    """What a GoPro measured; the three axes are right-handed, in any orientation relative to the picture."""

    rates: np.ndarray  # [N, 4] time [s] on the clip's clock, and angular rate [rad/s]
    force: np.ndarray  # [M, 4] time [s] and acceleration [m/s^2]; may be empty


def telemetry_of(path: str | Path) -> Telemetry | None:
    """Reads the gyro log in a GoPro's clip; returns None if there is none, or only a second.

    Raises:
        DamagedLogError: there is a log, but nothing in it can be read.
        NotPlainError: the file is not a whole MP4 or QuickTime file.
    """
    gyro = _Sensor(b"GYRO")
    force = _Sensor(b"ACCL")
    with open(path, "rb") as stream:
        try:
            movie = Movie.read(stream)
            for packet, data in packets(movie):
                for sensor in (gyro, force):
                    sensor.add(packet.at_s, data)
        except (KeyError, struct.error, IndexError, ValueError) as error:  # also NotPlainError
            raise NotPlainError(str(error)) from None
    rates = gyro.samples()
    if not len(rates) and not gyro.damaged:
        return None
    if not len(rates):
        raise DamagedLogError(f"{path}: the gyro log in the clip is damaged; {{--gyro}} off ignores it")
    return Telemetry(rates, force.samples())


class _Block(NamedTuple):
    """The samples of one packet."""

    at_s: float  # time of the packet in its track [s]
    first: int  # number of samples before them
    clock_s: float | None  # the camera's clock [s]
    values: np.ndarray  # [n, 3] in the units of the sensor


class _Sensor:
    """Collects the samples of one sensor from the packets of a clip."""

    def __init__(self, key: bytes) -> None:
        self.key = key
        self.damaged = 0
        self.blocks: list[_Block] = []
        self._next = 0  # number of samples so far

    def add(self, at_s: float, data: bytes) -> None:
        """Adds the samples of a packet; one that cannot be read only counts as damaged."""
        stream = _stream(data, self.key)
        if stream is None:
            self.damaged += self.key in data
            return
        try:
            values = _values(stream, self.key)
        except ValueError:
            self.damaged += 1
            return
        first = self._next
        total = _first(stream, b"TSMP")
        if total is not None and (not self.blocks or 0 <= total - len(values) - first <= 1_000_000):
            first = int(total) - len(values)
        clock = next(
            (unit * value for key, unit in _CLOCKS.items() if (value := _first(stream, key)) is not None), None
        )
        self.blocks.append(_Block(at_s, first, clock, values))
        self._next = first + len(values)

    def samples(self) -> np.ndarray:
        """Returns times [s] and values [N, 4]; the times are even, as those of a sensor are."""
        if len(self.blocks) < 2:
            return np.zeros((0, 4))
        first = self.blocks[0]
        last = self.blocks[-1]
        many = last.first - first.first
        step = (last.at_s - first.at_s) / many
        if first.clock_s is not None and last.clock_s is not None:
            by_clock = (last.clock_s - first.clock_s) / many
            step = by_clock if abs(by_clock - step) <= 0.02 * step else step
        numbers = np.concatenate([np.arange(len(block.values)) + block.first - first.first for block in self.blocks])
        values = np.concatenate([block.values for block in self.blocks])
        return np.column_stack([first.at_s + step * numbers, values])


def _stream(data: bytes, key: bytes) -> dict[bytes, Entry] | None:
    """Returns the entries of the first stream in a packet that holds samples of a sensor."""
    for device in _level(data):
        for stream in _level(device.content) if device.key == b"DEVC" else ():
            found = {entry.key: entry for entry in _level(stream.content)} if stream.key == b"STRM" else {}
            if key in found:
                return found
    return None


def _first(stream: dict[bytes, Entry], key: bytes) -> float | None:
    """Returns the first number of an entry; None if there is none."""
    with suppress(KeyError, ValueError, IndexError):
        return float(stream[key].numbers[0, 0])
    return None


def _values(stream: dict[bytes, Entry], key: bytes) -> np.ndarray:
    """Returns a sensor's samples [n, 3] in its unit, about right-handed axes; raises ValueError if they are damaged."""
    values = stream[key].numbers
    scale = stream[b"SCAL"].numbers.ravel() if b"SCAL" in stream else np.ones(1)
    if values.shape[1] != 3 or not len(values) or scale.size not in (1, 3) or not scale.all():
        raise ValueError("not three axes, or no scale")
    return (values / scale) @ _axes(stream).T


def _axes(stream: dict[bytes, Entry]) -> np.ndarray:
    """Returns the rotation [3, 3] from the stored axes to the camera's; a reflection would be damage."""
    axes = np.eye(3)
    if b"MTRX" in stream:
        axes = stream[b"MTRX"].numbers.reshape(3, 3)
    elif {b"ORIN", b"ORIO"} <= set(stream):
        stored, wanted = (stream[key].content[:3].decode("latin-1") for key in (b"ORIN", b"ORIO"))
        sign = [[(a == b) - (a == b.swapcase()) for b in stored] for a in wanted]  # lower case: the other way
        axes = np.array(sign, np.float64)
    if not np.allclose(axes @ axes.T, np.eye(3), atol=1e-3) or np.linalg.det(axes) < 0:
        raise ValueError("not a rotation")
    return axes
