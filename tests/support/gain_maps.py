"""HDR photos of our own: JPEG, AVIF and HEIC with gain maps, as phones write them, and their light."""

import io
import struct

import cv2
import numpy as np
from PIL import Image

from support.camera_files import heic
from support.drawn_photos import encoded
from support.maker_notes import directory
from support.motion_photos import packet
from support.tagged_files import exif_blob
from unshutter import Photo
from unshutter.photo import boxes

STOPS = 3.0  # by which the brightest pixels of a map are brighter in HDR
ISO = b"urn:iso:std:iso:ts:21496:-1\0"
OF_APPLES_MAP = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description xmlns:apdi="http://ns.apple.com/pixeldatainfo/1.0/" '
    b'xmlns:HDRGainMap="http://ns.apple.com/HDRGainMap/1.0/" HDRGainMap:HDRGainMapVersion="131072" '
    b'HDRGainMap:HDRGainMapHeadroom="8" '
    b'apdi:AuxiliaryImageType="urn:com:apple:photo:2020:aux:hdrgainmap"/></rdf:RDF></x:xmpmeta>'
)
# what OF_MAP says, in ISO's form: versions, flags (in the base picture's colours), headrooms; least and greatest gain,
# gamma, offsets
ISO_OF_MAP = struct.pack(">HHB14I", 0, 0, 0x40, 0, 1, int(STOPS), 1, 0, 1, int(STOPS), 1, 1, 1, 0, 1, 0, 1)
XMP_PREFIX = b"http://ns.adobe.com/xap/1.0/\0"
OF_MAP = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0" hdrgm:GainMapMin="0" '
    b'hdrgm:GainMapMax="%g" hdrgm:Gamma="1" hdrgm:OffsetSDR="0" hdrgm:OffsetHDR="0" hdrgm:HDRCapacityMin="0" '
    b'hdrgm:HDRCapacityMax="%g" hdrgm:BaseRenditionIsHDR="False"/></rdf:RDF></x:xmpmeta>' % (STOPS, STOPS)
)


def segment(marker: int, content: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content


def scene(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """The SDR picture [H, W, 3] and the gain [H, W] of its light in stops: lamps before a wall with stripes."""
    row, col = np.mgrid[0:height, 0:width] / min(height, width)
    wall = 0.35 + 0.25 * np.sin(9 * col + 4 * row)
    lamps = sum(np.exp(-((row - y) ** 2 + (col - x) ** 2) / 0.01) for y, x in ((0.3, 0.35), (0.6, 0.8), (0.8, 0.2)))
    grey = np.clip(wall + lamps, 0, 1)
    picture = np.stack([grey, grey**1.2, grey**0.9], axis=-1)
    return np.round(255 * picture).astype(np.uint8), STOPS * np.clip(lamps, 0, 1)


def hdr_photo(
    height: int = 240,
    width: int = 320,
    map_size: tuple[int, int] = (60, 80),
    bands: int = 1,
    order: str = ">",
    of_map: bytes = OF_MAP,
    depth: bytes = b"",
    iso: bytes = bytes(range(60)),
    picture: tuple[np.ndarray, np.ndarray] | None = None,
) -> bytes:
    """Returns an Ultra HDR photo whose list of pictures (MPF) has a byte order; a depth map may follow its gain map.

    It shows a picture with its gain, by default those of a scene.
    """
    base, gain = picture or scene(height, width)
    small = cv2.resize(gain, map_size[::-1], interpolation=cv2.INTER_AREA) / STOPS
    pixels = np.round(255 * np.stack([small] * bands, axis=-1)).astype(np.uint8)
    metadata = segment(0xE1, XMP_PREFIX + of_map) + (segment(0xE2, ISO + iso) if iso else b"")
    gain_map = with_segments(encoded(pixels[..., 0] if bands == 1 else pixels, "JPEG", quality=98), metadata)
    items = "".join(
        '<rdf:li rdf:parseType="Resource"><Container:Item Item:Mime="image/jpeg" '
        f'Item:Semantic="{name}"{length}/></rdf:li>'
        for name, length in (("Primary", ""), ("GainMap", f' Item:Length="{len(gain_map)}"'))
    )
    front = segment(0xE1, b"Exif\0\0" + exif_blob().removeprefix(b"Exif\0\0"))
    front += segment(0xE1, XMP_PREFIX + packet(items, 'hdrgm:Version="1.0"')) + (
        segment(0xE2, ISO + bytes(4)) if iso else b""
    )
    first = encoded(base, "JPEG", quality=97, subsampling="4:4:4")
    behind = [gain_map, depth] if depth else [gain_map]
    entries = 16 * (1 + len(behind))
    length = len(first) + len(front) + 4 + 4 + 50 + entries
    starts = [0, length - (2 + len(front) + 8)]
    starts += [starts[1] + len(gain_map)]
    sizes = [length, *map(len, behind)]
    table = b"".join(
        struct.pack(order + "IIIHH", 0x030000 if not start else 0, size, start, 0, 0)
        for size, start in zip(sizes, starts, strict=False)
    )
    mpf = (b"MM\0*" if order == ">" else b"II*\0") + struct.pack(order + "IH", 8, 3)
    mpf += struct.pack(order + "HHI4s", 0xB000, 7, 4, b"0100") + struct.pack(order + "HHII", 0xB001, 4, 1, len(sizes))
    mpf += struct.pack(order + "HHIII", 0xB002, 7, entries, 50, 0) + table
    return with_segments(first, front + segment(0xE2, b"MPF\0" + mpf)) + b"".join(behind)


def heic_with_gain_map(pixels: np.ndarray, orientation: int = 1) -> bytes:
    """A HEIC of RGB pixels and a gain map as large, their fourth channel: libheif takes it for an auxiliary picture."""
    return heic(pixels, orientation).replace(b"urn:mpeg:hevc:2015:auxid:1", b"urn:com:a:2020::hdrgainmap")


def apples_exif(headroom: float, gain: float) -> bytes:
    """EXIF with an iPhone's maker note that says how bright a gain map is."""
    numbers = [struct.pack(">ii", round(1e6 * each), 1_000_000) for each in (headroom, gain)]
    note = b"Apple iOS\0\0\1MM" + directory(">", 14, (33, 10, numbers[0]), (48, 10, numbers[1]))
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x927C] = note
    return b"Exif\0\0" + exif.tobytes().removeprefix(b"Exif\0\0")


def with_tone_map(
    base: bytes,
    gain_map: bytes,
    metadata: bytes = ISO_OF_MAP,
    brand: bytes = b"tmap",
    primaries: int = 1,
    of_apple: bytes = b"",
) -> bytes:
    """An AVIF or HEIC with a gain map by ISO 21496-1, made of two of one picture each; it is no auxiliary picture.

    With XMP ``of_apple``, the map is an auxiliary picture as iPhones write it, instead.
    """
    kind = b"hvc1" if b"hvc1" in base else b"av01"
    properties, numbers, coded = [], [], []
    for data in (base, gain_map):
        meta = boxes.in_meta(io.BytesIO(data))
        own = list(boxes.inside(dict(boxes.inside(meta[b"iprp"]))[b"ipco"]))
        numbers.append(bytes(range(len(properties) + 1, len(properties) + len(own) + 1)))
        properties += own
        place = boxes.extent(io.BytesIO(data), kind)
        coded.append(data[place.at : place.at + place.length])
    size = 1 + [name for name, _ in properties].index(b"ispe")
    properties.append((b"colr", b"nclx" + struct.pack(">HHHB", primaries, 16, 6, 0x80)))
    numbers.insert(1, bytes([size, len(properties)]))
    coded.insert(1, of_apple or b"\0" + metadata)
    about = b"mime\0application/rdf+xml\0" if of_apple else b"tmap\0"
    references = _box(b"dimg", struct.pack(">HHHH", 2, 2, 1, 3))
    if of_apple:
        properties.append((b"auxC", bytes(4) + b"urn:com:apple:photo:2020:aux:hdrgainmap\0"))
        numbers[1:] = [b"", numbers[2] + bytes([len(properties)])]
        references = b"".join(
            _box(name, struct.pack(">HHH", of, 1, to)) for name, of, to in ((b"auxl", 3, 1), (b"cdsc", 2, 3))
        )
    infe = [(0, 1, kind + b"\0"), (0, 2, about), (1, 3, kind + b"\0")]  # the map is hidden
    iinf = b"".join(_box(b"infe", struct.pack(">BBHHH", 2, 0, flag, item, 0) + of) for flag, item, of in infe)
    ipma = b"".join(struct.pack(">HB", item, len(own)) + own for item, own in enumerate(numbers, 1))
    iprp = _box(b"ipco", b"".join(_box(*each) for each in properties)) + _box(b"ipma", struct.pack(">II", 0, 3) + ipma)
    ftyp = _box(b"ftyp", base[8 : struct.unpack_from(">I", base)[0]] + brand)
    start = 0
    for _ in range(2):  # positions are known when the box that has them is
        places, at = b"", start
        for item, data in enumerate(coded, 1):
            places += struct.pack(">HHHII", item, 0, 1, at, len(data))
            at += len(data)
        parts = {
            b"hdlr": struct.pack(">II4s13x", 0, 0, b"pict"),
            b"pitm": struct.pack(">IH", 0, 1),
            b"iloc": struct.pack(">IBBH", 0, 0x44, 0, 3) + places,
            b"iinf": struct.pack(">IH", 0, 3) + iinf,
            b"iref": bytes(4) + references,
            b"iprp": iprp,
            b"grpl": _box(b"altr", struct.pack(">5I", 0, 4, 2, 2, 1)),
        }
        head = ftyp + _box(b"meta", bytes(4) + b"".join(_box(*each) for each in parts.items()))
        start = len(head) + 8
    return head + _box(b"mdat", b"".join(coded))


def _box(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), name) + content


def with_segments(data: bytes, segments: bytes) -> bytes:
    return data[:2] + segments + data[2:]


def pictures_of(data: bytes) -> list[bytes]:
    """Returns the pictures in a file, by its list of them (MPF)."""
    at = data.index(b"MPF\0") + 4
    order = {b"MM": ">", b"II": "<"}[data[at : at + 2]]
    entries = data.index(struct.pack(order + "HH", 0xB002, 7), at)
    size, place = struct.unpack_from(order + "II", data, entries + 4)
    found = []
    for entry in range(at + place, at + place + size, 16):
        _, length, start = struct.unpack_from(order + "III", data, entry)
        start += at if start else 0
        found.append(data[start : start + length])
    return found


def segments_of(data: bytes) -> list[bytes]:
    """Returns the contents of a JPEG's application segments but JFIF."""
    at, found = 2, []
    while data[at + 1] != 0xDA:
        length = struct.unpack_from(">H", data, at + 2)[0]
        content = data[at + 4 : at + 2 + length]
        if 0xE0 < data[at + 1] <= 0xEF:
            found.append(content)
        at += 2 + length
    return found


def pixels_of(data: bytes) -> np.ndarray:
    """Returns the first picture of a JPEG [H, W, 3] in RGB, or [H, W] if it is grey."""
    found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    return found if found.ndim == 2 else found[..., ::-1]


def light_of(data: bytes) -> np.ndarray:
    """Returns the HDR light [H, W, 3] of a photo, 1 is SDR white: by the definition of gain maps (Ultra HDR)."""
    if data.startswith(b"\xff\xd8"):
        base, gain_map = (pixels_of(picture) / 255 for picture in pictures_of(data)[:2])
    else:
        photo = Photo.from_bytes(data)
        base, gain_map = photo.pixels / 255, photo.auxiliaries.gain_map.pixels / 255
    linear = np.where(base <= 0.04045, base / 12.92, ((base + 0.055) / 1.055) ** 2.4)
    gain = cv2.resize(gain_map, base.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    return linear * np.exp2(STOPS * (gain if gain.ndim == 3 else gain[..., None]))
