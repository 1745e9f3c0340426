"""The pixels of a clip's frames: their planes as arrays, small grey copies, and the way up."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import cv2
import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.pyav import av, side_data
from unshutter.photo.code_points import CodePoints, for_screen
from unshutter.photo.libvips import as_image

if TYPE_CHECKING:
    from av import VideoFormat, VideoFrame

    from unshutter.motion.shapes import UInt, UInt8

COLOURS = ("color_range", "color_primaries", "color_trc", "colorspace")
LIMITED_RANGE, FULL_RANGE = 1, 2  # FFmpeg's codes
# Combing is looked for in blocks [rows, columns], of every third column, that differ from rows next to them by so much
# [8-bit steps]; frames have it if so large a share of these differ more from rows of the other field than of their own
_BLOCK, _SEEN, _OTHER_FIELD, _COMBED = (8, 11), 4.0, 1.3, 0.02


@dataclass(frozen=True, eq=False)
class ArrayFrame:
    """A frame that the caller decodes."""

    pixels: UInt[np.ndarray, "height width *bands"]
    time: float  # time at which it is shown [s]
    time_base: None = None  # unit of that time: it is exact

    @property
    def height(self) -> int:
        """Rows [px]."""
        return self.pixels.shape[0]

    @property
    def width(self) -> int:
        """Columns [px]."""
        return self.pixels.shape[1]


Frame: TypeAlias = "VideoFrame | ArrayFrame"


def is_damaged(frame: Frame) -> bool:
    """Whether a frame was decoded from damaged data."""
    return not isinstance(frame, ArrayFrame) and frame.is_corrupt


def of_file(frame: Frame) -> VideoFrame:
    """Returns a frame of a clip's file, as PyAV decoded it."""
    assert not isinstance(frame, ArrayFrame)
    return frame


@dataclass(frozen=True)
class Plane:
    """Storage of one plane of a pixel format."""

    bands: int  # consecutive values per pixel: 3 in packed RGB, 2 in the chroma of NV12
    across: int  # columns of the frame per column of the plane
    down: int  # rows of the frame per row of the plane
    black: int  # value of black in limited-range frames
    black_full: int  # value of black in full-range frames


@dataclass(frozen=True)
class PixelFormat:
    """A pixel format whose planes can be warped."""

    name: str  # FFmpeg's name of the format; of arrays, that of their type
    depth: int  # bits per value
    planes: tuple[Plane, ...]  # in the order of the format

    @classmethod
    def of(cls, pixel_format: VideoFormat | None) -> PixelFormat:
        """Returns the planes of an FFmpeg pixel format."""
        if pixel_format is None:
            raise UnshutterError("the clip does not state its pixel format")
        name = pixel_format.name
        components = pixel_format.components
        by_plane = [[c for c in components if c.plane == k] for k in range(1 + max(c.plane for c in components))]
        depth = components[0].bits
        odd = any(len({(c.bits, c.width) for c in inside}) > 1 for inside in by_plane)
        packed = max(map(len, by_plane)) > 1
        if odd or pixel_format.has_palette or pixel_format.is_bit_stream or not 8 <= depth <= 16 or name.endswith("be"):
            raise UnshutterError(f"cannot process the pixel format {name}: convert the clip to yuv420p first")
        if packed and depth not in (8, 16):  # P010 and similar formats place their bits differently
            raise UnshutterError(f"cannot process the pixel format {name}: convert the clip to yuv420p10le first")
        planes = []
        for k, inside in enumerate(by_plane):
            across = -(-pixel_format.width // inside[0].width)
            down = -(-pixel_format.height // inside[0].height)
            chroma = not pixel_format.is_rgb and k in (1, 2)
            luma = not pixel_format.is_rgb and k == 0
            black = (1 << depth) // 2 if chroma else 0
            planes.append(Plane(len(inside), across, down, (1 << depth) // 16 if luma else black, black))
        return cls(name, depth, tuple(planes))

    @classmethod
    def of_array(cls, pixels: UInt[np.ndarray, "height width *bands"]) -> PixelFormat:
        """Returns the format of frames that are arrays like this one."""
        bands = pixels.shape[2] if pixels.ndim == 3 else 1
        return cls(str(pixels.dtype), 8 * pixels.itemsize, (Plane(bands, 1, 1, black=0, black_full=0),))

    def arrays(self, frame: Frame) -> list[UInt[np.ndarray, "rows columns *bands"]]:
        """Returns the planes of a frame: views of its memory, valid as long as the frame exists."""
        if isinstance(frame, ArrayFrame):
            return [frame.pixels]
        dtype = np.dtype(np.uint8 if self.depth == 8 else "<u2")
        views = []
        for stored, plane in zip(frame.planes, self.planes, strict=True):
            shape = (-(-frame.height // plane.down), -(-frame.width // plane.across))
            size = dtype.itemsize
            strides = (stored.line_size, plane.bands * size)
            if plane.bands > 1:
                shape = (*shape, plane.bands)
                strides = (*strides, size)
            views.append(np.ndarray(shape, dtype, buffer=memoryview(stored), strides=strides))
        return views

    def blank(self, like: Frame, height: int, width: int) -> Frame:
        """Returns a new frame with the time and colour tags of another one; its pixels are uninitialised."""
        if isinstance(like, ArrayFrame):
            return ArrayFrame(np.empty((height, width, *like.pixels.shape[2:]), like.pixels.dtype), like.time)
        picture = av().VideoFrame(width, height, self.name)
        picture.pts = like.pts
        picture.time_base = like.time_base
        for name in COLOURS:
            setattr(picture, name, getattr(like, name))
        return picture

    def is_full_range(self, frame: Frame) -> bool:
        """Whether 0 is black in a frame."""
        return isinstance(frame, ArrayFrame) or frame.color_range == FULL_RANGE or self.name.startswith("yuvj")

    def is_combed(self, frame: Frame) -> bool:
        """Whether rows of a frame show two moments: where the picture moves, every other row lies apart.

        Of twelve real clips, up to 0.2 % of the blocks of a frame look so; with rows of two frames, usually 5 to 90 %.
        """
        luma = self.arrays(frame)[0][:, ::3]
        luma = (luma if luma.ndim == 2 else luma[..., 0]).astype(np.float32) / (1 << self.depth - 8)
        middle = luma[2:-2]
        unlike = []
        for far in (1, 2):
            around = (luma[2 - far : -2 - far] + luma[2 + far : len(luma) - 2 + far]) / 2
            rows, columns = (size // by for size, by in zip(middle.shape, _BLOCK, strict=True))
            if not rows or not columns:
                return False
            apart = np.abs(middle - around)[: rows * _BLOCK[0], : columns * _BLOCK[1]]
            unlike.append(apart.reshape(rows, _BLOCK[0], columns, _BLOCK[1]).mean(axis=(1, 3)))
        other, own = unlike
        seen = np.maximum(other, own) > _SEEN
        return bool(np.sum(seen & (other > _OTHER_FIELD * own)) > _COMBED * max(np.sum(seen), 1))


def small_grey(
    plane: UInt[np.ndarray, "height width *bands"], side: int, depth: int
) -> UInt8[np.ndarray, "rows columns"]:
    """Returns a small grey copy of a plane: of luma, of packed luma and chroma, or of red, green and blue."""
    luma = plane
    if luma.ndim == 3:
        luma = luma[..., 1] if luma.shape[2] > 2 else luma[..., 0]
    scale = min(1.0, side / min(luma.shape))
    size = (max(1, round(luma.shape[1] * scale)), max(1, round(luma.shape[0] * scale)))
    luma = luma if luma.strides[1] == luma.itemsize else np.ascontiguousarray(luma)
    while min(luma.shape) >= 2 * side and not (luma.shape[0] % 2 or luma.shape[1] % 2):
        luma = np.asarray(cv2.resize(luma, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    # where pixels are hardly larger, taking the mean of areas takes five times as long as interpolating
    mean = cv2.INTER_AREA if min(luma.shape) > 1.5 * side else cv2.INTER_LINEAR
    small = np.asarray(cv2.resize(luma, size, interpolation=mean))
    return np.right_shift(small, depth - 8, dtype=small.dtype, casting="unsafe").astype(np.uint8)


def in_srgb(frame: VideoFrame, width: int, height: int) -> UInt8[np.ndarray, "{height} {width} 3"]:
    """Returns a frame for a screen, of a size; HDR is reduced to SDR."""
    code_points = CodePoints(int(frame.color_primaries), int(frame.color_trc))
    if not code_points.is_hdr:
        return frame.reformat(width, height, format="rgb24").to_ndarray()
    pixels = frame.reformat(width, height, format="rgb48le").to_ndarray()
    return for_screen(as_image(pixels), code_points).numpy()


def upright(pixels: UInt8[np.ndarray, "rows columns 3"], turned_as: VideoFrame) -> UInt8[np.ndarray, "height width 3"]:
    """Returns pixels rotated, and mirrored, as a frame is to be shown by the display matrix that its file states.

    A pixel at (column, row) is shown at (a column + c row, b column + d row).
    """
    matrix = side_data(turned_as).get("DISPLAYMATRIX", b"")
    if len(matrix) < 36:
        return pixels
    a, b, _, c, d, *_ = struct.unpack("=9i", matrix[:36])
    across, down = (a, d) if abs(a) + abs(d) >= abs(b) + abs(c) else (c, b)
    shown = pixels if (across, down) == (a, d) else np.swapaxes(pixels, 0, 1)
    return np.ascontiguousarray(shown[:: -1 if down < 0 else 1, :: -1 if across < 0 else 1])
