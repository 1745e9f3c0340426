"""From a photo to its motion, and from both to the picture that a global shutter would have taken."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, overload

from unshutter.errors import UnshutterError, UsageError
from unshutter.estimators.base import Estimator, View
from unshutter.estimators.register import load, method
from unshutter.motion import Motion
from unshutter.options import DEFAULT_ESTIMATOR, Camera, Edges, Reference, Subsampling, Undo
from unshutter.photo import Photo

if TYPE_CHECKING:
    import numpy as np

SMALLEST_SIDE = 64  # px


@dataclass(frozen=True)
class Rectified:
    """A rectified photo.

    Attributes:
        photo: the new pixels with the metadata of the original.
        motion: what was undone, in the readout frame.
        original: the photo as it was read.
    """

    photo: Photo
    motion: Motion
    original: Photo

    @property
    def pixels(self) -> np.ndarray:
        """The stored pixels [H, W, bands] (bands is 1 for grey), uint8 or uint16, not to be written to."""
        return self.photo.pixels

    def to_array(self) -> np.ndarray:
        """A copy of the stored pixels, [H, W] or [H, W, bands], uint8 or uint16."""
        return self.photo.to_array()

    @property
    def valid(self) -> np.ndarray:
        """[H, W] bool: where the rolling-shutter photo shows what belongs there (before any crop or fill)."""
        from unshutter.warp.pixels import validity_mask

        return validity_mask(self.motion)

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        overwrite: bool = False,
        quality: int | None = None,
        subsampling: Subsampling | None = None,
    ) -> tuple[str, ...]:
        """Writes the picture; the format is that of the file name's ending. See :meth:`Photo.save`.

        Returns:
            What of the metadata did not go into the file, for lack of a place in such files: ``("IPTC",)``.

        Raises:
            UnshutterError: the file cannot be written, exists (without ``overwrite``) or is the original.
        """
        return self.photo.save(path, overwrite=overwrite, quality=quality, subsampling=subsampling)


# ---- for users ------------------------------------------------------------------------------------------


def estimate(
    photo: str | os.PathLike[str] | bytes | np.ndarray | Photo,
    *,
    estimator: str | Estimator = DEFAULT_ESTIMATOR,
    readout: str = "auto",
    reference: Reference = "first",
    focal_px: float | None = None,
    roll_deg: float | None = None,
    tilt_deg: float | None = None,
    exposure_s: float | None = None,
    readout_ms: float | None = None,
    moving: bool = False,
) -> Motion:
    """Finds how the camera moved while the photo was read out.

    Args:
        photo: path, encoded file as bytes, pixels [H, W] or [H, W, 1..4] (uint8 or uint16), or a Photo.
        estimator: name (``unshutter models`` lists them) or one made by :func:`unshutter.load`.
        readout: direction in which the stored pixels were read; ``auto``: as the photo shows, else top-to-bottom.
        reference: row at whose moment the global-shutter picture is taken: first, middle or last.
        focal_px: focal length [px of the photo] for methods that use one; by default EXIF's, else a guess.
        roll_deg: how far the camera was turned clockwise from upright, where known, for methods that use it.
        tilt_deg: how far it looked up (-90: straight down), where known, for methods that use it.
        exposure_s: how long the photo was exposed [s]; by default as EXIF says.
        readout_ms: time from the first row to the last [ms]; by default what is usual for the kind of camera.
        moving: whether the camera was on the move: in a train, on a car, in the air.

    Returns:
        The motion for the photo's full size; zero, with a ``reason``, where the photo does not say enough.

    Raises:
        UnshutterError: the photo cannot be read or used; UsageError: unknown estimator, readout or reference.
    """
    camera, how = Camera(readout, focal_px, roll_deg, tilt_deg, exposure_s, readout_ms, moving), Undo(reference)
    opened = _opened(photo)
    _check_size(opened)
    return estimate_photo(opened, _loaded(estimator), camera).rereferenced(how.reference or "first")


class _Options(TypedDict, total=False):
    estimator: str | Estimator
    motion: Motion | None
    readout: str
    focal_px: float | None
    roll_deg: float | None
    tilt_deg: float | None
    exposure_s: float | None
    readout_ms: float | None
    moving: bool
    reference: Reference | None
    strength: float
    edges: Edges


@overload
def rectify(photo: str | os.PathLike[str] | Photo, **options: Unpack[_Options]) -> Rectified: ...
@overload
def rectify(photo: bytes, **options: Unpack[_Options]) -> bytes: ...
@overload
def rectify(photo: np.ndarray, **options: Unpack[_Options]) -> np.ndarray: ...
def rectify(
    photo: Any,
    *,
    estimator: str | Estimator = DEFAULT_ESTIMATOR,
    motion: Motion | None = None,
    readout: str = "auto",
    reference: Reference | None = None,
    focal_px: float | None = None,
    roll_deg: float | None = None,
    tilt_deg: float | None = None,
    exposure_s: float | None = None,
    readout_ms: float | None = None,
    moving: bool = False,
    strength: float = 1.0,
    edges: Edges = "keep",
) -> Any:
    """Gives the photo back as a global shutter would have taken it.

    Args:
        photo: path, encoded file as bytes, pixels [H, W] or [H, W, 1..4] (uint8 or uint16), or a Photo.
        estimator: name, or an estimator made by :func:`unshutter.load`; not used when ``motion`` is given.
        motion: undo this motion instead of estimating one; it is resized to the photo when its aspect fits.
        readout: direction in which the stored pixels were read; ``auto``: the motion's, else as the photo shows.
        reference: row at whose moment the picture is taken; by default the motion's own, else the first.
        focal_px: focal length [px of the photo] for methods that use one; by default EXIF's, else a guess.
        roll_deg: how far the camera was turned clockwise from upright, where known, for methods that use it.
        tilt_deg: how far it looked up (-90: straight down), where known, for methods that use it.
        exposure_s: how long the photo was exposed [s]; by default as EXIF says.
        readout_ms: time from the first row to the last [ms]; by default what is usual for the kind of camera.
        moving: whether the camera was on the move: in a train, on a car, in the air.
        strength: 0 (nothing) to 1 (the whole motion).
        edges: ``keep`` leaves places that the photo did not see black (and transparent where it has alpha),
            ``crop`` cuts to the largest rectangle of the same aspect without them, ``fill`` repeats the edge.

    Returns:
        What it was given: a path or Photo gives a :class:`Rectified`, bytes give bytes of the same format,
        an array gives an array of the same type.

    Raises:
        UnshutterError: the photo or motion cannot be used; UsageError: an option is not one of its choices.
    """
    camera = Camera(readout, focal_px, roll_deg, tilt_deg, exposure_s, readout_ms, moving)
    how = Undo(reference, strength, edges)
    if motion is not None:
        camera.check_unused()
    opened = _opened(photo)
    _check_size(opened)
    if motion is None:
        grey_px = method(estimator).grey_px if isinstance(estimator, str) else None
        opened.start_decoding(grey_px=grey_px)  # while the estimator is loaded
        motion = estimate_photo(opened, _loaded(estimator), camera)
    else:
        opened.start_decoding()
    result = undo(opened, motion, how, readout)
    if isinstance(photo, bytes):
        return result.photo.to_bytes()
    if isinstance(photo, (str, os.PathLike, Photo)):
        return result
    pixels = result.to_array()
    return pixels.reshape(*pixels.shape[:2], *photo.shape[2:])


# ---- the two steps ----------------------------------------------------------------------------------------


def estimate_photo(photo: Photo, estimator: Estimator, camera: Camera) -> Motion:
    """The motion of a photo, first row as the reference.

    Raises:
        UnshutterError: the photo is too small, damaged or gone.
    """
    _check_size(photo)
    view = View(photo, camera)
    return view.noted(estimator.estimate(view))


def undo(photo: Photo, motion: Motion, how: Undo, readout: str = "auto") -> Rectified:
    """The photo with a motion undone.

    Args:
        photo: the photo.
        motion: its motion; of another size if the aspect fits.
        how: reference row, strength, edges.
        readout: direction in which the stored pixels were read; ``auto``: the motion's.

    Raises:
        UsageError: another readout direction than the motion's.
        UnshutterError: another aspect, a motion that cannot be undone, a photo that is too small or damaged.
    """
    from unshutter.warp.pixels import rectify_pixels

    _check_size(photo)
    motion = fitted(motion, photo.height, photo.width, readout)
    motion = motion.rereferenced(how.reference or motion.reference).scaled(how.strength)
    pixels = rectify_pixels(photo.pixels, motion, how.edges, photo.masked)
    return Rectified(photo.with_pixels(pixels), motion, photo)


def fitted(motion: Motion, height: int, width: int, readout: str = "auto") -> Motion:
    """A motion resized for a stored picture of height x width [px].

    Raises:
        UsageError: another readout direction than the motion's; UnshutterError: another aspect.
    """
    if readout != "auto" and Camera(readout).direction != motion.readout:
        raise UsageError(f"the motion was made for readout {motion.readout}, not {readout}")
    return motion.resized(*motion.readout.frame_size(height, width))


def _loaded(estimator: str | Estimator) -> Estimator:
    return load(estimator) if isinstance(estimator, str) else estimator


def _opened(photo: Any) -> Photo:
    if isinstance(photo, Photo):
        return photo
    if isinstance(photo, bytes):
        return Photo.from_bytes(photo)
    if isinstance(photo, (str, os.PathLike)):
        return Photo.open(photo)
    return Photo.from_array(photo)


def _check_size(photo: Photo) -> None:
    if min(photo.height, photo.width) < SMALLEST_SIDE:
        raise UnshutterError(
            f"the photo is {photo.width}x{photo.height} px; both sides must be at least {SMALLEST_SIDE} px"
        )
