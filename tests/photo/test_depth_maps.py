"""Depth maps and mattes of photos are warped as the pixels are, and are found again where they were."""

import base64
import hashlib
import struct

import cv2
import numpy as np
import pytest

from support.drawn_photos import encoded
from support.gain_maps import (
    XMP_PREFIX,
    hdr_photo,
    pictures_of,
    pixels_of,
    scene,
    segment,
    segments_of,
    with_segments,
)
from unshutter import Photo, RowMotion, rectify

HEIGHT, WIDTH = 240, 320
MOTION = RowMotion.from_polynomials([0, 16, 5], [0, 0.03], HEIGHT, WIDTH)
SDR = ("gain map (the result is SDR)",)
DEPTH = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/" xmlns:apdi="http://ns.apple.com/pixeldatainfo/1.0/">'
    b"<apdi:AuxiliaryImageType>urn:com:apple:photo:2017:aux:depth</apdi:AuxiliaryImageType></x:xmpmeta>"
)


def test_a_depth_map_is_warped_without_mixing_near_and_far() -> None:
    depths = np.where(np.mgrid[0:60, 0:80][1] < 40, 40, 200).astype(np.uint8)
    depth = with_segments(encoded(depths, "JPEG", quality=100), segment(0xE1, XMP_PREFIX + DEPTH))
    data = hdr_photo(depth=depth)
    file = rectify(data, motion=MOTION, edges="fill").encode()
    assert file.left_out == ()
    _, _, new = pictures_of(file.data)
    assert segments_of(new) == segments_of(depth)
    values = pixels_of(new)
    border = (values < 120).sum(axis=1)
    shift = MOTION.tx_px[np.arange(60) * 4] / 4
    assert np.abs(np.diff(border) - np.diff(np.round(border[0] + np.abs(shift - shift[0])))).mean() < 1
    assert ((values > 60) & (values < 180)).mean() < 0.01
    assert "depth map" in " ".join(rectify(data, motion=MOTION, edges="fill").encode("webp").left_out)


def listed(depth: bytes, confidence: bytes, extension: bytes) -> bytes:
    """A photo whose XMP lists a depth map and how sure it is, and continues in other segments."""
    data = hdr_photo(depth=depth + confidence)
    base = pictures_of(data)[0]
    old = segments_of(base)[1]
    item = b'<rdf:li><Container:Item Item:Mime="image/jpeg" Item:Semantic="%s" Item:Length="%d"/></rdf:li>'
    items = item % (b"Depth", len(depth)) + item % (b"Confidence", len(confidence))
    new = old.replace(b"</rdf:Seq>", items + b"</rdf:Seq>")
    new = new.replace(
        b"<rdf:Description ", b'<rdf:Description xmlns:xmpNote="http://ns.adobe.com/xmp/note/" %s' % told(extension), 1
    )
    return base.replace(segment(0xE1, old), segment(0xE1, new) + extended(extension)) + data[len(base) :]


def told(extension: bytes) -> bytes:
    return b'xmpNote:HasExtendedXMP="%s" ' % hashlib.md5(extension).hexdigest().upper().encode()


def extended(packet: bytes) -> bytes:
    name = hashlib.md5(packet).hexdigest().upper().encode()
    parts = [
        b"http://ns.adobe.com/xmp/extension/\0" + name + struct.pack(">II", len(packet), at) + packet[at : at + 60_000]
        for at in range(0, len(packet), 60_000)
    ]
    return b"".join(segment(0xE1, each) for each in parts)


def extended_of(data: bytes) -> bytes:
    """The rest of XMP, which must be the one that XMP tells of."""
    parts = [each[35:] for each in segments_of(data) if each.startswith(b"http://ns.adobe.com/xmp/extension/\0")]
    packet = b"".join(each[40:] for each in sorted(parts, key=lambda each: each[36:40]))
    assert {each[32:36] for each in parts} == {struct.pack(">I", len(packet))} and told(packet).strip() in data
    return packet


def test_googles_depth_map_behind_the_picture_is_kept_with_what_xmp_says_of_it() -> None:
    near = np.where(np.mgrid[0:60, 0:80][1] < 40, 40, 200).astype(np.uint8)
    space = b'xmlns:x="adobe:ns:meta/" xmlns:m="http://ns.google.com/photos/dd/1.0/depthmap/"'
    about = b"<x:xmpmeta %s><m:Near>%s</m:Near></x:xmpmeta>" % (space, b"1" * 70_000)
    depth, sure = (encoded(each, "JPEG", quality=100) for each in (near, 255 - near))  # of the same length
    data = listed(depth, sure, about)
    file = rectify(data, motion=MOTION, edges="fill").encode()
    assert file.left_out == () and extended_of(file.data) == about
    files = pictures_of(file.data)
    for new, semantic in zip(files[2:], (b"Depth", b"Confidence"), strict=True):
        assert b'Item:Semantic="%s" Item:Length="%d"' % (semantic, len(new)) in files[0]
        values = pixels_of(new)
        assert len(new) > 100 and ((values > 75) & (values < 180)).mean() < 0.01
        border = (values == values[:, :1]).sum(axis=1)
        assert np.ptp(border) >= 3
    for format in ("avif", "webp"):
        lost = Photo.from_bytes(data).encode(format).left_out
        assert {"depth map", "confidence map", "XMP (beyond the first 64 kB)"} <= {*lost}
    cut = data.replace(extended(about), b"")  # the rest of XMP is missing
    assert rectify(cut, motion=MOTION, edges="fill").encode().left_out == ()


@pytest.mark.parametrize("kind", ["png", "jpeg"])
def test_googles_depth_map_in_xmp_is_warped_there(kind: str) -> None:
    """As older phones wrote it, with the picture before its background was blurred."""
    near = np.where(np.mgrid[0:HEIGHT, 0:WIDTH][1] < 160, 40, 200).astype(np.uint8)
    depth = encoded(
        np.dstack([near] * 4) if kind == "png" else near, kind.upper(), **({"quality": 100} if kind == "jpeg" else {})
    )
    texts = [base64.b64encode(each).decode() for each in (depth, encoded(scene(HEIGHT, WIDTH)[0], "JPEG"))]
    spaces = (
        'xmlns:GDepth="http://ns.google.com/photos/1.0/depthmap/" xmlns:GImage="http://ns.google.com/photos/1.0/image/"'
    )
    rdf = '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">{}</rdf:RDF></x:xmpmeta>'
    description = (
        f'<rdf:Description {spaces} GDepth:Data="{texts[0]}"><GImage:Data>{texts[1]}</GImage:Data></rdf:Description>'
    )
    extension = rdf.format(description).encode()
    packet = rdf.format(
        f'<rdf:Description {spaces} xmlns:xmpNote="http://ns.adobe.com/xmp/note/" GDepth:Near="1.5" '
        f'GDepth:Mime="image/{kind}" GDepth:ImageWidth="320" GImage:Mime="image/jpeg" {told(extension).decode()}/>'
    ).encode()
    data = with_segments(
        encoded(scene(HEIGHT, WIDTH)[0], "JPEG"), segment(0xE1, XMP_PREFIX + packet) + extended(extension)
    )
    result = rectify(data, motion=MOTION, edges="crop")
    file = result.encode()
    assert file.left_out == ("further pictures",)
    first = next(each for each in segments_of(file.data) if each.startswith(XMP_PREFIX))
    assert (
        b'GDepth:Near="1.5"' in first
        and b'GDepth:ImageWidth="%d"' % result.photo.width in first
        and b"GImage:Mime" not in first
    )
    again = extended_of(file.data)
    assert b"GImage:Data" not in again
    new = cv2.imdecode(np.frombuffer(base64.b64decode(again.split(b'GDepth:Data="')[1].split(b'"')[0]), np.uint8), -1)
    assert new.shape == (*result.photo.pixels.shape[:2], 4)[: 3 if kind == "png" else 2]
    exact = rectify(near, motion=MOTION, edges="crop").array
    values = new[..., 0] if kind == "png" else new
    assert (np.abs(values.astype(int) - exact) > 80).mean() < 0.01 and ((values > 75) & (values < 180)).mean() < 0.01
    assert Photo.from_bytes(file.data).encode().left_out == ()
    lost = ("XMP (beyond the first 64 kB)", "depth map", "further pictures")
    assert set(result.encode("png").left_out) == {*lost}
    for damaged in (data.replace(b"GDepth:Data=", b"GDepth:Data:"), data.replace(texts[0].encode()[:80], b"A" * 80)):
        assert {"depth map"} <= {*rectify(damaged, motion=MOTION, edges="crop").encode().left_out}
    same = Photo.from_bytes(data).to_bytes(quality=50)
    assert texts[0].encode() in extended_of(same)


def test_a_matte_is_warped_as_the_picture_is() -> None:
    base, gain = scene(HEIGHT, WIDTH)
    told = DEPTH.replace(b"2017:aux:depth", b"2018:aux:portraiteffectsmatte")
    matte = with_segments(
        encoded(np.round(gain * 80).astype(np.uint8), "JPEG", quality=98), segment(0xE1, XMP_PREFIX + told)
    )
    data = encoded(base, "JPEG", quality=97) + matte
    result = rectify(data, motion=MOTION, edges="fill")
    file = result.encode()
    new = file.data[file.data.rindex(b"\xff\xd8\xff") :]
    assert file.left_out == () and segments_of(new) == segments_of(matte)
    exact = rectify(np.dstack([pixels_of(matte)] * 3), motion=MOTION, edges="fill").array
    assert np.abs(pixels_of(new).astype(float) - exact[..., 0]).mean() < 1
    assert result.encode("png").left_out == ("mattes",)
