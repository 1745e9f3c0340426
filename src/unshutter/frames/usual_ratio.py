"""The usual readout ratio, for sequences too short to reveal their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from unshutter.frames.tracks import GUESSED_RATIO
from unshutter.photo import Photo
from unshutter.readout_time import ReadoutRatio, ReadoutSource, ReadoutTime

FEW = 3  # a photo and those just before and after it never show their readout ratio


def cautious(time: ReadoutTime) -> ReadoutTime:
    """Shortens a camera's usual readout time to a part that is safe to undo."""
    return replace(time, seconds=0.7 * time.seconds)  # one that is too long bends photos, too short leaves them bent


def usual_ratio(photos: Sequence[Photo]) -> ReadoutRatio:
    """Returns a readout ratio for successive photos: by the kind of camera and their times, if known; otherwise 0.5."""
    times = [photo.taken() for photo in photos]
    known = [time for time in times if time is not None and time.microsecond]
    readout = photos[0].readout_time()
    if len(known) == len(photos) > 1 and readout.source is not ReadoutSource.UNKNOWN:
        interval_s = (known[-1] - known[0]).total_seconds() / (len(photos) - 1)
        if 0 < interval_s <= 10.0:  # between photos that are worth comparing
            return cautious(readout).ratio(interval_s)
    return ReadoutRatio(GUESSED_RATIO, 0.25, ReadoutSource.USUAL)
