"""HDR metadata of single frames: HDR10+, HDR Vivid and Dolby Vision are copied from a clip's packets to the new ones.

Encoders drop them. They state how bright a frame is, not where: new frames of the same size may have them, too.

Sources: ITU-T H.265 (NAL units, SEI), ITU-T T.35; SMPTE ST 2094-40 (HDR10+); Dolby Vision Streams Within the ISO Base
Media File Format; AV1 Bitstream & Decoding Process Specification (metadata OBUs).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from unshutter.errors import UnshutterError
from unshutter.frames.pyav import av

if TYPE_CHECKING:
    from av import Packet


_START = b"\0\0\0\1"  # of a NAL unit
_VIDEO_LAYERS = 32  # lower types of NAL units hold pixels
_SEI, _RPU = 39, 62  # types of NAL units before and behind those
_T35 = 4  # kind of SEI messages, and of AV1's metadata
# how these messages begin: country, provider and, in HEVC, what it is
_HDR10_PLUS, _VIVID, _DOLBY = b"\xb5\x00\x3c\x00\x01\x04", b"\x26\x00\x04\x00\x05", b"\xb5\x00\x3b"
_METADATA = 5  # type of an OBU
_BEFORE_METADATA = (1, 2)  # types of OBUs: sequence header, temporal delimiter
DOLBY_BOXES = (b"dvcC", b"dvvC", b"dvwC")  # of a sample entry: the configuration of Dolby Vision
_NO_BASE_LAYER = (5, 10, 20)  # profiles that may have colours of their own
_PLAIN_LAYERS = (8, 9, 10)  # profiles whose only layer is a picture that anything shows
_ENCODERS = {"hevc": "libx265", "av1": "libsvtav1", "libdav1d": "libsvtav1"}


@dataclass(frozen=True)
class DolbyVision:
    """What a clip states of its Dolby Vision."""

    profile: int
    shows_itself: bool  # whether the frames are a picture in HDR10, HLG or SDR

    @classmethod
    def of(cls, side_data: dict[str, bytes], descriptions: Iterable[tuple[bytes, bytes]]) -> DolbyVision | None:
        """Returns that of a clip, from its first frame's side data and the boxes of its sample entry."""
        for name, content in descriptions:
            if name in DOLBY_BOXES and len(content) >= 5 and content[2] >> 1:
                profile = content[2] >> 1
                return cls(profile, profile not in _NO_BASE_LAYER or content[4] >> 4 > 0)
        metadata = side_data.get("DOVI_METADATA", b"")
        start = struct.unpack_from("=Q", metadata)[0] if len(metadata) >= 8 else 0
        header = metadata[start : start + 17]
        if not start or len(header) < 17:
            return None
        is_own, has_residual = header[4] == 0 and header[10] == 1, header[15] and not header[16]
        return cls(5, False) if is_own else cls(7 if has_residual else 8, True)

    def check(self, place: str) -> None:
        """Raises UnshutterError if the frames have wrong colours without the metadata."""
        if not self.shows_itself:
            raise UnshutterError(
                f"{{clip}} is Dolby Vision of profile {self.profile}, whose colours are wrong without its metadata: "
                "convert it to HDR10, HLG or SDR first",
                clip=place,
            )


@dataclass
class DynamicHdr:
    """Copies the metadata of frames, found by their times, from a clip's packets to new ones of the same codec."""

    is_av1: bool
    length_bytes: int  # of the lengths before NAL units; 0 if start codes separate them
    with_dolby_vision: bool
    has_dolby_vision: bool = False  # whether the new frames have it
    _of_frames: dict[int, list[bytes]] = field(default_factory=dict)  # by time [ticks of the clip]
    _of_packets: dict[int, list[bytes]] = field(default_factory=dict)  # by time [ticks of the encoder]

    @classmethod
    def between(cls, video: Any, encoder: str, dolby_vision: DolbyVision | None) -> DynamicHdr | None:
        """Returns what copies from a stream to an encoder's; None if that writes another codec."""
        name = video.codec_context.name
        if _ENCODERS.get(name) != encoder:
            return None
        extra = video.codec_context.extradata or b""
        lengths = (extra[21] & 3) + 1 if len(extra) > 21 and extra[0] == 1 else 0
        with_dolby_vision = dolby_vision is not None and dolby_vision.profile in _PLAIN_LAYERS
        return cls(encoder == "libsvtav1", lengths, with_dolby_vision)

    def read(self, packet: Packet) -> None:
        """Takes the metadata from a packet of the clip."""
        data = bytes(packet)
        if packet.pts is None or not data:
            return
        found = list(self._of_av1(data) if self.is_av1 else self._of_hevc(data))
        if found:
            self._of_frames[packet.pts] = found

    def follow(self, before: int | None, after: int) -> None:
        """Notes that the frame of a time of the clip is encoded with another time [ticks]."""
        found = self._of_frames.pop(before, None) if before is not None else None
        if found is not None:
            self._of_packets[after] = found

    def completed(self, packet: Packet) -> Packet:
        """Returns a new packet with its frame's metadata."""
        found = self._of_packets.pop(packet.pts, None) if packet.pts is not None else None
        if found is None:
            return packet
        data = bytes(packet)
        new = av().Packet(_with_obus(data, found) if self.is_av1 else _with_units(data, found))
        for name in ("pts", "dts", "duration", "time_base", "is_keyframe"):
            setattr(new, name, getattr(packet, name))
        self.has_dolby_vision |= any(_is_dolby(each, self.is_av1) for each in found)
        return new

    def _of_hevc(self, data: bytes) -> Iterator[bytes]:
        for unit in _units(data, self.length_bytes):
            kind = unit[0] >> 1 & 0x3F
            if kind == _RPU and self.with_dolby_vision:
                yield unit
            elif kind == _SEI and (messages := [m for m in _messages(unit) if m.startswith((_HDR10_PLUS, _VIVID))]):
                yield unit[:2] + _escaped(b"".join(map(_message, messages)) + b"\x80")

    def _of_av1(self, data: bytes) -> Iterator[bytes]:
        for kind, start, content, end in _obus(data):
            if kind != _METADATA or data[content : content + 1] != bytes([_T35]):
                continue
            is_dolby = data.startswith(_DOLBY, content + 1)
            if (is_dolby and self.with_dolby_vision) or data.startswith((_HDR10_PLUS, _VIVID), content + 1):
                yield data[start:end]


def _is_dolby(unit: bytes, is_av1: bool) -> bool:
    return _DOLBY in unit[:16] if is_av1 else unit[0] >> 1 & 0x3F == _RPU


# ---- HEVC --------------------------------------------------------------------------------------------------------


def _units(data: bytes, length_bytes: int) -> Iterator[bytes]:
    """Yields the NAL units of a packet."""
    if not length_bytes:
        yield from filter(None, (each.rstrip(b"\0") for each in re.split(b"\0\0\1", data)))
        return
    at = 0
    while at + length_bytes < len(data):
        size = int.from_bytes(data[at : at + length_bytes], "big")
        at += length_bytes
        if len(data[at : at + size]) > 2:
            yield data[at : at + size]
        at += size


def _messages(unit: bytes) -> Iterator[bytes]:
    """Yields the contents of the T.35 messages in a unit of SEI."""
    data = re.sub(b"\0\0\3(?=[\0-\3]|$)", b"\0\0", unit[2:])
    at = 0
    while at + 2 < len(data):
        kind, at = _number(data, at)
        size, at = _number(data, at)
        if kind == _T35:
            yield data[at : at + size]
        at += size


def _number(data: bytes, at: int) -> tuple[int, int]:
    """Returns a kind or size of a message, and where it ends."""
    value = 0
    while data[at : at + 1] == b"\xff":
        value += 255
        at += 1
    return value + (data[at] if at < len(data) else 0), at + 1


def _message(content: bytes) -> bytes:
    return bytes([_T35]) + b"\xff" * (len(content) // 255) + bytes([len(content) % 255]) + content


def _escaped(data: bytes) -> bytes:
    """Returns the content of a unit in which nothing looks like a start code."""
    return re.sub(b"\0\0(?=[\0-\3])", b"\0\0\3", data)


def _with_units(data: bytes, added: list[bytes]) -> bytes:
    """Returns a packet of libx265, with start codes, and further units where they belong."""
    before = b"".join(_START + each for each in added if each[0] >> 1 & 0x3F == _SEI)
    behind = b"".join(_START + each for each in added if each[0] >> 1 & 0x3F == _RPU)
    starts = re.finditer(b"\0?\0\0\1(.)", data, re.DOTALL)
    first = next((each.start() for each in starts if each[1][0] >> 1 < _VIDEO_LAYERS), len(data))
    return data[:first] + before + data[first:] + behind


# ---- AV1 ---------------------------------------------------------------------------------------------------------


def _obus(data: bytes) -> Iterator[tuple[int, int, int, int]]:
    """Yields type, start, start of the content and end of the OBUs of a packet, as far as they have sizes."""
    at = 0
    while at < len(data) and data[at] & 2:
        start, size, shift = at, 0, 0
        at += 2 if data[start] & 4 else 1
        while at < len(data):
            size |= (data[at] & 0x7F) << shift
            shift += 7
            at += 1
            if data[at - 1] < 0x80:
                break
        yield data[start] >> 3 & 15, start, at, at + size
        at += size


def _with_obus(data: bytes, added: list[bytes]) -> bytes:
    """Returns a packet with OBUs before the first frame."""
    first = next((start for kind, start, _, _ in _obus(data) if kind not in _BEFORE_METADATA), 0)
    return data[:first] + b"".join(added) + data[first:]
