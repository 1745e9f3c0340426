"""Works ahead: while one photo is warped and written, the next one is opened and its motion found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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


def open_input(place: Path, max_pixels: int = MAX_PIXELS) -> Photo:
    """Opens a photo, a file or an object behind a URL; errors are those of ``Photo.open``.

    Raises PreviewError for previews, which otherwise would be taken for photos by the next run over their folder.
    """
    photo = open_photo(read_object(place) if is_object(place) else place, max_pixels)
    if photo.software == PREVIEW:
        raise PreviewError("it is a preview that unshutter made, not a photo")
    return photo


@dataclass(frozen=True)
class Wanted:
    """What is wanted of the photos of a run."""

    find: Find | None  # how the motion of each is found; None: it is given, or found from other photos
    undo: Undo
    max_pixels: int = MAX_PIXELS
    pixels: bool = True  # whether the pixels of those that change are needed


@dataclass(frozen=True)
class Ahead:
    """A photo that is being opened, and judged, in another thread."""

    path: Path
    opening: Future[Photo]
    judging: Future[Verdict] | None  # None: its motion is not to be found
    judge_again: Callable[[Photo], Verdict]

    @property
    def photo(self) -> Photo:
        """The opened photo; waits until it is open."""
        return self.opening.result()

    @property
    def verdict(self) -> Verdict:
        """The verdict on the photo's motion; waits for it."""
        assert self.judging is not None
        try:
            return self.judging.result()
        except WeightsError:  # loading may have taken a minute: no second attempt
            raise
        except UnshutterError:  # repeat it alone for its message: libvips mixes those of two threads
            return self.judge_again(self.photo)


def look_ahead(places: Sequence[Path], wanted: Wanted) -> Iterator[Ahead]:
    """Begins the first photo at once, and yields all in order, each begun while the previous one is processed.

    The first is opened and decoded while the estimator is loaded. Two photos are held at a time. The results are those
    of a run that does not work ahead. Errors of a photo are raised where it is used.

    Raises:
        UnshutterError: the estimator is unknown or cannot be loaded.
    """
    if not places:
        return iter(())
    thread = ThreadPoolExecutor(1)
    libvips()  # imported here: two threads importing at once mostly block each other
    opening = thread.submit(_open, places[0], wanted)
    import numpy  # noqa: F401 (what the decoder needs next)

    estimator = None if wanted.find is None else load(wanted.find.estimator)

    def judge(photo: Photo) -> Verdict:
        return _judge(photo, estimator, wanted)

    def begin(place: Path, opening: Future[Photo], whole: bool) -> Ahead:
        def judge_opened() -> Verdict:
            if whole:
                opening.result().start_decoding()
            return judge(opening.result())

        return Ahead(place, opening, None if estimator is None else thread.submit(judge_opened), judge)

    def each(current: Ahead) -> Iterator[Ahead]:
        for place in places[1:]:
            following = begin(place, thread.submit(_open, place, wanted), whole=False)
            yield current
            current = following
        yield current

    begun = each(begin(places[0], opening, whole=wanted.pixels))  # all its pixels, too: there is no other work yet
    if estimator is not None:
        estimator.prepare()  # while line segments are being detected
    return begun


def _open(place: Path, wanted: Wanted) -> Photo:
    photo = open_input(place, wanted.max_pixels)
    grey_px = None if wanted.find is None else method(wanted.find.estimator).grey_px
    photo.start_decoding(grey_px=grey_px, whole=wanted.pixels and wanted.find is None)
    return photo


def _judge(photo: Photo, estimator: Estimator | None, wanted: Wanted) -> Verdict:
    """Returns the verdict on the motion found in a photo, and starts decoding its pixels if they are needed."""
    from unshutter.motion.verdict import judge
    from unshutter.rectification.find import find

    assert estimator is not None
    assert wanted.find is not None
    verdict = judge(find(photo, wanted.find, estimator).choose(wanted.find.candidate), wanted.undo)
    if wanted.pixels and verdict.changes:
        photo.start_decoding()
    return verdict
