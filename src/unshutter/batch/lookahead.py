"""Lookahead: opens, decodes and analyses the next photo while the current one is being processed."""

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
    """Photos of a batch in order, each started while the previous one is processed; two are held at a time.

    The first is opened and decoded while the estimator is loaded. The results do not differ from those of a run without
    lookahead.

    Args:
        places: the photos, in the order in which they will be taken; some may be skipped.
        find: how motions are found; None: no motion is needed.
        max_pixels: see ``Photo.open``.
        undo: how motions will be undone; None: pixels are not needed.

    Raises:
        UsageError, UnshutterError: the estimator cannot be loaded. (Errors of a photo are raised when it is taken.)
    """

    def __init__(
        self, places: Sequence[Place], find: Find | None, max_pixels: int = MAX_PIXELS, undo: Undo | None = None
    ) -> None:
        self.find, self.max_pixels, self.undo = find, max_pixels, undo
        self.grey_px = method(find.estimator).grey_px if find else None
        self.estimator: Estimator | None = None
        self._thread = ThreadPoolExecutor(1)
        self._waiting = deque(places)
        libvips()  # imported here: two threads importing at once mostly block each other
        self._next = self._begin(self._waiting.popleft()) if places else None
        import numpy  # noqa: F401 (what the decoder needs next)

        if find is not None:
            self.estimator = load(find.estimator)
        if self._next is not None:
            self._next.look(self._thread, whole=True)  # decode all pixels as well: there is no other work yet
        if self.estimator is not None:
            self.estimator.prepare()  # while line segments are being detected

    def take(self, place: Place) -> PhotoAhead:
        """Returns the photo of a place, and starts the next one."""
        photo = self._next
        if photo is None or photo.place != place:
            photo = self._begin(place)
            photo.look(self._thread)
            if place not in self._waiting:  # requested a second time
                return photo
            while self._waiting.popleft() != place:  # some were skipped
                pass
        self._next = self._begin(self._waiting.popleft()) if self._waiting else None
        if self._next is not None:
            self._next.look(self._thread)
        return photo

    def _begin(self, place: Place) -> PhotoAhead:
        return PhotoAhead(place, self, self._thread)


class PhotoAhead:
    """A photo that is opened, decoded and analysed ahead of its turn.

    Args:
        place: place of the photo.
        options: the lookahead that it belongs to.
        thread: thread in which to open it.
    """

    def __init__(self, place: Place, options: Lookahead, thread: ThreadPoolExecutor) -> None:
        self.place = place
        self._options = options
        self._opening = thread.submit(self._open)
        self._looking = None

    def look(self, thread: ThreadPoolExecutor, whole: bool = False) -> None:
        """Starts estimating the motion in a thread, once the photo has been opened there.

        Args:
            thread: the executor.
            whole: whether to decode all pixels at the same time; otherwise only if the motion changes them.
        """
        if self._options.estimator is not None:
            self._looking = thread.submit(self._estimate, whole)

    @property
    def photo(self) -> Photo:
        """The opened photo; waits until it is open.

        Raises:
            UnshutterError: it cannot be opened.
        """
        return self._opening.result()

    def motion(self) -> Motion:
        """Returns the motion, with the first row as the reference.

        Raises:
            UnshutterError: see :func:`unshutter.rectification.estimate_photo`.
        """
        if self._looking is not None:
            try:
                return self._looking.result()
            except WeightsError:  # loading may have taken a minute: no second attempt
                raise
            except UnshutterError:  # repeat it alone for its message: libvips mixes those of two threads
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
    """Opens the photo of a place, a file or an object behind a URL; errors are those of ``Photo.open``."""
    return Photo.open(place, max_pixels) if isinstance(place, Path) else Photo.from_bytes(read_place(place), max_pixels)
