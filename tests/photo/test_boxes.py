"""What a HEIC or AVIF holds in addition to its primary picture is named. Boxes are put together by hand."""

import io
import struct

import pytest

from support.camera_files import heic
from support.drawn_photos import drawn, encoded
from unshutter.inventory import left_out
from unshutter.photo import Photo
from unshutter.photo.boxes import auxiliary_items, has_gain_map, parts_of

GAIN_MAP = "urn:com:apple:photo:2020:aux:hdrgainmap"
SDR = "gain map (the result is SDR)"
XMP_TYPE = b"application/rdf+xml"


def box(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), name) + content


def item(number: int, kind: bytes, told: bytes = b"", hidden: bool = False) -> bytes:
    return box(b"infe", bytes([2, 0, 0, hidden]) + struct.pack(">HH", number, 0) + kind + b"\0" + told + b"\0")


def reference(kind: bytes, number: int, *to: int) -> bytes:
    return box(kind, struct.pack(f">{2 + len(to)}H", number, len(to), *to))


def file_of(items: list[bytes], references: list[bytes], auxiliary: dict[int, str], behind: bytes = b"") -> io.BytesIO:
    """A box file whose primary picture is item 1, with types of auxiliary items."""
    items = [item(1, b"hvc1"), *items]
    ipco = b"".join(box(b"auxC", bytes(4) + told.encode() + b"\0") for told in auxiliary.values())
    ipma = struct.pack(">II", 0, len(auxiliary))
    ipma += b"".join(struct.pack(">HBB", number, 1, k) for k, number in enumerate(auxiliary, 1))
    meta = box(b"pitm", struct.pack(">IH", 0, 1)) + box(b"iinf", struct.pack(">IH", 0, len(items)) + b"".join(items))
    meta += box(b"iref", bytes(4) + b"".join(references))
    meta += box(b"iprp", box(b"ipco", ipco) + box(b"ipma", ipma))
    return io.BytesIO(box(b"ftyp", b"heic") + box(b"meta", bytes(4) + meta) + box(b"mdat", b"") + behind)


def named(file: io.BytesIO) -> tuple[str, ...]:
    """Names of what no result contains."""
    return tuple(left_out(found.part((), ()) for found in parts_of(file)))


@pytest.mark.parametrize(
    ("told", "names"),
    [
        (GAIN_MAP, (SDR,)),
        ("urn:com:samsung:photo:2024:aux:hdrgainmap", (SDR,)),
        ("urn:mpeg:hevc:2015:auxid:2", ("depth map",)),
        ("urn:mpeg:mpegB:cicp:systems:auxiliary:depth", ("depth map",)),
        ("urn:com:apple:photo:2018:aux:portraiteffectsmatte", ("mattes",)),
        ("urn:com:apple:photo:2019:aux:semanticskinmatte", ("mattes",)),
        ("urn:com:apple:photo:2023:aux:styledeltamap", ("other data",)),
        ("urn:mpeg:hevc:2015:auxid:1", ()),  # transparency, which results keep
        ("urn:mpeg:mpegB:cicp:systems:auxiliary:alpha", ()),
    ],
)
def test_auxiliary_pictures_have_names(told: str, names: tuple[str, ...]) -> None:
    assert named(file_of([item(2, b"hvc1")], [reference(b"auxl", 2, 1)], {2: told})) == names


def test_tiles_thumbnails_and_what_describes_other_items_have_none() -> None:
    items = [item(2, b"hvc1", hidden=True), item(3, b"hvc1"), item(4, b"hvc1"), item(5, b"Exif"), item(6, b"hvc1")]
    items += [item(7, b"mime", XMP_TYPE), item(8, b"mime", XMP_TYPE)]
    references = [reference(b"dimg", 1, 2, 3), reference(b"thmb", 4, 1), reference(b"dimg", 4, 6)]
    references += [reference(b"cdsc", 5, 1), reference(b"cdsc", 7, 1), reference(b"cdsc", 8, 4)]
    assert named(file_of(items, references, {})) == ()


def test_other_items_and_boxes_have_names() -> None:
    items = [item(2, b"hvc1"), item(3, b"tmap"), item(4, b"hvc1"), item(5, b"mime", XMP_TYPE)]
    items += [item(6, b"mime", XMP_TYPE), item(7, b"mime", b"text/x-own"), item(8, b"iptc"), item(9, b"hvc1")]
    items += [item(10, b"rgan")]
    references = [reference(b"dimg", 3, 1, 4), reference(b"cdsc", 5, 1), reference(b"cdsc", 6, 1)]
    names = named(file_of(items, references, {}, box(b"mpvd", b"film") + box(b"sefd", b"own")))
    assert names == (
        "further pictures",
        SDR,
        "other data",
        "IPTC",
        "regions",
        "film",
    )


def test_a_gain_map_that_is_no_auxiliary_picture_has_a_name() -> None:
    items = [item(2, b"hvc1", hidden=True), item(3, b"tmap"), item(4, b"hvc1")]
    references = [reference(b"dimg", 3, 1, 2), reference(b"auxl", 4, 1)]
    matte = "urn:com:apple:photo:2018:aux:portraiteffectsmatte"
    assert named(file_of(items, references, {4: matte})) == ("mattes", SDR)
    assert not has_gain_map(file_of(items, references, {4: matte}))


def test_boxes_that_end_too_early_have_none() -> None:
    whole = file_of([item(2, b"hvc1")], [reference(b"auxl", 2, 1)], {2: GAIN_MAP}).getvalue()
    for length in range(len(whole)):
        named(io.BytesIO(whole[:length]))
    assert named(io.BytesIO(b"")) == ()


def test_photos_name_them() -> None:
    made = heic(drawn(bands=4))
    assert made.count(b"auxid:1\0") == 1
    photo = Photo.from_bytes(made.replace(b"auxid:1\0", b"auxid:2\0"))
    assert photo.bands == 3 and photo.encode("jpeg").left_out == ()
    assert photo.encode("avif").left_out == ("depth map",)
    assert Photo.from_bytes(made).encode("avif").left_out == ()
    for bands in (3, 4):
        assert Photo.from_bytes(encoded(drawn(bands=bands), "AVIF")).encode().left_out == ()


def test_a_box_that_claims_more_bytes_than_can_be_counted_is_the_last() -> None:
    endless = struct.pack(">I4sQ", 1, b"free", 2**64 - 1)
    assert named(io.BytesIO(file_of([], [], {}).getvalue() + endless)) == ()


def test_what_a_gain_map_means_is_found_in_the_items_about_it() -> None:
    items = [item(2, b"hvc1", hidden=True), item(3, b"tmap"), item(4, b"mime", XMP_TYPE), item(5, b"mime", XMP_TYPE)]
    references = [
        reference(b"auxl", 2, 1),
        reference(b"dimg", 3, 1, 2),
        reference(b"cdsc", 4, 2),
        reference(b"cdsc", 5, 1),
    ]
    whole = file_of(items, references, {2: GAIN_MAP}).getvalue()
    held = bytes(3) + b"about it, by ISO.." + b"<x/>"
    # of version 1: number, method (1: in idat), data reference, number of extents, offset, length
    places = struct.pack(">HHHHII", 3, 1, 0, 1, 0, 21) + struct.pack(">HHHHII", 4, 1, 0, 1, 21, 4)
    iloc = box(b"iloc", struct.pack(">IBBH", 1 << 24, 0x44, 0, 2) + places)
    meta = whole[whole.index(b"meta") + 4 : whole.index(b"mdat") - 4]
    data = box(b"ftyp", b"heic") + box(b"meta", meta + iloc + box(b"idat", held))
    (found,) = auxiliary_items(io.BytesIO(data))
    assert (found.number, found.kind, found.xmp, found.iso) == (2, GAIN_MAP, b"<x/>", held[:21])
    for length in range(len(data)):
        auxiliary_items(io.BytesIO(data[:length]))
