"""Finds bursts among the photos of a run: photos taken so soon after one another that they show how the camera moved.

Their times are those of EXIF, with fractions of a second. A burst is by one camera with one setting: photos of an
exposure bracket, or of another focal length or distance, are not neighbours. The readout time is the user's or, for
cameras without a mechanical shutter, a cautious part of the usual one; for others it is too uncertain. A photo that its
neighbours do not explain is judged by itself.

Photos without a time, like frames of a clip, may be one, too, if tracks connect them: the page offers to use them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError
from unshutter.options import Camera
from unshutter.photo import Photo
from unshutter.readout_time import ReadoutSource, ReadoutTime
from unshutter.reasons import JsonObject
from unshutter.storage.locations import absolute
from unshutter.storage.objects import is_object

if TYPE_CHECKING:
    from unshutter.frames.frame_motion import FrameMotion
    from unshutter.frames.sequence import CameraMotion, GreyFrame

_LONGEST_S = 0.201  # from one photo to the next; with more, a hand changes its speed too much (docs/research/bursts.md)
_LONGEST_OF_TWO_S = 0.101  # two photos do not show how the speed changed
_SAME_EXPOSURE = 1.12  # ratio of exposure times; brackets have 1.26 or more


@dataclass(frozen=True)
class Burst:
    """What the other photos of its burst show about a photo."""

    motion: FrameMotion
    others: int  # number of other photos
    interval_s: float  # from one to the next
    readout_time: ReadoutTime

    def described(self) -> str:
        """Describes what was used."""
        photos = "1 photo" if self.others == 1 else f"{self.others} photos"
        time = self.readout_time
        return f"by {photos} {self.interval_s:.2g} s apart, taking {time.ms:.3g} ms ({time.source})"

    def as_json(self) -> JsonObject:
        """Returns what was used, ready for JSON."""
        data = {"others": self.others, "interval_s": self.interval_s, "readout_ms": self.readout_time.ms}
        data |= {"plausible_ms": self.readout_time.plausible_ms, "found_by": self.readout_time.source}
        return {"burst": data}


@dataclass(frozen=True)
class _Taken:
    """What is known of a photo before it is decoded."""

    path: Path
    folder: Path | None
    size: tuple[int, int]
    setting: tuple[object, ...]  # the camera and its setting
    exposure_s: float
    at_s: float  # time
    readout_time: ReadoutTime  # for the camera's kind

    @classmethod
    def of(cls, place: Path, max_pixels: int, folder: Path | None) -> _Taken | None:
        """Returns the facts of a photo, or None if it cannot belong to a burst."""
        with suppress(UnshutterError):
            photo = Photo.open(place, max_pixels)
            time = photo.taken()
            setting = photo.setting()
            exposure_s = photo.exposure_s()
            if time is None or not time.microsecond or setting is None or exposure_s is None:
                return None
            if photo.embedded_video() is None:  # which tells more than a burst
                size = photo.height, photo.width
                return cls(place, folder, size, setting, exposure_s, time.timestamp(), photo.readout_time())
        return None

    @property
    def group(self) -> tuple[object, ...]:
        return self.folder, self.size, self.setting[0]

    def is_followed_by(self, other: _Taken) -> bool:
        """Whether another photo with this setting was taken just afterwards."""
        alike = (
            self.setting == other.setting and 1 / _SAME_EXPOSURE < other.exposure_s / self.exposure_s < _SAME_EXPOSURE
        )
        return alike and 0 < other.at_s - self.at_s <= _LONGEST_S


def bursts_among(
    photos: Collection[Path], to_do: Collection[Path], camera: Camera, max_pixels: int
) -> dict[Path, Burst]:
    """Returns what photos show about others that are to do, which are named by their absolute paths."""
    found: dict[Path, Burst] = {}
    for burst in _bursts([(path, path.parent) for path in photos if not is_object(path)], max_pixels):
        if any(absolute(each.path) in to_do for each in burst):
            found |= dict(_motions(burst, camera, max_pixels))
    return found


def look_like_bursts(photos: Sequence[Path], max_pixels: int) -> list[list[Path]]:
    """Returns the bursts among photos that came together, in the order in which they were taken.

    Args:
        photos: in order, which counts for those without a time: tracks must connect each to the next, and show that the
            camera moved.
    """
    timed = [[taken.path for taken in burst] for burst in _bursts([(place, None) for place in photos], max_pixels)]
    return [*timed, *_connected(photos, max_pixels)]


def _connected(photos: Sequence[Path], max_pixels: int) -> Iterator[list[Path]]:
    """Yields photos without a time of which each shows the scene of the one before it, at least two."""
    from unshutter.frames import sequence, usual_ratio

    def opened(place: Path) -> Photo | None:
        with suppress(UnshutterError):
            photo = Photo.open(place, max_pixels)
            if photo.taken() is None and photo.embedded_video() is None and photo.readout_time().longest_s:
                return photo
        return None

    known = [photo for place in photos if (photo := opened(place)) is not None]
    for _, group in groupby(known, key=lambda photo: (photo.height, photo.width, photo.camera())):
        alike = list(group)
        if len(alike) < 2:
            continue
        with suppress(UnshutterError):  # one of them cannot be decoded
            motions = list(sequence.CameraMotion(usual_ratio.usual_ratio(alike)).frames(alike))
            by_shot = groupby(zip(alike, motions, strict=True), key=lambda pair: pair[1].shot)
            for shot in (list(pairs) for _, pairs in by_shot):
                if len(shot) > 1 and any(motion.reason is None for _, motion in shot):
                    yield [photo.path for photo, _ in shot if photo.path is not None]


def _bursts(photos: Collection[tuple[Path, Path | None]], max_pixels: int) -> Iterator[list[_Taken]]:
    """Yields photos, each given with its folder, that follow one another, at least two."""
    known = [taken for place, folder in photos if (taken := _Taken.of(place, max_pixels, folder)) is not None]
    known.sort(key=lambda each: (str(each.group), each.at_s))
    for _, group in groupby(known, key=lambda each: each.group):
        burst: list[_Taken] = []
        for taken in group:
            if burst and not burst[-1].is_followed_by(taken):
                yield from [burst] if _is_close(burst) else []
                burst = []
            burst.append(taken)
        yield from [burst] if _is_close(burst) else []


def _is_close(burst: list[_Taken]) -> bool:
    """Whether photos show how the camera's speed changed: two must be closer together than three."""
    return len(burst) > 2 or (len(burst) == 2 and burst[1].at_s - burst[0].at_s <= _LONGEST_OF_TWO_S)


def _motions(burst: list[_Taken], camera: Camera, max_pixels: int) -> Iterator[tuple[Path, Burst]]:
    """Yields the photos of a burst whose motion their neighbours show, with that motion."""
    from unshutter.frames import frame_motion, sequence, usual_ratio  # NumPy comes after decoding has begun

    time = burst[0].readout_time
    if camera.readout_ms is not None:
        time = ReadoutTime.of_ms(camera.readout_ms, ReadoutSource.GIVEN)
    elif time.source in (ReadoutSource.PHONE, ReadoutSource.DRONE):
        time = usual_ratio.cautious(time)
    else:
        return
    gaps = [after.at_s - before.at_s for before, after in pairwise(burst)]
    interval_s = median(gaps)
    # some cameras record hundredths of a second: intervals that differ by less are even
    if max(abs(gap - interval_s) for gap in gaps) < 0.012:
        gaps = [interval_s] * len(gaps)
    finder = sequence.CameraMotion(time.ratio(interval_s), camera.focal_px, camera.scan_direction)
    steps = [1.0, *(gap / interval_s for gap in gaps)]
    try:
        motions = list(finder.motions(_grey_frames(finder, burst, steps, max_pixels)))
    except UnshutterError:  # one of them cannot be decoded, which is reported when its turn comes
        return
    for taken, motion in zip(burst, motions, strict=True):
        if motion.reason is None or motion.reason.code in frame_motion.AT_REST:
            place = absolute(taken.path)
            yield place, Burst(motion, len(burst) - 1, round(interval_s, 4), time)


def _grey_frames(finder: CameraMotion, burst: list[_Taken], steps: list[float], max_pixels: int) -> Iterator[GreyFrame]:
    for taken, step in zip(burst, steps, strict=True):
        frame = finder.add_frame(Photo.open(taken.path, max_pixels))
        frame.after = step
        yield frame
