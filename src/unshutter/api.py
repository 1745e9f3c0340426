"""Estimates the motion of a photo and undoes it: the functions behind the public API for single photos."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from unshutter.errors import UsageError
from unshutter.motion import Motion
from unshutter.motion.rectified import Rectified, undo
from unshutter.motion.verdict import Candidate, alone
from unshutter.options import DEFAULT_ESTIMATOR, Camera, Edges, Find, Moving, Reference, Undo, Upright
from unshutter.options.fields import check_type, for_python, from_keywords
from unshutter.photo import Photo
from unshutter.photo.photo import AnyPhoto, check_size, open_photo
from unshutter.reasons import MOST_STATED
from unshutter.single.drawn_lines import DrawnLine, StraightenedLines, motion_from_lines, read_lines
from unshutter.single.estimator import Estimator, View
from unshutter.single.methods import DoNothing, chosen, find_candidates
from unshutter.single.network import SegmentNetwork
from unshutter.single.prospects import MOST_IN_FOLDER
from unshutter.single.register import load, method
from unshutter.storage.opened import Opened

if TYPE_CHECKING:
    from unshutter.frames.motion_photo import FilmEvidence


# ---- for users ------------------------------------------------------------------------------------------


@for_python(Camera, Undo, Find)
def rectify(
    photo: AnyPhoto,
    *,
    estimator: str | Estimator = DEFAULT_ESTIMATOR,
    motion: Motion | str | os.PathLike[str] | None = None,
    readout: str = "auto",
    focal_px: float | None = None,
    roll_deg: float | None = None,
    tilt_deg: float | None = None,
    exposure_s: float | None = None,
    readout_ms: float | None = None,
    moving: Moving | None = None,
    no_film: bool = False,
    candidate: int | None = None,
    reference: Reference | None = None,
    strength: float = 1.0,
    edges: Edges = "auto",
    min_confidence: float | None = None,
    upright: Upright | None = None,
) -> Rectified:
    """Removes rolling-shutter distortion from a photo.

    The photo is left unchanged, byte for byte, if its motion is too uncertain or moves nothing by half a pixel.

    Args:
        photo: path, encoded file as bytes or open in binary mode, pixels [H, W] or [H, W, 1..4] (uint8, uint16, or
            floating point from 0 to 1), Pillow image (only its pixels are used), or a Photo.
        estimator: name, or an estimator made by :func:`unshutter.load`; not used when ``motion`` is given.
        motion: undo this motion, or that of this motion file, instead of estimating one; it is resized to the photo
            when its aspect fits.

    Returns:
        The new picture, as ``.array``, ``.image``, ``.bytes`` or by ``.save()``, and what was found and done. It may
        be cropped; ``edges="keep"`` keeps the photo's size and pixel coordinates.

    Raises:
        UnshutterError: the photo or motion cannot be used; UsageError: an option is not one of its choices.

    Examples:
        >>> result = unshutter.rectify("street.jpg", edges="crop")
        >>> result.changed
        True
        >>> result.save("straight.jpg")  # returns the names of what could not be kept
        ()
        >>> pixels = unshutter.Photo.open("street.jpg").to_array()
        >>> unshutter.rectify(pixels, edges="keep").array.shape
        (490, 490, 3)
        >>> result = unshutter.rectify("house.jpg")
        >>> result.changed, str(result.reason)
        (False, 'no visible motion, confidence 0.9...')
    """
    keywords = locals()
    camera, undoing, motion_file = from_keywords(Camera, keywords), from_keywords(Undo, keywords), motion
    if motion is not None:
        camera.check_unused()
        undoing = undoing.at_any_confidence()
        check_type("motion", motion, (Motion, str, os.PathLike), "a Motion or the path of a motion file")
        motion = motion if isinstance(motion, Motion) else Motion.load(motion)
    source = open_photo(photo)
    if isinstance(motion_file, (str, os.PathLike)):
        source = replace(source, made_from=(*source.made_from, Opened.at(motion_file)))
    check_size(source.height, source.width)
    if motion is None:
        grey_px = method(estimator).grey_px if isinstance(estimator, str) else None
        source.start_decoding(grey_px=grey_px)  # in parallel with loading the estimator
        camera = camera.for_least_confidence(undoing.min_confidence)
        possible = photo_candidates(source, _loaded(estimator), camera)
        return replace(undo(source, chosen(possible, camera.candidate), undoing, camera.readout), candidates=possible)
    source.start_decoding()
    return undo(source, motion, undoing, camera.readout)


@for_python(Camera, Undo, Find)
def estimate(
    photo: AnyPhoto,
    *,
    estimator: str | Estimator = DEFAULT_ESTIMATOR,
    lines: Sequence[DrawnLine] | str | os.PathLike[str] | None = None,
    readout: str = "auto",
    focal_px: float | None = None,
    roll_deg: float | None = None,
    tilt_deg: float | None = None,
    exposure_s: float | None = None,
    readout_ms: float | None = None,
    moving: Moving | None = None,
    no_film: bool = False,
    candidate: int | None = None,
    reference: Reference | None = None,
) -> Motion:
    """Finds how the camera moved while the photo was read out.

    Args:
        photo: what :func:`rectify` takes.
        estimator: name (``unshutter models`` lists them) or one made by :func:`unshutter.load`; not used with lines.
        lines: lines that a person drew along things in the photo, or a file of them; the motion found from them has
            no confidence.

    Returns:
        The motion at the photo's full size; zero, with a ``reason``, if the photo does not show enough.

    Raises:
        UnshutterError: the photo cannot be read or used; UsageError: unknown estimator, readout or reference.

    Examples:
        >>> motion = unshutter.estimate("street.jpg")
        >>> len(motion.tx_px) == motion.height  # a number for each row
        True
    """
    keywords = locals()
    camera, row = from_keywords(Camera, keywords), from_keywords(Undo, keywords).reference or "first"
    source = open_photo(photo)
    check_size(source.height, source.width)
    if lines is None:
        return estimate_photo(source, _loaded(estimator), camera).rereferenced(row)
    check_type("lines", lines, (Sequence, os.PathLike), "a list of DrawnLine or the path of a file of lines")
    drawn = read_lines(Path(lines)) if isinstance(lines, str | os.PathLike) else lines
    return motion_of_lines(source, drawn, camera).motion.rereferenced(row)


@for_python(Camera, Undo, Find)
def candidates(
    photo: AnyPhoto,
    *,
    estimator: str | Estimator = DEFAULT_ESTIMATOR,
    readout: str = "auto",
    focal_px: float | None = None,
    roll_deg: float | None = None,
    tilt_deg: float | None = None,
    exposure_s: float | None = None,
    readout_ms: float | None = None,
    moving: Moving | None = None,
    no_film: bool = False,
    candidate: int | None = None,
    reference: Reference | None = None,
) -> tuple[Candidate, ...]:
    """Finds the few motions that fit a photo, from which a person can easily choose.

    Args:
        photo: what :func:`rectify` takes.
        estimator: name (``unshutter models`` lists them) or one made by :func:`unshutter.load`.

    Returns:
        The motion that :func:`estimate` returns comes first. Leaving the photo unchanged counts as a candidate.

    Raises:
        UnshutterError: the photo cannot be read or used; UsageError: unknown estimator, readout or reference, or a
            single candidate is chosen.

    Examples:
        >>> [candidate.motion.confidence for candidate in unshutter.candidates("house.jpg")][:1]
        [0.9...]
    """
    keywords = locals()
    camera, row = from_keywords(Camera, keywords), from_keywords(Undo, keywords).reference or "first"
    if candidate is not None:
        raise UsageError("candidates() lists all motions: leave out candidate, or give it to estimate() or rectify()")
    return photo_candidates(open_photo(photo), _loaded(estimator), camera, row)


# ---- from a photo to its motion -----------------------------------------------------------------------------


def estimate_photo(photo: Photo, estimator: Estimator, camera: Camera) -> Motion:
    """Estimates the motion of a photo, with the first row as the reference."""
    return chosen(photo_candidates(photo, estimator, camera), camera.candidate)


def motion_of_lines(photo: Photo, lines: Sequence[DrawnLine], camera: Camera) -> StraightenedLines:
    """Finds the motion that straightens lines drawn along things in a photo, with the first row as the reference."""
    network = SegmentNetwork(method(DEFAULT_ESTIMATOR).weights)
    return motion_from_lines(View(photo, camera), lines, network)


def photo_candidates(
    photo: Photo, estimator: Estimator, camera: Camera, reference: Reference = "first"
) -> tuple[Candidate, ...]:
    """Finds the motions that fit a photo, best first: from the film inside it, otherwise from the estimator.

    Their probabilities are as they are stated everywhere (reasons.py).
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
    most = MOST_IN_FOLDER if camera.folder_log_odds else MOST_STATED
    referred = (replace(each, motion=each.motion.rereferenced(reference)) for each in possible)
    return tuple(each.as_stated(most) for each in referred)


def _film_evidence(view: View, estimator: Estimator) -> FilmEvidence | None:
    """Returns the evidence from the film inside a photo; None if there is no film or it is not to be used."""
    if view.camera.no_film or isinstance(estimator, DoNothing) or view.photo.film() is None:
        return None
    from unshutter.frames.motion_photo import film_motion  # imported here because few photos have a film

    return film_motion(view)


def _loaded(estimator: str | Estimator) -> Estimator:
    check_type("estimator", estimator, (str, Estimator), "the name of a method or an Estimator")
    return load(estimator) if isinstance(estimator, str) else estimator
