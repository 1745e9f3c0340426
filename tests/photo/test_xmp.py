"""XMP that must follow new pixels: read by a parser, changed in its bytes, in time that its length bounds."""

import time

import pytest

from support.covering import covering
from support.drawn_photos import drawn, encoded
from support.motion_photos import GAIN_MAP, VIDEO, WITH_ALL, item, motion_photo, packet
from support.tagged_files import exif_blob, jpeg_with
from unshutter.photo import Photo, xmp
from unshutter.photo.xmp import Packet, UnreadableError

SDR = "gain map (the result is SDR)"
NEXT = xmp.NextPicture(30, 60, 6, is_new=True, video=None)
RDF = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">%s'
    b"</rdf:RDF></x:xmpmeta>"
)
ENTITY = b'<!DOCTYPE l [<!ENTITY a "ha">]><x>&a;</x>'  # a single one: all document types are refused alike


LONG = [
    RDF % b"<rdf:Description rdf:about=''/>" + b" " * 2_000_000 + b"tiff:ImageWidth",
    RDF % b"<rdf:Description rdf:about=''/>" + b"<xmp:Thumbnails " * 50_000,
    RDF % (b"<xmp:Thumbnails>" * 50_000),
    RDF % (b"<rdf:li>" * 50_000 + b"</rdf:li>" * 50_000) + b"<!--Container-->",
    packet("<rdf:li>" * 30_000 + "</rdf:li>" * 30_000),
    packet("<Container:Directory>" * 30_000 + "</Container:Directory>" * 30_000),
    RDF % (b"<a/>" * 500_000 + b"<tiff:ImageWidth>3</tiff:ImageWidth>"),
    RDF % b"".join(b'<a xmlns:n%d="u">' % i for i in range(20_000)) + b"tiff:ImageWidth",
    ENTITY,
]


@pytest.mark.parametrize(
    ("text", "video"),
    covering(LONG, [xmp.VideoPlace(0, len(VIDEO), len(VIDEO)), None]),
    ids=lambda value: type(value).__name__,
)
def test_no_packet_takes_long(text: bytes, video: xmp.VideoPlace | None) -> None:
    start = time.process_time()
    xmp.updated(text, NEXT._replace(video=video))
    list(xmp.lost(text, video is not None, ()))
    assert time.process_time() - start < 5


def test_entities_are_refused_and_leave_the_file_without_them() -> None:
    with pytest.raises(UnreadableError, match="document type"):
        Packet(ENTITY)
    photo = Photo.from_bytes(jpeg_with(drawn(), (0xE1, b"http://ns.adobe.com/xap/1.0/\0" + ENTITY)))
    file = photo.with_pixels(~photo.pixels).encode()
    assert file.left_out == ("XMP (damaged)",) and b"ENTITY" not in file.data


def test_packets_that_are_not_well_formed_stay_unless_they_show_the_old_picture() -> None:
    assert xmp.updated(b"<x:xmpmeta><tiff:ImageWidth>3", NEXT) == b"<x:xmpmeta><tiff:ImageWidth>3"
    assert xmp.updated(b"<x:xmpmeta><xmp:Thumbnails>AAAA", NEXT) is None


def test_all_but_what_follows_stays_byte_by_byte() -> None:
    before = (
        b"\xef\xbb\xbf<?xpacket begin='\xef\xbb\xbf'?>\n <!-- <tiff:ImageWidth>1</tiff:ImageWidth> -->"
        b'<rdf:RDF  xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#" xmlns:t="http://ns.adobe.com/tiff/1.0/">'
        b"<rdf:Description t:ImageWidth\n=\n' 4000 '  a='&quot;&lt;>' \xc3\xbc='>' >"
        b"<t:ImageLength> 3000 </t:ImageLength>"
        b"<![CDATA[<t:ImageLength>1</t:ImageLength>]]><t:Orientation/></rdf:Description></rdf:RDF>  "
        b"<?xpacket end='w'?>\0\0"
    )
    after = before.replace(b"' 4000 '", b"' 60 '").replace(b"> 3000 <", b"> 30 <")
    assert xmp.updated(before, NEXT) == after


@pytest.mark.parametrize("prefix", ["xmp", "xap", "own"])
def test_thumbnails_go_whatever_their_prefix(prefix: str) -> None:
    inner = (
        f'<rdf:Description xmlns:{prefix}="http://ns.adobe.com/xap/1.0/" {prefix}:Rating="4">'
        f"<{prefix}:Thumbnails><rdf:Alt><rdf:li>AAAA</rdf:li></rdf:Alt></{prefix}:Thumbnails></rdf:Description>"
    ).encode()
    after = xmp.updated(RDF % inner, NEXT)
    assert after is not None and b"AAAA" not in after and b'Rating="4"' in after
    assert xmp.updated(RDF % inner, NEXT._replace(is_new=False)) == RDF % inner


# ---- videos and gain maps beside the picture ------------------------------------------------------------------


def test_a_motion_photo_keeps_its_video_and_loses_its_gain_map() -> None:
    photo = Photo.from_bytes(motion_photo(drawn()))
    file = photo.with_pixels(~photo.pixels).encode()
    assert file.left_out == (SDR,)
    assert file.data.endswith(b"\xff\xd9" + VIDEO) and GAIN_MAP not in file.data
    for gone in (b'"GainMap"', b'hdrgm:Version="', b"hdrgm:GainMapMax"):
        assert gone not in file.data
    for kept in (b'Cam:MotionPhoto="1"', b'"Primary"', b'Item:Length="%d"' % len(VIDEO), b'xmp:Rating="4"'):
        assert kept in file.data
    assert b'Item:Padding="7"' not in file.data  # the video begins where the picture ends
    again = Photo.from_bytes(file.data)
    assert again.to_bytes().endswith(b"\xff\xd9" + VIDEO)


@pytest.mark.parametrize("target", ["png", "webp", "tiff", "avif"])
def test_where_there_is_no_place_for_the_video_the_xmp_tells_of_none(target) -> None:
    photo = Photo.from_bytes(motion_photo(drawn()))
    file = photo.with_pixels(~photo.pixels).encode(target)
    assert set(file.left_out) == {"film", SDR}
    assert b"MotionPhoto" not in file.data and b"Container:Item" not in file.data and VIDEO not in file.data
    assert Photo.from_bytes(file.data).encode(target).left_out == ()


def test_a_video_that_is_not_where_the_xmp_says_is_left_out() -> None:
    file = Photo.from_bytes(motion_photo(drawn(), after=b"")).encode()
    assert set(file.left_out) == {"film", SDR} and b"MotionPhoto" not in file.data


def test_the_older_form_of_motion_photos_is_known() -> None:
    older = packet("", f'Cam:MicroVideo="1" Cam:MicroVideoOffset="{len(VIDEO)}"')
    file = Photo.from_bytes(motion_photo(drawn(), older, VIDEO)).encode()
    assert file.left_out == () and file.data.endswith(VIDEO) and b'MicroVideoOffset="' in file.data
    assert xmp.video_bytes(older) == len(VIDEO)
    assert xmp.video_bytes(packet(item("Primary", 0))) is None
    assert xmp.video_bytes(WITH_ALL) == len(VIDEO)


@pytest.mark.parametrize(("in_exif", "expected"), [(None, 3), (1, 1), (6, 6)])
def test_how_to_turn_the_picture_is_told_alike_or_by_xmp_alone(in_exif: int | None, expected: int) -> None:
    told = RDF % b'<rdf:Description xmlns:tiff="http://ns.adobe.com/tiff/1.0/" tiff:Orientation="3"/>'
    blob = {} if in_exif is None else {"exif": exif_blob(in_exif)}
    photo = Photo.from_bytes(encoded(drawn(), "JPEG", xmp=told, **blob))
    for target in ("jpeg", "png", "webp", "tiff", "avif"):
        assert b'tiff:Orientation="%d"' % expected in photo.with_pixels(drawn()).to_bytes(target)
