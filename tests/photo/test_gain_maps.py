"""HDR photos stay HDR: their gain maps are warped as the pixels are, and are found again where they were."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import pyvips

import unshutter
from support.camera_files import heic
from support.covering import covering
from support.drawn_photos import encoded
from support.frame_pairs import Scene
from support.gain_maps import (
    ISO,
    ISO_OF_MAP,
    OF_APPLES_MAP,
    OF_MAP,
    STOPS,
    XMP_PREFIX,
    apples_exif,
    hdr_photo,
    heic_with_gain_map,
    light_of,
    pictures_of,
    pixels_of,
    scene,
    segment,
    segments_of,
    with_segments,
    with_tone_map,
)
from support.motion_photos import VIDEO
from support.tagged_files import with_code_points
from unshutter import Photo, RowMotion, rectify
from unshutter.inventory import Fate
from unshutter.motion.warp import straighten
from unshutter.options import Save
from unshutter.photo.formats import WRITTEN
from unshutter.photo.saving import encode_with_parts
from unshutter.run.inputs import usual_format

HEIGHT, WIDTH = 240, 320
MOTION = RowMotion.from_polynomials([0, 16, 5], [0, 0.03], HEIGHT, WIDTH)
SDR = ("gain map (the result is SDR)",)


def in_stops(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """By how many stops luminance differs, inside the picture: the outermost pixels depend on how a map is enlarged."""
    light = [np.maximum(each @ [0.2126, 0.7152, 0.0722], 0.01) for each in (one, other)]
    return np.abs(np.log2(light[0] / light[1]))[6:-6, 6:-6]


def warped_light(data: bytes, motion: RowMotion, edges: str) -> np.ndarray:
    """The light of a photo, warped as a plain picture of 16 bits."""
    light = light_of(data)
    plain = np.round((light / light.max()) ** (1 / 2.4) * 65535).astype(np.uint16)
    return (straighten(plain, motion, edges)[0] / 65535) ** 2.4 * light.max()


@pytest.mark.parametrize(
    ("map_size", "bands", "order", "edges", "readout"),
    covering(
        [(60, 80), (240, 320), (120, 160), (64, 64)],
        [1, 3],
        [">", "<"],
        ["crop", "keep", "fill"],
        ["top-to-bottom", "left-to-right"],
    ),
)
def test_the_light_is_that_of_a_plain_hdr_picture(map_size, bands, order, edges, readout) -> None:
    data = hdr_photo(HEIGHT, WIDTH, map_size, bands, order)
    size = (HEIGHT, WIDTH) if readout == "top-to-bottom" else (WIDTH, HEIGHT)
    motion = RowMotion.from_polynomials([0, 16, 5], [0, 0.03], *size, scan_direction=unshutter.ScanDirection(readout))
    result = rectify(data, motion=motion, edges=edges)
    file = result.encode()
    assert file.left_out == ()
    off = in_stops(light_of(file.data), warped_light(data, motion, edges))
    if edges == "keep":
        off = off[result.valid[6:-6, 6:-6]]
    assert off.mean() < 0.03 and np.percentile(off, 99) < 0.25  # 0.1 and 0.8 are allowed
    old, new = (pictures_of(each)[1] for each in (data, file.data))
    assert segments_of(old) == segments_of(new)
    picture = pixels_of(new)
    assert picture.shape[2:] == (() if bands == 1 else (3,))
    scale = np.array(picture.shape[:2]) / pixels_of(file.data).shape[:2]
    assert np.allclose(scale, np.array(map_size) / (HEIGHT, WIDTH), rtol=0.02)
    assert file.data[file.data.index(b"MPF\0") + 4 :][:1] == {">": b"M", "<": b"I"}[order]


def test_other_readers_find_it() -> None:
    result = rectify(hdr_photo(), motion=MOTION, edges="crop").bytes
    assert ISO + bytes(4) in segments_of(result)
    result = rectify(hdr_photo(iso=b""), motion=MOTION, edges="crop").bytes
    first, second = pictures_of(result)
    assert result == first + second and second.endswith(b"\xff\xd9")
    assert b'Item:Length="%d"' % len(second) in first and b'hdrgm:Version="1.0"' in first
    assert XMP_PREFIX + OF_MAP in segments_of(second)
    if pyvips.type_find("VipsOperation", "uhdrload_buffer"):
        found = pyvips.Image.uhdrload_buffer(result)
        assert found.get("gainmap-data") == second
        light = found.uhdr2scRGB().numpy()
        assert in_stops(light, light_of(result)).mean() < 0.02


def test_where_the_photo_shows_nothing_nothing_glows() -> None:
    result = rectify(hdr_photo(), motion=MOTION, edges="keep")
    gain = pixels_of(pictures_of(result.bytes)[1])
    outside = ~result.valid.reshape(60, 4, 80, 4).any(axis=(1, 3))
    deep = outside & np.roll(outside, 2, axis=1) & np.roll(outside, -2, axis=1)
    assert deep.any() and gain[deep].max() < 8


def test_a_photo_left_unchanged_keeps_the_map_byte_for_byte() -> None:
    data = hdr_photo()
    result = Photo.from_bytes(data).to_bytes(quality=80)
    assert pictures_of(result)[1] == pictures_of(data)[1]
    halved = rectify(data, motion=MOTION, edges="keep", strength=0.5)
    assert (
        in_stops(light_of(halved.bytes), warped_light(data, halved.motion, "keep"))[halved.valid[6:-6, 6:-6]].mean()
        < 0.03
    )


def test_the_inventory_names_its_fate_and_other_formats_say_what_is_lost() -> None:
    result = rectify(hdr_photo(), motion=MOTION, edges="crop")
    for format, fate in (("jpeg", Fate.TRANSFORMED), ("png", Fate.LEFT_OUT)):
        data, parts = encode_with_parts(result.photo, WRITTEN[format], Save())
        fates = [part.fate for part in parts if part.name == "gain map"]
        assert fates and set(fates) <= {fate, Fate.CARRIED} and fate in fates
        assert (b"hdrgm:Version=" in data, b"Container:Directory" in data) == (format == "jpeg", format == "jpeg")
    assert result.encode("png").left_out == result.encode("webp").left_out == SDR
    assert result.photo.hdr_formats == ("jpeg", "avif") and result.photo.with_pixels(result.pixels).hdr_formats == ()
    assert Photo.from_bytes(result.encode("png").data).encode().left_out == ()


@pytest.mark.parametrize("of_map", [b"\xff\xd8\xff\xe1\0\x04ab\xff\xd9", None])
def test_a_damaged_map_costs_only_the_map(of_map: bytes | None) -> None:
    data = hdr_photo()
    base, gain_map = pictures_of(data)
    if of_map is None:  # more than twice as large as the photo
        large = encoded(np.zeros((2 * HEIGHT + 1, WIDTH), np.uint8), "JPEG")
        of_map = with_segments(large, segment(0xE1, XMP_PREFIX + OF_MAP))
    else:
        of_map = gain_map[: len(gain_map) // 2] + b"\xff\xd9"
    for format in ("avif", "jpeg"):
        assert Photo.from_bytes(base + of_map).encode(format).left_out == (SDR if format == "avif" else ())
    file = rectify(base + of_map, motion=MOTION, edges="crop").encode()
    assert file.left_out == SDR and b"hdrgm:Version=" not in file.data and b"MPF\0" not in file.data


def test_apples_map_has_no_entry_in_xmp_and_keeps_its_own_metadata() -> None:
    data = hdr_photo(of_map=OF_APPLES_MAP)
    base, gain_map = pictures_of(data)
    plain = Photo.from_bytes(data.replace(segments_of(base)[1], bytes(len(segments_of(base)[1]))))
    result = rectify(plain, motion=MOTION, edges="crop").encode()
    new = pictures_of(result.data)[1]
    assert "gain map" not in " ".join(result.left_out) and XMP_PREFIX + OF_APPLES_MAP in segments_of(new)
    assert segments_of(new) == segments_of(gain_map)


def test_apples_map_becomes_one_of_iso_in_avif() -> None:
    """By Apple's formula, the light is multiplied by 1 + (8 - 1) * the map, which is coded by BT.709."""
    data = hdr_photo(of_map=OF_APPLES_MAP, iso=b"", map_size=(120, 160))
    base, gain = (pixels_of(each) / 255 for each in pictures_of(data))
    linear = np.where(base <= 0.04045, base / 12.92, ((base + 0.055) / 1.055) ** 2.4)
    share = np.where(gain < 0.081, gain / 4.5, ((gain + 0.099) / 1.099) ** (1 / 0.45))
    light = linear * (1 + 7 * cv2.resize(share, base.shape[1::-1], interpolation=cv2.INTER_LINEAR))[..., None]
    plain = np.round((light / light.max()) ** (1 / 2.4) * 65535).astype(np.uint16)
    expected = (straighten(plain, MOTION, "crop")[0] / 65535) ** 2.4 * light.max()
    file = rectify(data, motion=MOTION, edges="crop").encode("avif")
    off = in_stops(light_of(file.data), expected)
    assert file.left_out == () and ISO_OF_MAP in file.data
    assert off.mean() < 0.04 and np.percentile(off, 99) < 0.3


@pytest.mark.parametrize(
    ("headroom", "gain", "stops"), [(1.01, 1.1846, 1.9441), (1.01, 0.005, 2.65), (0.9, 0.005, 1.7), (0.9, 1, 1.5)]
)
def test_apples_maker_note_says_how_bright_its_map_is(headroom: float, gain: float, stops: float) -> None:
    """The first numbers are an iPhone's, whose XMP says 3.848."""
    data = hdr_photo(of_map=OF_APPLES_MAP.replace(b"GainMapHeadroom", b"Headroom"), iso=b"")
    exif = apples_exif(headroom, gain)
    old = next(each for each in segments_of(pictures_of(data)[0]) if each.startswith(b"Exif"))
    photo = Photo.from_bytes(data.replace(segment(0xE1, old), segment(0xE1, exif)))
    assert photo.auxiliaries.meaning.stops == pytest.approx(stops, abs=1e-3)
    assert photo.hdr_formats == ("jpeg", "avif")


def test_a_motion_photos_map_comes_before_its_video() -> None:
    item = b'<rdf:li rdf:parseType="Resource"><Container:Item Item:Mime="image/jpeg" Item:Semantic="Primary"/></rdf:li>'
    data = hdr_photo()
    base = pictures_of(data)[0]
    more = item.replace(b"image/jpeg", b"video/mp4").replace(
        b'"Primary"', b'"MotionPhoto" Item:Length="%d"' % len(VIDEO)
    )
    old = segments_of(base)[1]
    new = old.replace(b"</rdf:Seq>", more + b"</rdf:Seq>")
    data = base.replace(segment(0xE1, old), segment(0xE1, new)) + data[len(base) :] + VIDEO
    file = rectify(data, motion=MOTION, edges="crop").encode()
    gain_map = file.data[: -len(VIDEO)]
    gain_map = gain_map[gain_map.rindex(b"\xff\xd8\xff") :]
    assert file.left_out == () and file.data.endswith(VIDEO) and OF_MAP in gain_map
    assert b'Item:Length="%d"' % len(gain_map) in file.data and b'Item:Length="%d"' % len(VIDEO) in file.data


def test_frames_of_a_sequence_keep_their_maps() -> None:
    seen = Scene(speed=(20, 3))
    frames = [seen.frame(number, 0.8) for number in range(3)]
    size = frames[0].shape[0] // 4, frames[0].shape[1] // 4
    photos = [hdr_photo(*each.shape[:2], size, picture=(each, each[..., 1] / 255 * STOPS)) for each in frames]
    for model, edges in (("camera", "auto"), ("dense", "crop")):
        result = list(unshutter.rectify_frames(photos, readout_ratio=0.8, model=model, edges=edges))[1]
        file = result.encode()
        assert result.changed and result.model == model and file.left_out == ()
        base, gain = (pixels_of(each) for each in pictures_of(file.data))  # the map is a copy of the picture
        small = cv2.resize(base[..., 1], gain.shape[::-1], interpolation=cv2.INTER_AREA)
        assert np.abs(small.astype(float) - gain)[4:-4, 8:-8].mean() < 3


@pytest.mark.parametrize("orientation", [1, 6])
def test_heic_gives_its_map_to_a_jpeg(orientation: int, tmp_path: Path) -> None:
    base, gain = scene(HEIGHT, WIDTH)
    shown = np.dstack([base, np.round(gain / STOPS * 255).astype(np.uint8)])
    data = heic_with_gain_map(shown, orientation)
    photo = Photo.from_bytes(data)
    assert photo.orientation == orientation and photo.bands == 3
    motion = RowMotion.from_polynomials([0, 16, 5], [0, 0.03], photo.height, photo.width)
    result = rectify(photo, motion=motion, edges="fill")
    assert result.encode().left_out == () and result.encode("avif").left_out == SDR
    assert np.abs(photo.auxiliaries.gain_map.pixels[..., 0].astype(int) - shown[..., 3]).mean() < 2
    second = pictures_of(result.bytes)[1]
    exact = rectify(photo.with_pixels(np.array(photo.auxiliaries.gain_map.pixels)), motion=motion, edges="fill")
    assert np.abs(pixels_of(second).astype(float) - exact.array).mean() < 1.5
    assert b"hdrgainmap" in segments_of(second)[0]
    before, after = (Photo.from_bytes(each) for each in (data, result.bytes))
    assert after.orientation == before.orientation and after.format == "jpeg"
    path = tmp_path / "a.heic"
    path.write_bytes(data)
    assert usual_format(path) == "jpeg" and Photo.open(path).usual_format == "jpeg"
    path.write_bytes(with_code_points(data, 9, 16))  # the picture itself is HDR, and its map makes it SDR
    coded = Photo.open(path)
    assert usual_format(path) is None and coded.usual_format == "avif" and coded.hdr_formats == ("png", "avif")
    assert coded.encode().left_out == ("gain map",)
    path.write_bytes(heic(base))
    assert usual_format(path) is None and Photo.open(path).usual_format == "avif"


def of_iso(format: str, **options: object) -> bytes:
    """A photo of a scene with a gain map that is no auxiliary picture."""
    base, gain = scene(HEIGHT, WIDTH)
    small = np.dstack([np.round(255 / STOPS * gain[::2, ::2]).astype(np.uint8)] * 3)
    base, small = (heic(each) if format == "heic" else encoded(each, "AVIF", quality=98) for each in (base, small))
    return with_tone_map(base, small, **options)


@pytest.mark.parametrize("format", ["avif", "heic"])
def test_maps_of_iso_are_kept_in_jpeg_and_avif(format: str, tmp_path: Path) -> None:
    data = of_iso(format)
    path = tmp_path / f"a.{format}"
    path.write_bytes(data)
    usual = "avif" if format == "avif" else "jpeg"
    photo = Photo.open(path)
    assert photo.usual_format == usual == (usual_format(path) or "avif") and photo.hdr_formats == ("jpeg", "avif")
    expected = warped_light(data, MOTION, "crop")
    result = rectify(photo, motion=MOTION, edges="crop")
    for to in ("jpeg", "avif"):
        file = result.encode(to)
        assert file.left_out == () and ISO_OF_MAP in file.data
        off = in_stops(light_of(file.data), expected)
        assert off.mean() < 0.04 and np.percentile(off, 99) < 0.3
        again = Photo.from_bytes(file.data)
        assert again.auxiliaries.meaning.metadata == ISO_OF_MAP and again.encode().left_out == ()
    assert result.encode("png").left_out == SDR


def test_a_jpegs_map_is_kept_in_avif_with_what_its_xmp_says() -> None:
    data = hdr_photo(iso=b"", map_size=(120, 160))
    result = rectify(data, motion=MOTION, edges="crop")
    file = result.encode("avif")
    assert file.left_out == () and file.data.count(b"\0" + ISO_OF_MAP) == 1
    assert in_stops(light_of(file.data), warped_light(data, MOTION, "crop")).mean() < 0.04
    assert file.data.count(b"colrnclx\0\1\0\x10") == 1  # the HDR picture is in PQ
    assert b"hdrgm:Version" not in file.data and b"Container:Directory" not in file.data
    photo = Photo.from_bytes(file.data)
    assert photo.to_bytes("jpeg").count(ISO + ISO_OF_MAP) == 1
    exif = Photo.from_bytes(data).to_bytes("avif", quality=50)
    assert b"Acme" in exif and Photo.from_bytes(exif).auxiliaries is not None
    three = OF_MAP.replace(b' hdrgm:GainMapMax="3"', b"").replace(
        b"/></rdf:RDF>",
        b"><hdrgm:GainMapMax><rdf:Seq><rdf:li>1</rdf:li><rdf:li>2.5</rdf:li><rdf:li>3</rdf:li></rdf:Seq>"
        b"</hdrgm:GainMapMax></rdf:Description></rdf:RDF>",
    )
    channels = Photo.from_bytes(hdr_photo(iso=b"", of_map=three)).auxiliaries.meaning.metadata
    assert len(channels) == 5 + 4 * 4 + 3 * 40 and channels[4] == 0xC0
    greatest = [np.frombuffer(channels, ">i4", 2, 21 + 40 * at + 8) for at in range(3)]
    assert [list(each) for each in greatest] == [[1, 1], [5, 2], [3, 1]]
    for damaged in (OF_MAP.replace(b'Max="3"', b'Max="nan"'), OF_MAP.replace(b'Gamma="1"', b'Gamma="1e99"')):
        assert Photo.from_bytes(hdr_photo(iso=b"", of_map=damaged)).encode("avif").left_out == SDR


@pytest.mark.parametrize(
    "options", [{"brand": b"miaf"}, {"metadata": b"\0\1" + ISO_OF_MAP[2:]}, {"metadata": bytes(70_000)}]
)
def test_maps_that_readers_ignore_are_left_out_by_their_name(options: dict[str, bytes]) -> None:
    photo = Photo.from_bytes(of_iso("avif", **options))
    assert photo.hdr_formats == () and photo.encode("jpeg").left_out == photo.encode().left_out == SDR


@pytest.mark.parametrize("format", ["avif", "heic"])
def test_a_map_that_is_applied_in_other_colours_is_kept_in_avif_only(format: str, tmp_path: Path) -> None:
    metadata = ISO_OF_MAP[:4] + b"\x80" + ISO_OF_MAP[5:]
    path = tmp_path / f"a.{format}"
    path.write_bytes(of_iso(format, metadata=metadata, primaries=9))
    photo = Photo.open(path)
    assert photo.hdr_formats == ("avif",) and photo.usual_format == "avif" and usual_format(path) is None
    file = photo.encode()
    assert file.left_out == () and file.data.count(b"colrnclx\0\x09\0\x10") == 1
    assert photo.encode("jpeg").left_out == SDR
    path.write_bytes(of_iso(format, metadata=metadata))
    assert Photo.open(path).hdr_formats == ("jpeg", "avif")


def test_a_map_that_makes_a_picture_in_pq_sdr_is_kept_in_avif() -> None:
    photo = Photo.from_bytes(with_code_points(of_iso("avif"), 9, 16))
    result = rectify(photo, motion=MOTION, edges="crop")
    assert photo.hdr_formats == ("png", "avif")
    file = result.encode()
    assert file.left_out == () and Photo.from_bytes(file.data).auxiliaries.meaning.metadata == ISO_OF_MAP
    assert file.data.count(b"colrnclx\0\x09\0\x10") == 1 and result.encode("png").left_out == ("gain map",)
