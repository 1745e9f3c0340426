"""Exports a motion as a map for other programs: for cv2.remap (NPZ), or as an ST map (EXR, TIFF).

Convention: maps are for **stored** pixels (readout.py). Inside the package, positions are (col, row) with
pixel centres at whole numbers. An ST map expresses positions as fractions of the picture, from its bottom left corner:
s = (col + 0.5) / W to the right, t = 1 - (row + 0.5) / H upwards, as read by Nuke's STMap.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from unshutter import installation
from unshutter.errors import UnshutterError, UsageError
from unshutter.estimators.register import load, weights_file
from unshutter.motion import Motion
from unshutter.options import MAX_PIXELS, Find, Reference
from unshutter.photo import Photo
from unshutter.photo.libvips import libvips, refusing
from unshutter.rectification import estimate_photo
from unshutter.result import fitted
from unshutter.storage.files import check_target, remove_leftovers, written_whole
from unshutter.storage.protection import Protection
from unshutter.warp.grid import SamplingGrid, gs_to_rs_map, rs_to_gs_map

SUFFIXES = (".npz", ".exr", ".tif", ".tiff")


@dataclass(frozen=True, eq=False)
class PixelMap:
    """The position in one picture that each pixel of another picture of the same size shows; stored orientation.

    Attributes:
        col, row: float32 [H, W], position shown by the pixel [px], accurate to 0.01 px where ``valid``.
        valid: bool [H, W], whether that position lies inside the picture.
    """

    col: np.ndarray
    row: np.ndarray
    valid: np.ndarray

    @classmethod
    def of(cls, motion: Motion, inverse: bool = False) -> PixelMap:
        """Computes the map of a motion.

        Args:
            motion: motion for exactly the size of the map.
            inverse: False: each GS pixel samples the RS photo (rectifies). True: each RS pixel samples the
                GS picture (distorts).

        Raises:
            UnshutterError: the motion turns faster than rows are read.
        """
        size = motion.readout.frame_size(motion.height, motion.width)
        grid = SamplingGrid.of(rs_to_gs_map(motion) if inverse else gs_to_rs_map(motion), *size)
        col, row = grid.everywhere()
        return cls(col, row, grid.inside(col, row))

    def st(self) -> np.ndarray:
        """Returns the ST map: float32 [H, W, 3], top row first: s, t, and 1 where valid, else 0."""
        height, width = self.col.shape
        s, t = (self.col + 0.5) / width, 1 - (self.row + 0.5) / height
        return np.stack([s, t, self.valid], axis=-1).astype(np.float32)

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Writes the map atomically.

        Args:
            path: ``.npz``: arrays ``map_x`` and ``map_y`` (col and row) for cv2.remap. ``.exr`` (extra
                ``exr``), ``.tif``, ``.tiff``: the ST map, 32-bit float, R = s, G = t, B = valid.
            overwrite: whether an existing file may be replaced.

        Raises:
            UsageError: unknown extension; UnshutterError: the file exists, cannot be written, or the package
                for EXR is missing.
        """
        target = Path(path)
        check_map_target(target, overwrite)
        suffix = target.suffix.lower()
        with written_whole(target, overwrite) as part:
            if suffix == ".npz":
                with part.open("wb") as stream:
                    np.savez(stream, map_x=self.col, map_y=self.row)
            elif suffix == ".exr":
                _write_exr(part, self.st())
            else:
                _write_tiff(part, self.st())


def map_file(
    source: Path,
    target: Path,
    *,
    find: Find | None = None,
    reference: Reference | None = None,
    inverse: bool = False,
    size: str | None = None,
    overwrite: bool = False,
) -> Motion:
    """Writes the map of a photo or a motion file.

    Args:
        source: photo whose motion is estimated, or a motion file (``.json``).
        target, overwrite: see :meth:`PixelMap.save`.
        find: how the motion is found, by default as :func:`unshutter.estimate` does; for a motion file, only the
            readout direction may be specified.
        reference: row whose time of exposure the GS picture shows; by default the motion's own, otherwise the first.
        inverse: see :meth:`PixelMap.of`.
        size: ``WxH`` of the map in stored pixels, for a scaled copy of the photo; by default the photo's.

    Returns:
        The motion that the map applies.

    Raises:
        UnshutterError: the photo, motion or target cannot be used; UsageError: an option is invalid.

    Examples:
        >>> motion = map_file(Path("street.jpg"), Path("street.npz"))
        >>> sorted(np.load("street.npz"))
        ['map_x', 'map_y']
    """
    find = find or Find()
    check_map_target(target, overwrite, source)
    Protection([weights_file(find.estimator)]).check(target)
    remove_leftovers(target.parent)
    map_size = None if size is None else _parse_size(size)
    if source.suffix.lower() == ".json":
        find.camera.check_unused()
        motion = Motion.load(source)
        motion = fitted(motion, *motion.readout.frame_size(motion.height, motion.width), find.camera.readout)
    else:
        motion = estimate_photo(Photo.open(source), load(find.estimator), find.camera)
    motion = motion.rereferenced(reference or motion.reference)
    motion = fitted(motion, *map_size) if map_size else motion
    PixelMap.of(motion, inverse).save(target, overwrite)
    return motion


def _parse_size(size: str) -> tuple[int, int]:
    """Parses a size of the form WxH into (height, width)."""
    sides = size.lower().split("x")
    if len(sides) != 2 or not all(side.isascii() and side.isdigit() and 1 <= len(side) <= 9 for side in sides):
        raise UsageError(f"cannot understand the size '{size}': write it like 1920x1080")
    width, height = map(int, sides)
    if not 1 <= width * height <= MAX_PIXELS:
        raise UsageError(f"a map of {size} px cannot be made: it must have 1 to {MAX_PIXELS:,} pixels")
    return height, width


def check_map_target(target: Path, overwrite: bool, original: Path | None = None) -> None:
    """Checks that a map can be written to a file name.

    Raises:
        UsageError: unknown extension; UnshutterError: see :func:`unshutter.storage.files.check_target`, or
            the package that writes EXR is missing.

    Examples:
        >>> check_map_target(Path("map.jpg"), overwrite=False)
        Traceback (most recent call last):
        unshutter.errors.UsageError: cannot write a map to map.jpg: its extension must be one of .npz, .exr, .tif, .tiff
    """
    suffix = target.suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(f"cannot write a map to {target}: its extension must be one of {', '.join(SUFFIXES)}")
    Protection([original]).check(target)
    check_target(target, overwrite)
    if suffix == ".exr":
        _openexr()


def _openexr():
    try:
        import OpenEXR
    except ImportError:
        raise UnshutterError(f"EXR files need the extra: {installation.extra('exr')} (or write .tif)") from None
    return OpenEXR


def _write_exr(path: Path, st: np.ndarray) -> None:
    exr = _openexr()
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    channels = {name: np.ascontiguousarray(st[..., k]) for k, name in enumerate("RGB")}
    try:
        with exr.File(header, channels) as file:
            file.write(str(path))
    except (RuntimeError, ValueError) as error:
        raise UnshutterError(f"cannot write the EXR file: {' '.join(str(error).split())}") from None


def _write_tiff(path: Path, st: np.ndarray) -> None:
    with refusing("cannot write the TIFF file"):
        image = libvips().Image.new_from_array(st).copy(interpretation="srgb")  # otherwise written as linear light
        image.tiffsave(str(path), compression="deflate")  # no predictor: not all readers support it for floats
