"""Estimates the motion of a photo and undoes it: the functions behind the public API for single photos."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Unpack, overload

from unshutter.estimators.base import Estimator, View
from unshutter.estimators.find import chosen, find_candidates
from unshutter.estimators.methods.none import DoNothing
from unshutter.estimators.register import load, method
from unshutter.estimators.right_angles.drawn_lines import DrawnLine, read_lines
from unshutter.motion import Motion
from unshutter.motion.candidate import Candidate, alone
from unshutter.options import DEFAULT_ESTIMATOR, Camera, CameraKeywords, Find, Reference, Undo, UndoKeywords
from unshutter.options.description import from_keywords, takes_options
from unshutter.photo import Photo
from unshutter.photo.argument import check_size, in_kind, is_bytes, is_file, open_photo
from unshutter.result import Rectified, undo

if TYPE_CHECKING:
    import numpy as np
    from PIL.Image import Image

    from unshutter.motion_photo.motion import FilmEvidence


# ---- for users ------------------------------------------------------------------------------------------


class EstimateOptions(CameraKeywords, total=False):
    """Keywords of :func:`candidates`."""

    estimator: str | Estimator
    reference: Reference | None


class LinesOptions(EstimateOptions, total=False):
    """Keywords of :func:`estimate`."""

    lines: Sequence[DrawnLine] | str | os.PathLike[str] | None


class RectifyOptions(CameraKeywords, UndoKeywords, total=False):
    """Keywords of :func:`rectify`."""

    estimator: str | Estimator
    motion: Motion | str | os.PathLike[str] | None


@takes_options(LinesOptions, Camera, Undo, Find)
def estimate(photo: Any, **options: Unpack[LinesOptions]) -> Motion:
    """Finds how the camera moved while the photo was read out.

    Args:
        photo: what :func:`rectify` takes.
        estimator: name (``unshutter models`` lists them) or one made by :func:`unshutter.load`; not used with lines.
        lines: lines that a person drew along things in the photo, or a file of them; the motion found from them has
            no confidence.
        **options: what is known of the camera, and the reference row of the motion.

    Returns:
        The motion at the photo's full size; zero, with a ``reason``, if the photo does not show enough.

    Raises:
        UnshutterError: the photo cannot be read or used; UsageError: unknown estimator, readout or reference.

    Examples:
        >>> motion = unshutter.estimate("street.jpg")
        >>> len(motion.tx_px) == motion.height  # a number for each row
        True
    """
    camera, undoing = from_keywords(Camera, options), from_keywords(Undo, options)
    source = open_photo(photo)
    check_size(source.height, source.width)
    lines, reference = options.get("lines"), undoing.reference or "first"
    if lines is not None:
        drawn = read_lines(Path(lines)) if isinstance(lines, str | os.PathLike) else lines
        return motion_of_lines(source, drawn, camera).rereferenced(reference)
    estimator = _loaded(options.get("estimator", DEFAULT_ESTIMATOR))
    return estimate_photo(source, estimator, camera).rereferenced(reference)


@takes_options(EstimateOptions, Camera, Undo, Find)
def candidates(photo: Any, **options: Unpack[EstimateOptions]) -> tuple[Candidate, ...]:
    """Finds the few motions that fit a photo, from which a person can easily choose.

    Args:
        photo: what :func:`rectify` takes.
        estimator: name (``unshutter models`` lists them) or one made by :func:`unshutter.load`.
        **options: what is known of the camera, and the reference row of the motions.

    Returns:
        The motion that :func:`estimate` returns comes first. Leaving the photo unchanged counts as a candidate.

    Raises:
        UnshutterError: the photo cannot be read or used; UsageError: unknown estimator, readout or reference.

    Examples:
        >>> [candidate.motion.confidence for candidate in unshutter.candidates("house.jpg")][:1]
        [0.9...]
    """
    camera, undoing = from_keywords(Camera, options), from_keywords(Undo, options)
    source = open_photo(photo)
    estimator = _loaded(options.get("estimator", DEFAULT_ESTIMATOR))
    return photo_candidates(source, estimator, camera, undoing.reference or "first")


@overload
def rectify(photo: str | os.PathLike[str] | BinaryIO | Photo, **options: Unpack[RectifyOptions]) -> Rectified: ...
@overload
def rectify(photo: bytes | bytearray | memoryview, **options: Unpack[RectifyOptions]) -> bytes: ...
@overload
def rectify(photo: np.ndarray, **options: Unpack[RectifyOptions]) -> np.ndarray: ...
@overload
def rectify(photo: Image, **options: Unpack[RectifyOptions]) -> Image: ...
@takes_options(RectifyOptions, Camera, Undo, Find)
def rectify(photo: Any, **options: Unpack[RectifyOptions]) -> Any:
    """Removes rolling-shutter distortion from a photo.

    The photo is left unchanged, byte for byte, if its motion is too uncertain or moves nothing by half a pixel.

    Args:
        photo: path, encoded file as bytes or open in binary mode, pixels [H, W] or [H, W, 1..4] (uint8, uint16, or
            floating point from 0 to 1), Pillow image (only its pixels are used), or a Photo.
        estimator: name, or an estimator made by :func:`unshutter.load`; not used when ``motion`` is given.
        motion: undo this motion, or that of this motion file, instead of estimating one; it is resized to the photo
            when its aspect fits.
        **options: what is known of the camera, and how the motion is undone.

    Returns:
        The same kind of object as the input. A path, an open file or a Photo gives a :class:`Rectified`, bytes give
        bytes of the same format, an array gives an array of the same type, a Pillow image one of the same mode and
        ``info``. To see what was done, call :func:`rectified`, which always returns a :class:`Rectified`.

    Raises:
        UnshutterError: the photo or motion cannot be used; UsageError: an option is not one of its choices.

    Examples:
        >>> result = unshutter.rectify("street.jpg", edges="crop")
        >>> result.changed
        True
        >>> result.save("straight.jpg")  # returns the names of what could not be kept
        ()
        >>> pixels = unshutter.Photo.open("street.jpg").to_array()
        >>> unshutter.rectify(pixels, edges="keep").shape
        (490, 490, 3)
    """
    result = rectified(photo, **options)
    if is_file(photo):
        return result
    if is_bytes(photo):
        return result.encode().data
    return in_kind(photo, result.to_array() if result.changed else None)


@takes_options(RectifyOptions, Camera, Undo, Find)
def rectified(photo: Any, **options: Unpack[RectifyOptions]) -> Rectified:
    """Removes rolling-shutter distortion from a photo and reports the motion found and whether it was undone.

    Args:
        photo: what :func:`rectify` takes.
        estimator: name, or an estimator made by :func:`unshutter.load`; not used when ``motion`` is given.
        motion: undo this motion, or that of this motion file, instead of estimating one; it is resized to the photo
            when its aspect fits.
        **options: what is known of the camera, and how the motion is undone.

    Returns:
        A :class:`Rectified`, whatever the type of the input.

    Raises:
        UnshutterError: the photo or motion cannot be used; UsageError: an option is not one of its choices.

    Examples:
        >>> result = unshutter.rectified("house.jpg")
        >>> result.changed, str(result.reason)
        (False, 'no visible motion, confidence 0.9...')
    """
    camera, undoing = from_keywords(Camera, options), from_keywords(Undo, options)
    if not (is_file(photo) or is_bytes(photo)):  # arrays: the calling program may rely on pixel coordinates
        undoing = undoing.keeping_coordinates()
    estimator, motion = options.get("estimator", DEFAULT_ESTIMATOR), options.get("motion")
    if motion is not None:
        camera.check_unused()
        undoing = undoing.at_any_confidence()
        motion = motion if isinstance(motion, Motion) else Motion.load(motion)
    source = open_photo(photo)
    check_size(source.height, source.width)
    if motion is None:
        grey_px = method(estimator).grey_px if isinstance(estimator, str) else None
        source.start_decoding(grey_px=grey_px)  # in parallel with loading the estimator
        camera = camera.for_least_confidence(undoing.min_confidence)
        possible = photo_candidates(source, _loaded(estimator), camera)
        return replace(undo(source, chosen(possible, camera.candidate), undoing, camera.readout), candidates=possible)
    source.start_decoding()
    return undo(source, motion, undoing, camera.readout)


# ---- from a photo to its motion -----------------------------------------------------------------------------


def estimate_photo(photo: Photo, estimator: Estimator, camera: Camera) -> Motion:
    """Estimates the motion of a photo, with the first row as the reference.

    Raises:
        UnshutterError: the photo is too small, damaged or gone.
    """
    return chosen(photo_candidates(photo, estimator, camera), camera.candidate)


def motion_of_lines(photo: Photo, lines: Sequence[DrawnLine], camera: Camera) -> Motion:
    """Finds a photo's motion from lines that a person drew along things in it, with the first row as the reference.

    Raises:
        UsageError: there are no lines.
    """
    from unshutter.estimators.right_angles.drawn_motion import motion_from_lines
    from unshutter.estimators.segment_network import SegmentNetwork

    network = SegmentNetwork(method(DEFAULT_ESTIMATOR).weights)
    return motion_from_lines(View(photo, camera), lines, network)


def photo_candidates(
    photo: Photo, estimator: Estimator, camera: Camera, reference: Reference = "first"
) -> tuple[Candidate, ...]:
    """Finds the motions that fit a photo, best first: from the film inside it, otherwise from the estimator.

    Raises:
        UnshutterError: the photo is too small, damaged or gone.
    """
    check_size(photo.height, photo.width)
    view = View(photo, camera)
    evidence = _film_evidence(view, estimator)
    if evidence is not None and evidence.motion is not None:
        possible = alone(view.noted(evidence.motion), photo.orientation)
    else:
        unused = None if evidence is None else evidence.reason
        found = find_candidates(estimator, view)
        possible = tuple(replace(each, motion=replace(each.motion, film=unused)) for each in found)
    return tuple(replace(each, motion=each.motion.rereferenced(reference)) for each in possible)


def _film_evidence(view: View, estimator: Estimator) -> FilmEvidence | None:
    """Returns the evidence from the film inside a photo; None if there is no film or it is not to be used."""
    if view.camera.no_film or isinstance(estimator, DoNothing) or view.photo.film() is None:
        return None
    from unshutter.motion_photo.motion import film_motion  # imported here because few photos have a film

    return film_motion(view)


def _loaded(estimator: str | Estimator) -> Estimator:
    return load(estimator) if isinstance(estimator, str) else estimator
