"""GoPro's telemetry as tests write it: entries of GPMF, and MP4 files with a track of them."""

import struct

import numpy as np

from unshutter.video.file.mp4 import box


def entry(key, kind, content, size=1):
    """An entry of GPMF."""
    return key + kind + struct.pack(">BH", size, len(content) // size) + content + bytes(-len(content) % 4)


def nested(key, *entries):
    """An entry of GPMF that holds others."""
    content = b"".join(entries)
    return key + b"\0" + struct.pack(">BH", 1, len(content)) + content


def stream(key, values, scale, clock=b"", axes=(), before=0):
    """A stream of samples [N, axes] of whole numbers; ``clock`` and ``axes`` are entries of their own."""
    rows = np.asarray(values, ">i2")
    total = entry(b"TSMP", b"L", struct.pack(">I", before + len(rows)), 4)
    factor = entry(b"SCAL", b"s", struct.pack(">h", scale), 2)
    return nested(b"STRM", total, clock, factor, *axes, entry(key, b"s", rows.tobytes(), 2 * rows.shape[1]))


def device(*streams, name=b"HERO"):
    """A payload of one device."""
    return nested(b"DEVC", entry(b"DVID", b"L", struct.pack(">I", 1), 4), entry(b"DVNM", b"c", name), *streams)


def full(content):
    """The content of a box that has a version and flags."""
    return bytes(4) + content


def with_samples(path, kind, *samples, ms=1000):
    """A file with one track of a kind, of samples that last some time each, and a video track without frames."""
    data = b"".join(samples)
    table = [
        box(b"stsd", full(struct.pack(">I", 1) + box(kind, bytes(8)))),
        box(b"stts", full(struct.pack(">III", 1, len(samples), ms))),
        box(b"stsc", full(struct.pack(">IIII", 1, 1, len(samples), 1))),
        box(b"stsz", full(struct.pack(">II", 0, len(samples)) + struct.pack(f">{len(samples)}I", *map(len, samples)))),
        box(b"stco", full(struct.pack(">II", 1, 24))),
    ]
    header = full(struct.pack(">IIII", 0, 0, 1000, ms * len(samples)))
    media = box(b"mdhd", header + bytes(4)) + box(b"hdlr", full(bytes(4) + b"meta" + bytes(12) + b"\nGoPro MET\0"))
    media += box(b"minf", box(b"stbl", b"".join(table)))
    track = struct.pack(">IIIII", 0, 0, 1, 0, ms * len(samples)) + bytes(60)
    movie = box(b"mvhd", header + bytes(80)) + box(
        b"trak", box(b"tkhd", full(track[4:] + bytes(4))) + box(b"mdia", media)
    )
    path.write_bytes(box(b"ftyp", b"mp42" + bytes(4)) + box(b"mdat", data) + box(b"moov", movie))
    return str(path)


def with_settings(clip, settings):
    """Adds a GoPro's settings, entries of GPMF, to an MP4 file."""
    data = clip.read_bytes()
    at, extra = data.rindex(b"moov") - 4, box(b"udta", box(b"GPMF", settings))
    size = struct.pack(">I", int.from_bytes(data[at : at + 4], "big") + len(extra))
    clip.write_bytes(data[:at] + size + data[at + 4 :] + extra)
