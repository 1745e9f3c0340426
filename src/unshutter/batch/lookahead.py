"""Looking ahead: while one photo is worked on, the next is opened and decoded, and its motion estimated."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError, WeightsError
from unshutter.estimators.register import load, method
from unshutter.options import MAX_PIXELS, Camera, Find, Undo
from unshutter.photo import Photo
from unshutter.photo.libvips import libvips
from unshutter.storage.places import Place, read_place

if TYPE_CHECKING:
    from unshutter.estimators.base import Estimator
    from unshutter.motion import Motion


class Lookahead:
    """Photos in the order of a batch, each begun while the one before it is worked on; two are held at a time.

    The first is opened and decoded while the estimator is loaded. The results are those of a run that does not look
    ahead.

    Args:
        places: the photos, in the order in which they will be taken; some may be left out.
        find: how their motion is found; None: no motion is needed.
        max_pixels: see ``Photo.open``.
        undo: how their motion will be undone; None: their pixels are not needed.

    Raises:
        UsageError, UnshutterError: the estimator cannot be loaded. (Errors of a photo are raised where it is taken.)
    """

    def __init__(
        self, places: Sequence[Place], find: Find | None, max_pixels: int = MAX_PIXELS, undo: Undo | None = None
    ) -> None:
        self.find, self.max_pixels, self.undo = find, max_pixels, undo
        self.grey_px = method(find.estimator).grey_px if find else None
        self.estimator: Estimator | None = None
        self._thread = ThreadPoolExecutor(1)
        self._waiting = deque(places)
        libvips()  # here: two threads that import at once mostly wait for each other
        self._next = self._begin(self._waiting.popleft()) if places else None
        import numpy  # noqa: F401 (what the decoder needs next)

        if find is not None:
            self.estimator = load(find.estimator)
        if self._next is not None:
            self._next.look(self._thread, whole=True)  # all pixels, too: there is no other work yet
        if self.estimator is not None:
            self.estimator.prepare()  # while segments are looked for

    def take(self, place: Place) -> PhotoAhead:
        """The photo of a place; the next one is begun."""
        photo = self._next
        if photo is None or photo.place != place:
            photo = self._begin(place)
            photo.look(self._thread)
            if place not in self._waiting:  # it is taken once more
                return photo
            while self._waiting.popleft() != place:  # some were left out
                pass
        self._next = self._begin(self._waiting.popleft()) if self._waiting else None
        if self._next is not None:
            self._next.look(self._thread)
        return photo

    def _begin(self, place: Place) -> PhotoAhead:
        return PhotoAhead(place, self, self._thread)


class PhotoAhead:
    """A photo that is opened, decoded and looked at ahead of the work on it.

    Args:
        place: of the photo.
        options: the lookahead that it belongs to.
        thread: that opens it.
    """

    def __init__(self, place: Place, options: Lookahead, thread: ThreadPoolExecutor) -> None:
        self.place = place
        self._options = options
        self._opening = thread.submit(self._open)
        self._looking = None

    def look(self, thread: ThreadPoolExecutor, whole: bool = False) -> None:
        """Estimates its motion in a thread, after it has been opened there.

        Args:
            thread: where to.
            whole: decode all pixels at the same time; else once the motion is known to change them.
        """
        if self._options.estimator is not None:
            self._looking = thread.submit(self._estimate, whole)

    @property
    def photo(self) -> Photo:
        """The photo, open.

        Raises:
            UnshutterError: it cannot be opened.
        """
        return self._opening.result()

    def motion(self) -> Motion:
        """Its motion, first row as the reference.

        Raises:
            UnshutterError: see :func:`unshutter.rectification.estimate_photo`.
        """
        if self._looking is not None:
            try:
                return self._looking.result()
            except WeightsError:  # it may have taken a minute
                raise
            except UnshutterError:  # once more, for its message: libvips mixes those of two threads
                return self._estimate()
        return self._estimate()

    def _open(self) -> Photo:
        options = self._options
        photo = open_photo(self.place, options.max_pixels)
        photo.start_decoding(None, options.grey_px, whole=options.undo is not None and options.find is None)
        return photo

    def _estimate(self, whole: bool = False) -> Motion:
        from unshutter.rectification import estimate_photo
        from unshutter.result import judged

        photo, options = self.photo, self._options
        if whole and options.undo is not None:
            photo.start_decoding()
        camera = options.find.camera if options.find else Camera()
        assert options.estimator is not None
        motion = estimate_photo(photo, options.estimator, camera)
        if options.undo is not None and judged(motion, options.undo, photo.height, photo.width)[1].changes:
            photo.start_decoding()
        return motion


def open_photo(place: Place, max_pixels: int = MAX_PIXELS) -> Photo:
    """The photo of a place, a file or an object behind a URL; errors are those of ``Photo.open``."""
    return Photo.open(place, max_pixels) if isinstance(place, Path) else Photo.from_bytes(read_place(place), max_pixels)
