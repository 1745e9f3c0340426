"""When a photo was taken.

Source: CIPA DC-008 (EXIF 2.32): DateTimeOriginal and SubSecTimeOriginal.
"""

from __future__ import annotations

from datetime import datetime

from unshutter.photo.tags import exif
from unshutter.photo.tags.directories import EXIF

_ORIGINAL, _FRACTION = 0x9003, 0x9291


def taken(blob: bytes | None) -> datetime | None:
    """The time that an EXIF blob tells, in the camera's time zone; None where it tells none."""
    tree = exif.read(blob)
    if tree is None:
        return None
    told, fraction = tree.text(_ORIGINAL, EXIF), tree.text(_FRACTION, EXIF)
    try:
        time = datetime.strptime(told, "%Y:%m:%d %H:%M:%S")
    except ValueError:  # zeros or blanks, where a camera's clock was never set
        return None
    return time.replace(microsecond=int(fraction[:6].ljust(6, "0"))) if fraction.isdecimal() else time
