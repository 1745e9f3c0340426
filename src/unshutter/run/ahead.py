"""Works ahead: while one photo is warped and written, the next one is opened and its motion found.

Results are those of a run that does not work ahead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, WeightsError
from unshutter.options import MAX_PIXELS, Find, Undo
from unshutter.photo import Photo
from unshutter.photo.libvips import libvips
from unshutter.photo.photo import PREVIEW, open_photo
from unshutter.single.register import load, method
from unshutter.storage.objects import is_object, read_object

if TYPE_CHECKING:
    from unshutter.motion.verdict import Verdict
    from unshutter.single.estimator import Estimator


class PreviewError(UnshutterError):
    """A file is not a photo but a preview that unshutter made."""


def open_input(path: Path, max_pixels: int = MAX_PIXELS) -> Photo:
    """Opens a photo, a file or an object behind a URL; errors are those of ``Photo.open``.

    Raises PreviewError for previews, which otherwise would be taken for photos by the next run over their folder.
    """
    photo = open_photo(read_object(path) if is_object(path) else path, max_pixels)
    if photo.software == PREVIEW:
        raise PreviewError("it is a preview that unshutter made, not a photo")
    return photo


@dataclass(frozen=True)
class Wanted:
    """A photo, and how its motion is to be found."""

    path: Path
    find: Find | None  # None: its motion is given, or found from other photos
    undo: Undo
    max_pixels: int = MAX_PIXELS
    pixels: bool = True  # whether its pixels are needed if it changes

    def open(self) -> Photo:
        """Opens the photo and starts decoding what is needed first."""
        photo = open_input(self.path, self.max_pixels)
        grey_px = None if self.find is None else method(self.find.estimator).grey_px
        photo.start_decoding(grey_px=grey_px, whole=self.pixels and self.find is None)
        return photo

    def judge(self, photo: Photo, estimator: Estimator) -> Verdict:
        """Returns the verdict on the motion found in the photo, and starts decoding its pixels if they are needed."""
        from unshutter.motion.verdict import judge
        from unshutter.rectification.find import find

        assert self.find is not None
        verdict = judge(find(photo, self.find, estimator).choose(self.find.candidate), self.undo)
        if self.pixels and verdict.changes:
            photo.start_decoding()
        return verdict


@dataclass(frozen=True)
class Begun:
    """A photo that is being opened, and judged, in another thread."""

    wanted: Wanted
    opening: Future[Photo]
    judging: Future[Verdict] | None = None  # None: its motion is not to be found
    estimator: Estimator | None = None

    @property
    def photo(self) -> Photo:
        """The opened photo; waits until it is open."""
        return self.opening.result()

    @property
    def verdict(self) -> Verdict:
        """The verdict on the photo's motion; waits for it."""
        assert self.judging is not None
        assert self.estimator is not None
        try:
            return self.judging.result()
        except WeightsError:  # loading may have taken a minute: no second attempt
            raise
        except UnshutterError:  # repeat it alone for its message: libvips mixes those of two threads
            return self.wanted.judge(self.photo, self.estimator)


def look_ahead(photos: Sequence[Wanted]) -> Iterator[Begun]:
    """Begins the first photo at once, and yields all in order, each begun while the previous one is processed.

    The first is opened and decoded while the estimator, the same for all, is loaded. Two photos are held at a time.
    Errors of a photo are raised where it is used.

    Raises:
        UnshutterError: the estimator is unknown or cannot be loaded.
    """
    if not photos:
        return iter(())
    thread = ThreadPoolExecutor(1)
    libvips()  # imported here: two threads importing at once mostly block each other
    opening = thread.submit(photos[0].open)
    import numpy  # noqa: F401 (what the decoder needs next)

    find = next((each.find for each in photos if each.find is not None), None)
    estimator = None if find is None else load(find.estimator)

    def begin(wanted: Wanted, opening: Future[Photo], whole: bool = False) -> Begun:
        if estimator is None or wanted.find is None:
            return Begun(wanted, opening)

        def judge(estimator: Estimator) -> Verdict:
            if whole:
                opening.result().start_decoding()
            return wanted.judge(opening.result(), estimator)

        return Begun(wanted, opening, thread.submit(judge, estimator), estimator)

    def each(current: Begun) -> Iterator[Begun]:
        for wanted in photos[1:]:
            following = begin(wanted, thread.submit(wanted.open))
            yield current
            current = following
        yield current

    begun = each(begin(photos[0], opening, whole=photos[0].pixels))  # all its pixels, too: there is no other work yet
    if estimator is not None:
        estimator.prepare()  # while line segments are being detected
    return begun
