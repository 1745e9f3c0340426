"""Estimates the motion of a photo and undoes it: the functions behind the public API for single photos."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from unshutter.errors import UsageError
from unshutter.motion import Motion
from unshutter.motion.finding import Candidate, Finding
from unshutter.motion.verdict import judge
from unshutter.options import DEFAULT_ESTIMATOR, Camera, Edges, Find, Moving, Reference, Undo, Upright
from unshutter.options.fields import check_type, implemented_by
from unshutter.photo import Photo
from unshutter.photo.photo import PhotoLike, check_size, open_photo
from unshutter.rectification.find import find
from unshutter.rectification.rectified import Rectified, render
from unshutter.single.drawn_lines import DrawnLine, StraightenedLines, motion_from_lines, read_lines
from unshutter.single.estimator import Estimator, View
from unshutter.single.network import SegmentNetwork
from unshutter.single.register import method
from unshutter.storage.opened import Opened

# ---- for users ------------------------------------------------------------------------------------------

# Each public function states names, defaults and meaning; the private one above it, which gets its keywords as options,
# does the work.


def _rectify(
    photo: PhotoLike,
    estimator: str | Estimator,
    motion: Finding | Motion | str | os.PathLike[str] | None,
    how: Find,
    undo: Undo,
) -> Rectified:
    how, loaded = _chosen(estimator, how)
    given = None
    if motion is not None:
        how.check_unused()
        undo = undo.at_any_confidence()
        check_type("motion", motion, (Finding, Motion, str, os.PathLike), "a Finding, a Motion or a motion file's path")
        given = Finding(motion) if isinstance(motion, Motion) else motion
        given = given if isinstance(given, Finding) else Finding.load(given)
    source = open_photo(photo)
    if isinstance(motion, (str, os.PathLike)):
        source = replace(source, made_from=(*source.made_from, Opened.at(motion)))
    check_size(source.height, source.width)
    if given is None:
        how = how.for_least_confidence(undo.min_confidence)
        finding = find(source, how, loaded, pixels=True).choose(how.candidate)
    else:
        finding = given.fit(source.height, source.width, how.camera.readout)
    return render(source, judge(finding, undo), undo.edges)


@implemented_by(_rectify, how=Find, undo=Undo)
def rectify(
    photo: PhotoLike,
    *,
    estimator: str | Estimator = DEFAULT_ESTIMATOR,
    motion: Finding | Motion | str | os.PathLike[str] | None = None,
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
        motion: undo this motion, or that of this finding or motion file, instead of estimating one; it is resized to
            the photo when its aspect fits.

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
        (False, 'no visible motion')
    """
    ...


def _estimate(
    photo: PhotoLike,
    estimator: str | Estimator,
    lines: Sequence[DrawnLine] | str | os.PathLike[str] | None,
    how: Find,
    undo: Undo,
) -> Finding:
    how, loaded = _chosen(estimator, how)
    row = undo.reference or "first"
    source = open_photo(photo)
    check_size(source.height, source.width)
    if lines is None:
        return find(source, how, loaded).choose(how.candidate).rereferenced(row)
    check_type("lines", lines, (Sequence, os.PathLike), "a list of DrawnLine or the path of a file of lines")
    drawn = read_lines(Path(lines)) if isinstance(lines, str | os.PathLike) else lines
    return motion_of_lines(source, drawn, how.camera).finding.rereferenced(row)


@implemented_by(_estimate, how=Find, undo=Undo)
def estimate(
    photo: PhotoLike,
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
) -> Finding:
    """Finds how the camera moved while the photo was read out.

    Args:
        photo: what :func:`rectify` takes.
        estimator: name (``unshutter models`` lists them) or one made by :func:`unshutter.load`; not used with lines.
        lines: lines that a person drew along things in the photo, or a file of them; the motion found from them has
            no confidence.

    Returns:
        The ``motion`` at the photo's full size, and how sure it is; zero, with a ``reason``, if the photo does not show
        enough.

    Raises:
        UnshutterError: the photo cannot be read or used; UsageError: unknown estimator, readout or reference.

    Examples:
        >>> found = unshutter.estimate("street.jpg")
        >>> len(found.motion.tx_px) == found.motion.height  # a number for each row
        True
        >>> found.confidence
        0.9...
    """
    ...


def _candidates(photo: PhotoLike, estimator: str | Estimator, how: Find, undo: Undo) -> tuple[Candidate, ...]:
    how, loaded = _chosen(estimator, how)
    row = undo.reference or "first"
    if how.candidate is not None:
        raise UsageError("candidates() lists all motions: leave out candidate, or give it to estimate() or rectify()")
    return tuple(each.rereferenced(row) for each in find(open_photo(photo), how, loaded).candidates)


@implemented_by(_candidates, how=Find, undo=Undo)
def candidates(
    photo: PhotoLike,
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
        >>> [candidate.finding.confidence for candidate in unshutter.candidates("house.jpg")][:1]
        [0.9...]
    """
    ...


# ---- from lines drawn in a photo to its motion ---------------------------------------------------------------


def motion_of_lines(photo: Photo, lines: Sequence[DrawnLine], camera: Camera) -> StraightenedLines:
    """Finds the motion that straightens lines drawn along things in a photo, with the first row as the reference."""
    network = SegmentNetwork(method(DEFAULT_ESTIMATOR).weights)
    return motion_from_lines(View(photo, camera), lines, network)


def _chosen(estimator: str | Estimator, how: Find) -> tuple[Find, Estimator | None]:
    """Returns the options with the estimator's name, if it is a name; otherwise the estimator."""
    check_type("estimator", estimator, (str, Estimator), "the name of a method or an Estimator")
    return (replace(how, estimator=estimator), None) if isinstance(estimator, str) else (how, estimator)
