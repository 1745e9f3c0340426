"""Each part of a photo's file is carried, transformed, replaced, or left out and named."""

import io
import struct
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from support.drawn_photos import drawn, encoded
from support.photo_audit import audit, inventory_of, names
from support.rich_files import COLUMNS, rich_file
from support.tagged_files import TITLE, exif_blob, image_resources, jpeg_with
from unshutter.inventory import Fate
from unshutter.photo import Photo

XMP = b"http://ns.adobe.com/xap/1.0/\0<x:xmpmeta xmlns:x='adobe:ns:meta/'/>"
KNOWN = [
    (0xE1, exif_blob()),
    (0xE1, XMP),
    (0xE1, b"http://ns.adobe.com/xmp/extension/\0" + bytes(40)),
    (0xE2, b"MPF\0MM\0*\0\0\0\x08"),
    (0xEB, b"JP\0\1signed"),
    (0xED, b"Photoshop 3.0\0" + image_resources((1028, TITLE))),
    (0xFE, b"a comment"),
]
unknown_segments = st.tuples(st.integers(0xE0, 0xEF), st.binary(min_size=7, max_size=60))
segments = st.lists(st.one_of(st.sampled_from(KNOWN), unknown_segments), max_size=8)
behind = st.sampled_from([b"", b"\0\0", b"PK\3\4 of a program", b"\xff\xd8 no picture"])


@settings(deadline=None, max_examples=40)
@given(segments, behind)
def test_segments(listed: list[tuple[int, bytes]], trailer: bytes) -> None:
    data = jpeg_with(drawn(), *listed) + trailer
    try:
        Photo.from_bytes(data)
    except Exception:
        return  # libvips refuses some
    assert audit(data) == []
    assert audit(data, "png") == []
    lacking = names(data)
    has_unknown = any(all(segment[:2] != known[:2] for known in KNOWN) for segment in listed)
    known_kinds = (b"JFIF\0", b"JFXX\0", b"AVI1", b"Adobe", b"ICC_PROFILE\0")
    if has_unknown and not any(content.startswith(known_kinds) for _, content in listed):
        assert "other data" in lacking
    assert ("content credentials" in lacking) == any(content.startswith(b"JP") and m == 0xEB for m, content in listed)
    if trailer.strip(b"\0"):
        assert {"other data", "further pictures"} & set(lacking)


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


letters = st.sampled_from(list(b"abcxyzABCXYZ"))
unknown_chunks = st.tuples(
    st.builds(lambda a, b, d: bytes([a, b, ord("Q"), d]), st.sampled_from(b"abc"), letters, letters),
    st.binary(min_size=5, max_size=40),
)
known_chunks = st.sampled_from(
    [
        (b"tEXt", b"Title\0Street"),
        (b"pHYs", struct.pack(">IIB", 3000, 3000, 1)),
        (b"tIME", bytes([7, 232, 1, 1, 1, 1, 1])),
    ]
)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.one_of(unknown_chunks, known_chunks), max_size=6, unique_by=lambda pair: pair[0]), behind)
def test_chunks(listed: list[tuple[bytes, bytes]], trailer: bytes) -> None:
    plain = encoded(drawn(), "PNG")
    data = plain[:33] + b"".join(chunk(*each) for each in listed) + plain[33:] + trailer
    assert audit(data) == []
    assert audit(data, "jpeg") == []
    for name, content in listed:
        safe = bool(name[3] & 32)
        result, _ = inventory_of(data)
        assert (content in result) == (safe or name in (b"tIME", b"pHYs"))
        if not safe and name not in (b"tIME", b"pHYs"):
            assert "other data" in names(data)
        assert "other data" in names(data, "jpeg") or name in (b"tEXt", b"pHYs", b"tIME")


@settings(deadline=None, max_examples=20)
@given(st.lists(st.tuples(st.sampled_from([b"EXIF", b"XMP ", b"ABCD", b"wxyz"]), st.binary(max_size=30)), max_size=4))
def test_webp_chunks(listed: list[tuple[bytes, bytes]]) -> None:
    data = encoded(drawn(), "WEBP")
    for name, content in listed:
        content = exif_blob()[6:] if name == b"EXIF" else XMP.partition(b"\0")[2] if name == b"XMP " else content
        data += name + struct.pack("<I", len(content)) + content + bytes(len(content) % 2)
    data = data[:4] + struct.pack("<I", len(data) - 8) + data[8:]
    assert audit(data) == []
    repeated = any(sum(name == other for other, _ in listed) > 1 for name in (b"EXIF", b"XMP "))
    assert ("other data" in names(data)) == (repeated or any(name in (b"ABCD", b"wxyz") for name, _ in listed))


@pytest.mark.parametrize("column", [name for name in COLUMNS if name in ("JPEG", "PNG", "WebP")])
def test_rich_files(column: str) -> None:
    for form in (None, "jpeg", "png", "webp", "tiff"):
        assert audit(rich_file(column), form) == []


def test_the_fates() -> None:
    resources = b"Photoshop 3.0\0" + image_resources((1028, TITLE))
    data = jpeg_with(drawn(), (0xE1, exif_blob(**{"256": 80})), (0xE1, XMP), (0xED, resources), (0xE5, b"mine"))
    fates = {part.name: part.fate for part in inventory_of(data, "webp")[1]}
    assert fates == {
        "resolution": Fate.REPLACED,  # not set on purpose
        "coding": Fate.REPLACED,
        "EXIF": Fate.TRANSFORMED,  # its size
        "XMP": Fate.CARRIED,
        "IPTC": Fate.LEFT_OUT,
        "other data": Fate.LEFT_OUT,
    }


# ---- further pictures are called what they are ---------------------------------------------------------------

SDR = "gain map (the result is SDR)"
APPLE = b"<rdf apdi:AuxiliaryImageType='urn:com:apple:photo:2020:aux:hdrgainmap'/>"
KINDS = [
    (APPLE, SDR),
    (b"<rdf hdrgm:Version='1.0'/>", SDR),
    (b"<rdf apdi:AuxiliaryImageType='urn:com:apple:photo:2018:aux:portraiteffectsmatte'/>", "mattes"),
    (b"<rdf apdi:AuxiliaryImageType='urn:com:apple:photo:2017:aux:disparity'/>", "depth map"),
    (b"<rdf dc:title='a matter of taste'/>", "further pictures"),
]


@pytest.mark.parametrize(("xmp", "name"), KINDS)
def test_further_pictures_are_named_by_their_own_metadata(xmp: bytes, name: str) -> None:
    further = jpeg_with(drawn(32, 32), (0xE1, b"http://ns.adobe.com/xap/1.0/\0" + xmp))
    assert names(jpeg_with(drawn()) + further) == [name]
    iso = jpeg_with(drawn(32, 32), (0xE2, b"urn:iso:std:iso:ts:21496:-1\0" + bytes(8)))
    assert names(jpeg_with(drawn()) + further + iso) == list(dict.fromkeys([name, SDR]))


GOOGLE = "xmlns:{0}='http://ns.google.com/photos/{1}/'"
OLDER = f"<rdf:Description {GOOGLE.format('GDepth', '1.0/depthmap')} {GOOGLE.format('GImage', '1.0/image')} "
OLDER += "GDepth:Format='RangeInverse' GDepth:Data='QUJD' GImage:Mime='image/jpeg'/>"
DYNAMIC = f"<rdf:Description {GOOGLE.format('Container', 'dd/1.0/container')} {GOOGLE.format('Item', 'dd/1.0/item')} "
DYNAMIC += f"{GOOGLE.format('D', 'dd/1.0/depthmap')}><D:DepthURI>android/depthmap</D:DepthURI><Container:Directory>"
DYNAMIC += "<rdf:Seq><rdf:li><Container:Item Item:DataURI='android/depthmap' Item:Length='9'/></rdf:li></rdf:Seq>"
DYNAMIC += "</Container:Directory></rdf:Description>"


@pytest.mark.parametrize(("told", "behind"), [(OLDER, b""), (DYNAMIC, jpeg_with(drawn(32, 32)))])
def test_depth_photos_of_google_lose_their_pictures_and_what_lists_them(told: str, behind: bytes) -> None:
    packet = "<x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:RDF xmlns:rdf='http://www.w3.org/1999/02/22-rdf-syntax-ns#'>"
    packet += f"{told}</rdf:RDF></x:xmpmeta>"
    data = jpeg_with(drawn(), (0xE1, b"http://ns.adobe.com/xap/1.0/\0" + packet.encode())) + behind
    for format in ("jpeg", "png"):
        file = Photo.from_bytes(data).encode(format)
        assert set(file.left_out) == {"depth map", "further pictures"}
        assert b"Data=" not in file.data and b"DepthURI" not in file.data and b"Directory" not in file.data
        assert Photo.from_bytes(file.data).encode().left_out == ()


@pytest.mark.parametrize(("kind", "name"), [(0x010001, "preview"), (0x050000, SDR), (0x020003, "further pictures")])
def test_further_pictures_are_named_by_the_list_of_pictures(kind: int, name: str) -> None:
    further = jpeg_with(drawn(32, 32))
    entries = struct.pack(">IIIHH", 0x030000, 100, 0, 0, 0) + struct.pack(">IIIHH", kind, len(further), 1000, 0, 0)
    listed = b"MPF\0MM\0*" + struct.pack(">IHHHII", 8, 1, 0xB002, 7, len(entries), 26) + bytes(4) + entries
    assert names(jpeg_with(drawn(), (0xE2, listed)) + further) == [name]


def test_pages_and_tags_of_a_tiff() -> None:
    stream = io.BytesIO()
    Image.fromarray(drawn()).save(
        stream, "TIFF", tiffinfo={270: "street", 65000: "mine", 700: b"<x:xmpmeta xmlns:x='adobe:ns:meta/'/>"}
    )
    result, parts = inventory_of(stream.getvalue())
    assert b"street" in result and b"mine" not in result
    assert {part.name for part in parts if part.fate is Fate.LEFT_OUT} == {"other data"}
    assert {part.name for part in parts if part.fate is Fate.CARRIED} >= {"EXIF", "XMP"}
