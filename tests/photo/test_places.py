"""Places that metadata state in a photo (faces, paths ...) move along with its pixels, or are dropped and named."""

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from support.covering import covering, thorough
from support.tagged_files import image_resources, jpeg_with
from unshutter import RowMotion, rectify
from unshutter.export import PixelMap
from unshutter.inventory import Fate
from unshutter.motion.grid import Tile
from unshutter.options import Save
from unshutter.orientation import Orientation
from unshutter.photo import Photo, exif, regions, resources
from unshutter.photo.directories import EXIF
from unshutter.photo.formats import WRITTEN
from unshutter.photo.placement import Box, Placement
from unshutter.photo.saving import encode_with_parts
from unshutter.reasons import Code
from unshutter.rectification.rectified import placement

DEMO = Path(__file__).parents[2] / "examples" / "demo.jpg"  # distorted clearly
HEIGHT, WIDTH = 240, 320
SQUARE = Box(120 / WIDTH, 90 / HEIGHT, 170 / WIDTH, 140 / HEIGHT)
XMP = b"http://ns.adobe.com/xap/1.0/\0"
NAMESPACES = """xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"
 xmlns:mwg-rs="http://www.metadataworkinggroup.com/schemas/regions/" xmlns:stArea="http://ns.adobe.com/xmp/sType/Area#"
 xmlns:stDim="http://ns.adobe.com/xap/1.0/sType/Dimensions#" xmlns:MP="http://ns.microsoft.com/photo/1.2/"
 xmlns:MPRI="http://ns.microsoft.com/photo/1.2/t/RegionInfo#" xmlns:MPReg="http://ns.microsoft.com/photo/1.2/t/Region#"
 xmlns:acdsee-rs="http://ns.acdsee.com/regions/" xmlns:acdsee-stArea="http://ns.acdsee.com/sType/Area#"
 xmlns:acdsee-stDim="http://ns.acdsee.com/sType/Dimensions#" xmlns:crs="http://ns.adobe.com/camera-raw-settings/1.0/"
 xmlns:I="http://iptc.org/std/Iptc4xmpExt/2008-02-29/" xmlns:exif="http://ns.adobe.com/exif/1.0/"
 xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" """


def packet(content: str, attributes: str = "") -> bytes:
    return (
        f'<x:xmpmeta xmlns:x="adobe:ns:meta/" {NAMESPACES}><rdf:RDF><rdf:Description rdf:about="" {attributes}>'
        f"{content}</rdf:Description></rdf:RDF></x:xmpmeta>"
    ).encode()


def every_region(box: Box, height: int, width: int) -> str:
    """The same box in every way that programs state one, and a name."""
    x, y, w, h = (box.left + box.right) / 2, (box.top + box.bottom) / 2, box.right - box.left, box.bottom - box.top
    centred = f"{{0}}:x='{x}' {{0}}:y='{y}' {{0}}:w='{w}' {{0}}:h='{h}'"
    pixels = (
        f"<I:rbX>{box.left * width}</I:rbX><I:rbY>{box.top * height}</I:rbY>"
        f"<I:rbW>{w * width}</I:rbW><I:rbH>{h * height}</I:rbH>"
    )
    return (
        f"<mwg-rs:Regions rdf:parseType='Resource'><mwg-rs:AppliedToDimensions stDim:w='{width}' stDim:h='{height}'"
        " stDim:unit='pixel'/><mwg-rs:RegionList><rdf:Bag><rdf:li><rdf:Description mwg-rs:Name='somebody'><mwg-rs:Area"
        f" {centred.format('stArea')} stArea:unit='normalized'/></rdf:Description></rdf:li></rdf:Bag>"
        "</mwg-rs:RegionList></mwg-rs:Regions><MP:RegionInfo rdf:parseType='Resource'><MPRI:Regions><rdf:Bag>"
        f"<rdf:li MPReg:Rectangle='{box.left}, {box.top}, {w}, {h}' MPReg:PersonDisplayName='somebody'/></rdf:Bag>"
        "</MPRI:Regions></MP:RegionInfo><acdsee-rs:Regions rdf:parseType='Resource'><acdsee-rs:AppliedToDimensions"
        f" acdsee-stDim:w='{width}' acdsee-stDim:h='{height}'/><acdsee-rs:RegionList><rdf:Bag><rdf:li"
        f" rdf:parseType='Resource'><acdsee-rs:DLYArea {centred.format('acdsee-stArea')}/></rdf:li></rdf:Bag>"
        "</acdsee-rs:RegionList></acdsee-rs:Regions><I:ImageRegion><rdf:Bag><rdf:li rdf:parseType='Resource'>"
        f"<I:RegionBoundary rdf:parseType='Resource'><I:rbShape>rectangle</I:rbShape><I:rbUnit>pixel</I:rbUnit>{pixels}"
        "</I:RegionBoundary></rdf:li></rdf:Bag></I:ImageRegion>"
    )


def stated_boxes(xmp: bytes, height: int, width: int) -> list[Box]:
    """The boxes in every_region's forms, read in another way than the product does."""
    text = xmp.decode()
    boxes = []
    for prefix in ("stArea", "acdsee-stArea"):
        found = re.findall(rf" {prefix}:[xywh]='(.*?)'", text)
        x, y, w, h = map(float, found)
        boxes.append(Box(x - w / 2, y - h / 2, x + w / 2, y + h / 2))
    left, top, w, h = map(float, re.findall(r"Rectangle='(.*?)'", text)[0].split(","))
    boxes.append(Box(left, top, left + w, top + h))
    left, top, w, h = (float(re.findall(rf"<I:{name}>(.*?)<", text)[0]) for name in ("rbX", "rbY", "rbW", "rbH"))
    boxes.append(Box(left / width, top / height, (left + w) / width, (top + h) / height))
    sizes = re.findall(r"Dim:w='(\d+)' (?:acdsee-)?stDim:h='(\d+)'", text)
    assert sizes == [(str(width), str(height))] * 2 and text.count("somebody") == 2
    return boxes


def photo_of_square(form: Any, orientation: int = 1, displayed: bool = False) -> Photo:
    """A dark photo with a bright square, whose metadata state its place."""
    pixels = np.full((HEIGHT, WIDTH, 3), 20, np.uint8)
    pixels[90:140, 120:170] = 235
    box, size = SQUARE, (HEIGHT, WIDTH)
    if displayed:
        turn = Orientation(orientation)
        ends = [turn.upright_point(box.left, box.top), turn.upright_point(box.right, box.bottom)]
        box = Box(*map(min, zip(*ends, strict=True)), *map(max, zip(*ends, strict=True)))
        size = turn.size(HEIGHT, WIDTH)
    tags = exif_with_subject(orientation, 145, 115, 50, 50)
    data = jpeg_with(pixels, (0xE1, XMP + packet(every_region(box, *size))), exif=tags, quality=95)
    return Photo.from_bytes(Photo.from_bytes(data).to_bytes(form))


def exif_with_subject(orientation: int, *numbers: int, size: tuple[int, int] = (HEIGHT, WIDTH)) -> bytes:
    tags = Image.Exif()
    tags[0x0112] = orientation
    tags.get_ifd(EXIF).update({0x9214: numbers, 0xA002: size[1], 0xA003: size[0], 0xA405: 26})
    return tags.tobytes()


def square_in(pixels: np.ndarray) -> Box:
    """Where the bright square is."""
    rows, cols = np.nonzero(pixels[..., 1] > 128)
    height, width = pixels.shape[:2]
    return Box(cols.min() / width, rows.min() / height, (cols.max() + 1) / width, (rows.max() + 1) / height)


def check_near(stated: Box, seen: Box, height: int, width: int) -> None:
    for one, other, side in zip(stated, seen, (width, height) * 2, strict=True):
        assert abs(one - other) * side < 2.5, (stated, seen)


@pytest.mark.parametrize(("form", "edges"), covering(["jpeg", "png", "webp", "tiff", "avif"], ["crop", "keep", "fill"]))
def test_regions_are_where_the_pixels_are(form: str, edges: str) -> None:
    check_regions(form, edges, orientation=1, displayed=False)


@pytest.mark.parametrize(
    ("orientation", "displayed"), [(3, False), (6, False), (6, True), thorough(5, False), thorough(5, True), (8, True)]
)
def test_regions_of_turned_photos(orientation: int, displayed: bool) -> None:
    """The size that some of them state shows whether it is that of the picture as stored or as displayed."""
    check_regions("jpeg", "crop", orientation, displayed)


def check_regions(form: Any, edges: Any, orientation: int, displayed: bool) -> None:
    motion = RowMotion.from_polynomials([0, 60, -25], [0, 0.05], HEIGHT, WIDTH)
    result = rectify(photo_of_square(form, orientation, displayed), motion=motion, edges=edges)
    photo = Photo.from_bytes(result.photo.to_bytes(form))
    assert photo.orientation == orientation
    stored = square_in(result.pixels)
    shown = photo.orientation if displayed else 1
    pixels = Orientation(shown).upright(result.pixels)
    boxes = stated_boxes(photo._metadata.xmp or b"", *pixels.shape[:2])
    for box in boxes:
        check_near(box, square_in(pixels), *pixels.shape[:2])
    tags = exif.read(photo._metadata.exif)
    x, y, w, h = tags.numbers(0x9214, EXIF)
    subject = Box(x - w / 2, y - h / 2, x + w / 2, y + h / 2)
    height, width = result.pixels.shape[:2]
    check_near(Box(*(n / side for n, side in zip(subject, (width, height) * 2, strict=True))), stored, height, width)
    assert tags.number(0xA405, EXIF) == 26 and tags.number(0xA002, EXIF) == width


@settings(deadline=None, max_examples=60)
@given(
    left=st.floats(0.05, 0.6),
    top=st.floats(0.05, 0.6),
    size=st.floats(0.1, 0.3),
    slope=st.floats(-90, 90),
    bend=st.floats(-30, 30),
    turn=st.floats(-0.08, 0.08),
)
def test_a_region_is_the_box_of_the_moved_corners(left, top, size, slope, bend, turn) -> None:
    motion = RowMotion.from_polynomials([0, slope, bend], [0, turn], HEIGHT, WIDTH)
    photo = Photo.from_bytes(jpeg_with(np.zeros((HEIGHT, WIDTH), np.uint8)))
    box = Box(left, top, left + size, top + size)
    xmp = packet(every_region(box, HEIGHT, WIDTH))
    result = rectify(photo.with_pixels(photo.pixels), motion=motion, edges="keep", strength=1)
    if not result.changed:
        return
    whole = Tile(0, HEIGHT, 0, WIDTH)
    moved, _ = regions.moved(xmp, placement(photo, result.verdict, whole))
    # the map of the pixels says where each corner of the photo is seen in the picture
    there = PixelMap.of(result.motion)
    inside = [
        np.argwhere(np.hypot(there.col - x * WIDTH + 0.5, there.row - y * HEIGHT + 0.5) < 0.8)
        for x in (box.left, box.right)
        for y in (box.top, box.bottom)
    ]
    if not all(map(len, inside)):
        return  # a corner lies outside
    corners = np.array([each.mean(axis=0) for each in inside])
    seen = Box(
        *(corners.min(axis=0)[::-1] + 0.5) / (WIDTH, HEIGHT), *(corners.max(axis=0)[::-1] + 0.5) / (WIDTH, HEIGHT)
    )
    check_near(stated_boxes(moved, HEIGHT, WIDTH)[0], seen, HEIGHT, WIDTH)


# ---- what cannot be moved ------------------------------------------------------------------------------------

SHIFT = Placement(
    (HEIGHT, WIDTH), (HEIGHT, WIDTH - 100), lambda x, y: ([(a * 320 - 100) / 220 for a in x], y), (0, 100)
)
UNKNOWN = Placement((HEIGHT, WIDTH), (HEIGHT, WIDTH))


@pytest.mark.parametrize("why", ["outside", "of another picture", "unknown"])
def test_regions_that_cannot_be_moved_are_dropped_and_named(why: str) -> None:
    box = Box(0.1, 0.2, 0.2, 0.3) if why == "outside" else SQUARE
    size = (HEIGHT, 2 * WIDTH) if why == "of another picture" else (HEIGHT, WIDTH)
    moved, names = regions.moved(packet(every_region(box, *size)), UNKNOWN if why == "unknown" else SHIFT)
    assert set(names) == {"regions"} and b"stArea:x" not in moved
    Photo.from_bytes(jpeg_with(np.zeros((64, 64), np.uint8), (0xE1, XMP + moved))).to_bytes("png")  # still XML


def test_a_subject_area_for_another_size_is_scaled_or_dropped() -> None:
    half = exif_with_subject(1, 70, 60, 20, size=(HEIGHT // 2, WIDTH // 2))
    moved, names = exif.with_subject_moved(half, SHIFT)
    assert exif.read(moved).numbers(0x9214, EXIF) == (40, 120, 40) and not names
    other = exif_with_subject(1, 70, 60, size=(HEIGHT, WIDTH // 2))
    moved, names = exif.with_subject_moved(other, SHIFT)
    tags = exif.read(moved)
    assert names == ["subject area"] and tags.numbers(0x9214, EXIF) == () and tags.number(0xA405, EXIF) == 26
    assert len(moved) == len(other)  # nothing else has moved


def test_other_shapes() -> None:
    circle = (
        "<I:rbShape>circle</I:rbShape><I:rbUnit>relative</I:rbUnit>"
        "<I:rbX>.5</I:rbX><I:rbY>.5</I:rbY><I:rbRx>.11</I:rbRx>"
    )
    corners = "".join(
        f"<rdf:li rdf:parseType='Resource'><I:rbX>{x}</I:rbX><I:rbY>{y}</I:rbY></rdf:li>"
        for x, y in ((110, 10), (300, 20), (90, 200))
    )
    polygon = (
        "<I:rbShape>polygon</I:rbShape><I:rbUnit>pixel</I:rbUnit>"
        f"<I:rbVertices><rdf:Seq>{corners}</rdf:Seq></I:rbVertices>"
    )
    items = "".join(
        f"<rdf:li><rdf:Description><I:RegionBoundary rdf:parseType='Resource'>{each}"
        "</I:RegionBoundary></rdf:Description></rdf:li>"
        for each in (circle, polygon)
    )
    seq = "<exif:SubjectArea><rdf:Seq><rdf:li>200</rdf:li><rdf:li>30</rdf:li></rdf:Seq></exif:SubjectArea>"
    moved, names = regions.moved(packet(f"<I:ImageRegion><rdf:Bag>{items}</rdf:Bag></I:ImageRegion>{seq}"), SHIFT)
    text = moved.decode()
    assert not names
    assert "<I:rbX>0.272727</I:rbX><I:rbY>0.5</I:rbY><I:rbRx>0.16</I:rbRx>" in text
    assert [float(x) for x in re.findall(r"rbX>([\d.]+)<", text)[1:]] == [10, 200, 0]
    assert re.findall(r"<rdf:li>(\d+)</rdf:li>", text) == ["100", "30"]


def test_camera_raw_settings_that_were_applied_already_are_history() -> None:
    crop = "crs:HasCrop='True' crs:CropLeft='0.5' crs:CropTop='0.25' crs:CropRight='1' crs:CropBottom='0.75'"
    spots = "<crs:RetouchAreas><rdf:Seq><rdf:li crs:SpotType='heal'/></rdf:Seq></crs:RetouchAreas>"
    applied = packet(spots, crop + " crs:AlreadyApplied='True'")
    assert regions.moved(applied, SHIFT) == (applied, [])
    moved, names = regions.moved(packet(spots, crop + " crs:CropAngle='0'"), SHIFT)
    assert names == ["Camera Raw's retouching"] and b"crs:CropLeft='0.272727'" in moved and b"SpotType" not in moved
    moved, names = regions.moved(packet("", crop + " crs:CropAngle='2'"), SHIFT)
    assert names == ["Camera Raw's crop"] and b"CropLeft" not in moved


def test_a_crop_moves_the_optical_centre() -> None:
    centre = packet("", "drone-dji:CalibratedOpticalCenterX='160.5' drone-dji:CalibratedOpticalCenterY='120'")
    moved, names = regions.moved(centre, SHIFT)
    assert b"CenterX='60.5'" in moved and b"CenterY='120'" in moved and not names


def test_a_region_list_without_places_is_left_as_it_is() -> None:
    for content in ("", "<MP:RegionInfo/>", "<mwg-rs:Regions/>", "<exif:UserComment>1</exif:UserComment>"):
        assert regions.moved(packet(content), SHIFT) == (packet(content), [])


# ---- panoramas -----------------------------------------------------------------------------------------------

PANORAMA = (
    "GPano:ProjectionType='equirectangular' GPano:CroppedAreaImageWidthPixels='320' GPano:FullPanoWidthPixels='640' "
    "GPano:CroppedAreaImageHeightPixels='240' GPano:CroppedAreaLeftPixels='7' GPano:CroppedAreaTopPixels='9'"
)


def test_a_panorama_is_left_unchanged() -> None:
    sheared = np.asarray(Image.open(DEMO))
    assert rectify(sheared).changed
    for data in (
        jpeg_with(sheared, (0xE1, XMP + packet("", PANORAMA)), quality=95),
        jpeg_with(sheared, exif=exif_blob_with(0xA401, 6), quality=95),
    ):
        result = rectify(data, upright="level")
        assert not result.changed
        assert (reason := result.verdict.reason) is not None and reason.code is Code.PANORAMA
        assert "panorama" in result.reason


def exif_blob_with(tag: int, value: int) -> bytes:
    tags = Image.Exif()
    tags.get_ifd(EXIF)[tag] = value
    return tags.tobytes()


def test_a_crop_of_a_panorama_is_stated() -> None:
    moved, names = regions.moved(packet("", PANORAMA), SHIFT)
    assert not names
    for name, value in (("ImageWidth", 220), ("ImageHeight", 240), ("Left", 107), ("Top", 9)):
        assert f"CroppedArea{name}Pixels='{value}'".encode() in moved
    turned = Placement(SHIFT.size, SHIFT.new_size, SHIFT.position, SHIFT.corner, Orientation(6))
    moved, names = regions.moved(packet("", PANORAMA), turned)
    assert names == ["panorama tags"] and b"GPano:Cropped" not in moved


# ---- Photoshop's resources -----------------------------------------------------------------------------------


def knot(kind: int, *points: tuple[float, float]) -> bytes:
    return struct.pack(">H6i", kind, *(round(number * (1 << 24)) for x, y in points for number in (y, x)))


def test_paths_move_and_guides_do_not() -> None:
    path = struct.pack(">HH22x", 0, 1) + knot(1, (0.5, 0.5), (0.75, 0.25), (1.0, 0.0))
    guides = struct.pack(">IIIIIB", 1, 576, 576, 1, 100, 0)
    grid = struct.pack(">IIII", 1, 576, 576, 0)
    before = b"Photoshop 3.0\0" + image_resources((2000, path), (1005, b"resolution"), (1032, guides))
    after, names = resources.moved(before, SHIFT)
    expected = [((x * 320 - 100) / 220, y) for x, y in ((0.5, 0.5), (0.75, 0.25), (1.0, 0.0))]
    moved = struct.pack(">HH22x", 0, 1) + knot(1, *expected)
    assert after == b"Photoshop 3.0\0" + image_resources((2000, moved), (1005, b"resolution"))
    assert names == ["guides"]
    assert resources.moved(image_resources((1032, grid)), SHIFT) == (image_resources((1032, grid)), [])
    assert resources.moved(image_resources((2000, path)), UNKNOWN) == (b"", ["paths"])


def test_the_slice_of_the_whole_picture_gets_its_size() -> None:
    def slices(width: int, count: int) -> bytes:
        sides = struct.pack(">4i", 0, 0, HEIGHT, width)
        return struct.pack(">I", 6) + sides + struct.pack(">I2xI", 1, count) + struct.pack(">4i", 0, 0, width, HEIGHT)

    one = image_resources((1050, slices(WIDTH, 1)))
    assert resources.moved(one, SHIFT) == (image_resources((1050, slices(WIDTH - 100, 1))), [])
    assert resources.moved(image_resources((1050, slices(WIDTH, 2))), SHIFT) == (b"", ["slices"])


def test_places_survive_where_nothing_moves() -> None:
    photo = photo_of_square("jpeg")
    assert photo.with_pixels(photo.pixels.copy())._metadata == photo._metadata
    cropped = photo.with_pixels(photo.pixels[:, 10:].copy())  # nobody says which part that is
    assert set(cropped.encode("jpeg").left_out) == {"regions", "subject area"}
    _, parts = encode_with_parts(cropped, WRITTEN["jpeg"], Save())
    assert {part.name for part in parts if part.fate is Fate.TRANSFORMED} == {"EXIF", "XMP", "resolution"}
