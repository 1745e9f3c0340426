"""The usual readout ratio, for sequences too short to reveal their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from unshutter.frames.tracks import GUESSED_RATIO
from unshutter.photo import Photo
from unshutter.readout_time import ReadoutRatio, ReadoutSource, ReadoutTime

FEW = 3  # a photo and those just before and after it never show their readout ratio
_GUESSED_ERROR = 0.25  # of a guessed readout ratio
_CAUTIOUS = 0.7  # of a usual readout time: one that is too long bends photos, one that is too short leaves them bent
_LONGEST_S = 10.0  # between photos that are worth comparing


def cautious(time: ReadoutTime) -> ReadoutTime:
    """Shortens a camera's usual readout time to a part that is safe to undo."""
    return replace(time, seconds=_CAUTIOUS * time.seconds)


def usual_ratio(photos: Sequence[Photo]) -> ReadoutRatio:
    """Returns a readout ratio for successive photos: by the kind of camera and their times, if known; otherwise 0.5."""
    times = [photo.taken() for photo in photos]
    known = [time for time in times if time is not None and time.microsecond]
    readout = photos[0].readout_time()
    if len(known) == len(photos) > 1 and readout.source is not ReadoutSource.UNKNOWN:
        interval_s = (known[-1] - known[0]).total_seconds() / (len(photos) - 1)
        if 0 < interval_s <= _LONGEST_S:
            return cautious(readout).ratio(interval_s)
    return ReadoutRatio(GUESSED_RATIO, _GUESSED_ERROR, ReadoutSource.USUAL)
