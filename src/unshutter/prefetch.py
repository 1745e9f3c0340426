"""Photos on their way: opened, decoded and looked at before they are asked for. The only place that works ahead.

Decoding hardly needs Python, imports need one processor, an estimate mostly one: side by side, a photo is ready sooner.
A command makes one :class:`Prefetch` as soon as it knows its photos and options, and hands it to the work. The first
photo is decoded while libraries are imported; then, while one photo is warped and written, the next is opened, decoded
and its motion estimated. What comes out is the same as without.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
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


class Prefetch:
    """Works on the first of some photos at once, and on each next one while the one before is worked on.

    Two photos are held at a time.

    Args:
        places: the photos, in the order in which they will be asked for; some may be left out.
        find: how their motion is found; None: it is not wanted.
        max_pixels: see ``Photo.open``.
        undo: how their motion is to be undone; None: their pixels are not wanted. Of photos that are left as they are
            they are not either, and so not decoded ahead. (The first photo's are, for lack of anything else to do.)

    Raises:
        UsageError, UnshutterError: the estimator cannot be loaded. (What is wrong with a photo is said where it is
            taken.)
    """

    def __init__(
        self, places: Sequence[Place], find: Find | None, max_pixels: int = MAX_PIXELS, undo: Undo | None = None
    ) -> None:
        self._max_pixels, self._undo = max_pixels, undo
        self._camera = find.camera if find else None
        self._grey_px = method(find.estimator).grey_px if find else None
        self._waiting, self._left = iter(places), set(places)
        self._begun: dict[Place, Coming] = {}
        self._estimator: Future[Estimator] = Future()
        self._reader, self._looker = ThreadPoolExecutor(1), ThreadPoolExecutor(1)
        libvips()  # here: two threads that import at once mostly wait for each other
        self._begin_next()
        import numpy  # noqa: F401 (what the decoder needs next)

        if find is not None:
            try:
                estimator = load(find.estimator)
            except BaseException as error:
                self._estimator.set_exception(error)  # nobody waits for ever
                raise
            self._estimator.set_result(estimator)
            estimator.prepare()  # in this thread: a third one would be too many for two processors
            # not before all libraries are loaded: decoding more than the estimate needs would hold that up
            for coming in self._begun.values():
                self._reader.submit(self._decode_rest, coming)

    def take(self, place: Place) -> Coming:
        """The photo of a place, on its way; the next one is begun."""
        if place not in self._begun:
            if place not in self._left:  # asked for once more
                return self._begin(place)
            self._begun.clear()
            self._begin_next(place)
        coming = self._begun.pop(place)
        self._begin_next()
        return coming

    def _begin_next(self, wanted: Place | None = None) -> None:
        for place in self._waiting:
            self._left.discard(place)
            if wanted in (None, place):
                self._begun[place] = self._begin(place)
                break

    def _begin(self, place: Place) -> Coming:
        opening = self._reader.submit(self._opened, place)
        return Coming(opening, self._looker, self._estimator, self._camera, self._decode_if_changed)

    def _opened(self, place: Place) -> Photo:
        photo = open_photo(place, self._max_pixels)
        # all pixels only where nothing has to be known of the motion first
        photo.start_decoding(self._reader, self._grey_px, self._undo is not None and self._camera is None)
        return photo

    def _decode_rest(self, coming: Coming) -> None:
        with suppress(UnshutterError):  # raised again where the photo is taken
            coming.photo.start_decoding(self._reader, None, self._undo is not None)

    def _decode_if_changed(self, photo: Photo, motion: Motion) -> None:
        """Decodes the pixels of a photo whose motion is undone."""
        from unshutter.result import judged

        if self._undo is not None and judged(motion, self._undo, photo.height, photo.width)[1].changes:
            photo.start_decoding(self._reader)


class Coming:
    """A photo on its way: its pixels, and its motion where a camera says that it is wanted.

    Args:
        photo: the photo, as soon as it is open.
        looker: who estimates its motion.
        estimator: what with.
        camera: what is known of the camera; None: no motion is wanted.
        when_known: what is to happen when the motion is known.
    """

    def __init__(
        self,
        photo: Future[Photo],
        looker: ThreadPoolExecutor,
        estimator: Future[Estimator],
        camera: Camera | None,
        when_known: Callable[[Photo, Motion], None],
    ) -> None:
        self._photo, self._estimator, self._camera, self._when_known = photo, estimator, camera, when_known
        self._motion = looker.submit(self._estimate) if camera is not None else None

    @property
    def photo(self) -> Photo:
        """The photo, open.

        Raises:
            UnshutterError: it cannot be opened.
        """
        return self._photo.result()

    def motion(self) -> Motion:
        """Its motion, first row as the reference.

        Raises:
            UnshutterError: see :func:`unshutter.rectification.estimate_photo`.
        """
        if self._motion is not None:
            try:
                return self._motion.result()
            except WeightsError:  # it may have taken a minute
                raise
            except UnshutterError:  # once more, for its message: libvips mixes those of two threads
                return self._estimate()
        return self._estimate()

    def _estimate(self) -> Motion:
        photo, estimator = self._photo.result(), self._estimator.result()
        from unshutter.rectification import estimate_photo

        motion = estimate_photo(photo, estimator, self._camera or Camera())
        self._when_known(photo, motion)
        return motion


def open_photo(place: Place, max_pixels: int = MAX_PIXELS) -> Photo:
    """The photo of a place, a file or an object behind a URL; errors are those of ``Photo.open``."""
    return Photo.open(place, max_pixels) if isinstance(place, Path) else Photo.from_bytes(read_place(place), max_pixels)
