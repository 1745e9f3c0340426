"""GPMF: a GoPro's gyro log, read as another library reads it, and what is left of a damaged one."""

import struct
from itertools import permutations, product

import numpy as np
import pytest

from support.gpmf import device, entry, nested, stream, with_samples
from support.movie_boxes import box, rebuilt, with_moov
from unshutter.video.file import gpmf

COUNTS, STEP = (200, 201, 199, 60), 0.005
VALUES = np.random.default_rng(0).integers(-3000, 3000, (sum(COUNTS), 3))
GYRO, ACCL = (entry(b"SIUN", b"c", unit) for unit in (b"rad/s", "m/s²".encode("latin-1")))


def packets(axes=(), clock=None):
    """Packets whose clock, if there is one, runs by a thousandth faster than the track."""
    data, first = [], 0
    for count in COUNTS:
        part, at_s = VALUES[first : first + count], first * STEP * 1.001
        ticks = b""
        if clock == b"TICK":
            ticks = entry(clock, b"L", struct.pack(">I", round(70_000 + 1e3 * at_s)), 4)
        elif clock == b"STMP":
            ticks = entry(clock, b"J", struct.pack(">Q", round(70_000 + 1e6 * at_s)), 8)
        gyro = stream(b"GYRO", part, 1000, ticks, (GYRO, *axes), first)
        data.append(device(gyro, stream(b"ACCL", part, 100, ticks, (ACCL, *axes), first)))
        first += count
    return data


def orientation(stored, wanted=b"ZXY"):
    return entry(b"ORIN", b"c", stored), entry(b"ORIO", b"c", wanted)


@pytest.mark.parametrize(("clock", "step"), [(None, 3 / 600), (b"TICK", 3.003 / 600), (b"STMP", 3.003 / 600)])
def test_samples_and_their_times(tmp_path, clock, step):
    found = gpmf.telemetry_of(with_samples(tmp_path / "a.mp4", b"gpmd", *packets(clock=clock)))
    assert np.allclose(found.rates[:, 1:], VALUES / 1000) and np.allclose(found.force[:, 1:], VALUES / 100)
    assert np.allclose(found.rates[:, 0], step * np.arange(len(VALUES)), atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_an_edit_list_says_when_the_log_begins(tmp_path, seed):
    """As in a clip that was cut without encoding it again: the log begins with a packet, the clip within it."""
    draw = np.random.default_rng(seed)
    wait, cut = (int(each) for each in draw.integers(0, 1500, 2))  # [ms], as the units of this file
    is_wide = seed % 2
    edits = [(wait, -1), (2000, cut), (500, 0)]
    form = ">qqi" if is_wide else ">iii"
    content = b"".join(struct.pack(form, *edit, 1 << 16) for edit in edits)
    edits_box = box(b"edts", box(b"elst", bytes([is_wide, 0, 0, 0]) + struct.pack(">I", len(edits)) + content))
    path = tmp_path / "a.mp4"
    with_samples(path, b"gpmd", *packets())
    whole = gpmf.telemetry_of(path)
    data = path.read_bytes()
    path.write_bytes(with_moov(data, lambda moov: rebuilt(moov, _with(edits_box), (b"moov",))))
    found = gpmf.telemetry_of(path)
    assert np.allclose(found.rates[:, 0], whole.rates[:, 0] + (wait - cut) / 1000)
    assert np.array_equal(found.rates[:, 1:], whole.rates[:, 1:])


def _with(edits_box):
    return lambda path, content: edits_box + content if path[-1] == b"trak" else content


def test_axes_are_those_of_another_reader(tmp_path):
    telemetry_parser = pytest.importorskip("telemetry_parser")
    read = 0
    for order, turned in product(permutations("XYZ"), product((0, 1), repeat=3)):
        stored = "".join(axis.lower() if less else axis for axis, less in zip(order, turned, strict=True)).encode()
        file = with_samples(tmp_path / "a.mp4", b"gpmd", *packets(orientation(stored), b"STMP"))
        try:
            found = gpmf.telemetry_of(file)
        except gpmf.DamagedLogError:  # a reflection
            continue
        theirs = telemetry_parser.Parser(file).normalized_imu()
        rates = [(each["timestamp_ms"] / 1000, *np.radians(each["gyro"])) for each in theirs]
        assert np.allclose(found.rates, rates, atol=1e-9, rtol=0)
        assert np.allclose(found.force[:, 1:], [each["accl"] for each in theirs])
        read += 1
    assert read == 24


def test_a_matrix_comes_before_letters(tmp_path):
    matrix = entry(b"MTRX", b"f", struct.pack(">9f", 0, 0, 1, 0, 1, 0, -1, 0, 0), 36)
    found = gpmf.telemetry_of(with_samples(tmp_path / "a.mp4", b"gpmd", *packets((*orientation(b"YxZ"), matrix))))
    assert np.allclose(found.rates[:, 1:], np.column_stack([VALUES[:, 2], VALUES[:, 1], -VALUES[:, 0]]) / 1000)


def test_a_lost_packet_leaves_a_gap_and_moves_nothing(tmp_path):
    data = packets()
    data[1] = data[1][:1000]
    found = gpmf.telemetry_of(with_samples(tmp_path / "a.mp4", b"gpmd", *data))
    whole = np.r_[0:200, 401:660]
    assert np.allclose(found.rates, np.column_stack([3 / 600 * whole, VALUES[whole] / 1000]))


def test_files_without_a_log(tmp_path):
    temperature = device(nested(b"STRM", entry(b"TMPC", b"f", struct.pack(">f", 20), 4)))
    assert gpmf.telemetry_of(with_samples(tmp_path / "a.mp4", b"gpmd", temperature, temperature)) is None
    (tmp_path / "b.mp4").write_bytes(b"no clip")
    with pytest.raises(gpmf.NotPlainError):
        gpmf.telemetry_of(tmp_path / "b.mp4")


def test_damage_ends_in_a_log_of_even_times_or_in_one_error(tmp_path):
    numbers = np.random.default_rng(1)
    seen = set()
    for _ in range(150):
        data = [bytearray(each) for each in packets(orientation(b"YxZ"), b"TICK")]
        for _ in range(numbers.integers(1, 12)):
            packet = data[numbers.integers(len(data))]
            at = numbers.integers(min(len(packet), 200))
            if numbers.random() < 0.3:
                del packet[at:]
            packet[at : at + 4] = numbers.integers(0, 256, 4, dtype=np.uint8).tobytes()
        try:
            found = gpmf.telemetry_of(with_samples(tmp_path / "a.mp4", b"gpmd", *map(bytes, data)))
        except gpmf.DamagedLogError:
            seen.add("error")
            continue
        seen.add("log")
        if found is not None:
            assert np.isfinite(found.rates).all() and (np.diff(found.rates[:, 0]) > 0).all()
    assert seen == {"error", "log"}


def test_entries_deep_in_entries_do_not_exhaust_the_stack():
    data = b""
    for _ in range(8000):
        data = nested(b"STRM", data[:65_000])
    assert list(gpmf.entries(data)) == []
