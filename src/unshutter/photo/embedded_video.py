"""The video that belongs to a photo: in its file (Google's and Samsung's phones) or next to it (Apple's).

In a HEIC, the video is the content of the box mpvd. In a JPEG, it follows the picture: Google's extends to the end of
the file. Samsung's is in a trailer: blocks with a number and a name, followed by a directory at the very end with the
distance from the directory back to the start of each block. Thus the trailer can be moved as a whole, and blocks can
be left out. A Live Photo and its video hold the same content identifier, the photo in its maker note, the video under a
key of QuickTime's metadata.

Source: Google, Motion Photo format 1.0; Apple, Live Photos; for the trailer and the identifiers, ExifTool's description
of these tags (facts only).
"""

from __future__ import annotations

import io
import re
import struct
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from unshutter.photo import boxes, maker_notes
from unshutter.photo.parts import OTHER
from unshutter.photo.xmp import VideoPlace

if TYPE_CHECKING:
    from unshutter.photo.libvips import Source

_VIDEO = 0x0A30  # number of the block MotionPhoto_Data
# Blocks that remain valid for new pixels: the video's version, how to play it, when and in which country it was taken.
_STILL_VALID = (_VIDEO, 0x0A31, 0x0A33, 0x0A01, 0x0AA1)
_HEAD = b"SEFH"
_FOOT = b"SEFT"
_BOX = b"mpvd"  # in a HEIC
_MOMENT = rb"""(?:MotionPhoto|MicroVideo)PresentationTimestampUs\s*(?:=\s*["']|>)\s*(\d{1,12})\b"""


_SUFFIXES = (".mov", ".MOV", ".Mov")  # of a video next to its photo


class EmbeddedVideo(NamedTuple):
    """A video that belongs to a photo."""

    place: bytes | Path  # an MP4 file in memory, or the path of a QuickTime file
    moment_s: float | None = None  # time at which the photo was taken, in the video's time [s]; None: unknown
    identifier: str = ""  # content identifier that the video must have; empty: any


def embedded_video(
    source: Source | None, format: str, appended: AppendedVideo | None, xmp: bytes | None, exif: bytes | None
) -> EmbeddedVideo | None:
    """Finds the video that belongs to a photo; returns None if there is none.

    Without a source, the photo has new pixels; ``appended`` is the video that follows the picture.
    """
    inside = appended and appended.content
    if source is not None and format == "heic":
        inside = _video_in_boxes(source)
    if inside is not None:
        moment = re.search(_MOMENT, xmp or b"")
        return EmbeddedVideo(inside, int(moment[1]) / 1e6 if moment else None)
    others = videos_beside(source.opened.path) if source is not None and source.opened is not None else []
    place = next((other for other in others if other.is_file()), None)
    identifier = maker_notes.apple(exif).text(maker_notes.APPLE_CONTENT_IDENTIFIER) if place is not None else ""
    return EmbeddedVideo(place, None, identifier) if place is not None and identifier else None


def videos_beside(photo: Path) -> list[Path]:
    """Returns the names that a video next to a photo may have."""
    return [photo.with_suffix(suffix) for suffix in _SUFFIXES if photo.name]


def _video_in_boxes(source: Source) -> bytes | None:
    with source.stream() as file:
        for name, start, end in boxes.top_level_extents(file):
            if name == _BOX and end - start <= 1 << 28:
                file.seek(start)
                data = file.read(end - start)
                return data if _is_video(data) else None
    return None


def _is_video(data: bytes) -> bool:
    return data[4:8] == b"ftyp"


# ---- videos that follow the picture of a JPEG -----------------------------------------------------------


class AppendedVideo(NamedTuple):
    """A motion photo's video, and the data around it."""

    data: bytes  # everything that follows the picture
    at: int  # start of the video in these data
    length: int  # length of the video [bytes]
    taken_from: int  # number of bytes at the end of the old file that these data come from
    left_behind: tuple[str, ...] = ()  # names of blocks that were valid only for the old pixels

    @property
    def content(self) -> bytes:
        """The video's own data."""
        return self.data[self.at : self.at + self.length]

    @property
    def place(self) -> VideoPlace:
        """The position of the video."""
        return VideoPlace(self.at, self.length, len(self.data) - self.at)


class _Block(NamedTuple):
    """A block of a trailer, as listed in its directory."""

    kind: int
    data: bytes  # kind, length of the name, name, content

    @property
    def content_at(self) -> int:
        return 8 + int.from_bytes(self.data[4:8], "little")


def appended_video(file: BinaryIO, video_bytes: int | None) -> AppendedVideo | None:
    """Finds the video of a JPEG, at the end of the file if XMP states its length; returns None if there is none."""
    in_trailer = _in_trailer(file)
    if in_trailer is not None:
        return in_trailer
    if not video_bytes or video_bytes >= file.seek(0, io.SEEK_END):
        return None
    file.seek(-video_bytes, io.SEEK_END)
    data = file.read(video_bytes)
    return AppendedVideo(data, 0, video_bytes, video_bytes) if _is_video(data) else None


def _in_trailer(file: BinaryIO) -> AppendedVideo | None:
    """Returns the video from Samsung's trailer, with the blocks that remain valid; None if there is none."""
    version, blocks, length = _blocks(file)
    video = next((block for block in blocks if block.kind == _VIDEO), None)
    if video is None or not _is_video(video.data[video.content_at :]):
        return None
    kept = [block for block in blocks if block.kind in _STILL_VALID]
    before = sum(len(block.data) for block in kept[: kept.index(video)])
    gone = tuple(
        "depth map" if b"DepthMap" in block.data else OTHER for block in blocks if block.kind not in _STILL_VALID
    )
    return AppendedVideo(
        _trailer(version, kept), before + video.content_at, len(video.data) - video.content_at, length, gone
    )


def _blocks(file: BinaryIO) -> tuple[int, list[_Block], int]:
    """Returns the version of a trailer, its blocks in order, and its length [bytes].

    There are no blocks if the trailer is missing or inconsistent.
    """
    end = file.seek(0, io.SEEK_END) - 8
    file.seek(max(end, 0))
    foot = file.read(8)
    length = int.from_bytes(foot[:4], "little")
    if foot[4:] != _FOOT or not 12 <= length <= min(1 << 16, end):
        return 0, [], 0
    file.seek(end - length)
    directory = file.read(length)
    version, count = struct.unpack_from("<II", directory, 4)
    if not directory.startswith(_HEAD) or 12 + 12 * count > length:
        return 0, [], 0
    entries = [struct.unpack_from("<2xHII", directory, 12 + 12 * k) for k in range(count)]
    blocks = []
    free = end - length  # bytes before the directory that are not yet assigned to a block
    for kind, before, size in sorted(entries, key=lambda entry: -entry[1]):
        if not 8 <= size <= before <= free:
            return 0, [], 0
        file.seek(end - length - before)
        blocks.append(_Block(kind, file.read(size)))
        free = before - size
        if blocks[-1].content_at > size:
            return 0, [], 0
    return version, blocks, 8 + length + max((before for _, before, _ in entries), default=0)


def _trailer(version: int, blocks: list[_Block]) -> bytes:
    directory = [_HEAD, struct.pack("<II", version, len(blocks))]
    before = sum(len(block.data) for block in blocks)
    for block in blocks:
        directory.append(struct.pack("<2xHII", block.kind, before, len(block.data)))
        before -= len(block.data)
    length = sum(map(len, directory))
    return b"".join([*(block.data for block in blocks), *directory, struct.pack("<I", length), _FOOT])
