"""PNG: its chunks, texts and resolution, colours and animations."""

import io
import struct
import zlib

import pytest
from PIL import Image

from support.drawn_photos import drawn, encoded
from support.tagged_files import SRGB, TITLE, check_rich_exif, image_resources, rich_exif
from unshutter import UnshutterError
from unshutter.photo import Photo, chunks
from unshutter.photo.formats import WRITTEN, picture_format, png

XMP = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"/></x:xmpmeta>'
UMLAUT = "© Müller"


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png_with(*chunks: tuple[bytes, bytes], at_the_end: bool = False, **options) -> bytes:
    """A PNG with chunks right behind its header, or behind its pixels."""
    data = encoded(drawn(), "PNG", **options)
    at = len(data) - 12 if at_the_end else 33
    return data[:at] + b"".join(chunk(*pair) for pair in chunks) + data[at:]


def chunks_of(data: bytes) -> list[tuple[bytes, bytes]]:
    at, found = 8, []
    while at < len(data):
        length, name = struct.unpack_from(">I4s", data, at)
        content = data[at + 8 : at + 8 + length]
        assert struct.unpack_from(">I", data, at + 8 + length) == (zlib.crc32(name + content),)
        found.append((name, content))
        at += 12 + length
    return found


def raw_profile(kind: bytes, data: bytes) -> tuple[bytes, bytes]:
    """What ImageMagick makes of a JPEG's metadata."""
    digits = data.hex().encode()
    lines = b"\n".join(digits[i : i + 72] for i in range(0, len(digits), 72))
    text = b"\n%s\n%8d\n%s\n" % (kind, len(data), lines)
    return b"zTXt", b"Raw profile type " + kind + b"\0\0" + zlib.compress(text)


def again(data: bytes) -> bytes:
    """The file of other pixels with the same metadata; nothing is left out."""
    file = Photo.from_bytes(data).with_pixels(drawn()).encode()
    assert file.left_out == ()
    return file.data


@pytest.mark.parametrize("phys", [None, struct.pack(">IIB", 11811, 11811, 1), struct.pack(">IIB", 3, 2, 0)])
def test_the_resolution_is_what_it_was_and_none_is_made_up(phys):
    data = again(png_with(*([] if phys is None else [(b"pHYs", phys)])))
    assert dict(chunks_of(data)).get(b"pHYs") == phys


# ---- texts ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at_the_end", [False, True])
@pytest.mark.parametrize(
    "text",
    [
        (b"tEXt", b"Copyright\0" + UMLAUT.encode("latin-1")),
        (b"iTXt", b"Copyright\0\0\0de\0Urheber\0" + UMLAUT.encode()),
        (b"zTXt", b"Copyright\0\0" + zlib.compress(UMLAUT.encode("latin-1"))),
        (b"tEXt", b"Creation Time\x002020-01-01"),
        (b"tIME", bytes([7, 228, 1, 2, 3, 4, 5])),
    ],
)
def test_texts_stay_as_they_are_wherever_they_stand(text, at_the_end):
    assert text in chunks_of(again(png_with(text, at_the_end=at_the_end)))


def test_texts_that_another_format_has_no_place_for_are_named():
    file = Photo.from_bytes(png_with((b"tEXt", b"Title\0Street"))).encode("jpeg")
    assert file.left_out == ("texts",)


# ---- EXIF, XMP, IPTC, profiles -------------------------------------------------------------------------


@pytest.mark.parametrize("at_the_end", [False, True])
@pytest.mark.parametrize("form", ["chunk", b"exif", b"APP1"])
def test_exif_is_found_in_a_chunk_or_a_raw_profile_wherever_it_stands(form, at_the_end):
    blob = rich_exif(6)
    pair = (b"eXIf", blob.removeprefix(b"Exif\0\0")) if form == "chunk" else raw_profile(form, blob)
    data = png_with(pair, at_the_end=at_the_end)
    assert Photo.from_bytes(data).orientation == 6
    check_rich_exif(again(data))
    check_rich_exif(Photo.from_bytes(data).to_bytes("jpeg"))
    assert [name for name, _ in chunks_of(again(data))] == [b"IHDR", b"eXIf", b"IDAT", b"IEND"]


@pytest.mark.parametrize("at_the_end", [False, True])
@pytest.mark.parametrize(
    "pair",
    [
        (b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + XMP),
        (b"iTXt", b"XML:com.adobe.xmp\0\1\0\0\0" + zlib.compress(XMP)),
        (b"zTXt", b"XML:com.adobe.xmp\0\0" + zlib.compress(XMP)),
        raw_profile(b"xmp", XMP),
        raw_profile(b"APP1", b"http://ns.adobe.com/xap/1.0/\0" + XMP),
    ],
)
def test_xmp_becomes_a_chunk_as_adobe_specifies_it(pair, at_the_end):
    assert (b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + XMP) in chunks_of(again(png_with(pair, at_the_end=at_the_end)))


@pytest.mark.parametrize("kind", [b"iptc", b"8bim"])
@pytest.mark.parametrize("data", [image_resources((1028, TITLE)), TITLE])
def test_iptc_stays_in_png_and_goes_to_jpeg(kind, data):
    source = png_with(raw_profile(kind, data))
    expected = chunks.RESOURCES_PREFIX + image_resources((1028, TITLE))
    for result in (again(source), Photo.from_bytes(source).to_bytes("jpeg")):
        assert Photo.from_bytes(Photo.from_bytes(result).to_bytes("jpeg")).encode("png").left_out == ()
        assert expected in Photo.from_bytes(result).to_bytes("jpeg")


def test_a_profile_written_as_text_is_a_profile():
    with Image.open(io.BytesIO(again(png_with(raw_profile(b"icc", SRGB))))) as picture:
        assert picture.info["icc_profile"] == SRGB


@pytest.mark.parametrize(
    "pair",
    [
        (b"zTXt", b"Raw profile type exif\0\0" + zlib.compress(b"\nexif\n 8\nnothing\n")),
        (b"zTXt", b"Raw profile type exif\0\0" + b"no zlib data"),
    ],
    ids=["digits", "zlib"],
)
def test_metadata_that_cannot_be_read_are_named(pair):
    assert Photo.from_bytes(png_with(pair)).encode().left_out == ("EXIF (damaged)",)


def test_bytes_behind_a_raw_profile_are_no_damage():
    name, packed = raw_profile(b"xmp", XMP)
    head, text = packed[:22], zlib.decompress(packed[22:])
    pair = name, head + zlib.compress(text + b"\n}\xd1\1")
    assert head.endswith(b"xmp\0\0")
    assert (b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + XMP) in chunks_of(again(png_with(pair)))


def test_metadata_that_are_too_long_are_named(monkeypatch):
    packed = (b"zTXt", b"XML:com.adobe.xmp\0\0" + zlib.compress(XMP))
    assert Photo.from_bytes(png_with(packed)).encode().left_out == ()
    monkeypatch.setattr(png, "_LONGEST", len(XMP) - 1)
    assert Photo.from_bytes(png_with(packed)).encode().left_out == ("XMP (damaged)",)


@pytest.mark.parametrize("at_the_end", [False, True])
@pytest.mark.parametrize("form", ["chunk", "raw profile"])
def test_exif_that_goes_round_in_circles_is_left_out(at_the_end, form):
    loop = b"II*\0" + struct.pack("<IHHHII", 8, 1, 0x8769, 4, 1, 8) + bytes(4)
    pair = (b"eXIf", loop) if form == "chunk" else raw_profile(b"exif", loop)
    data = png_with(pair, at_the_end=at_the_end)
    is_read = form == "chunk" and not at_the_end  # by libvips
    assert bool(WRITTEN["png"].hidden_markers(io.BytesIO(data))) == is_read
    photo = Photo.from_bytes(data)
    result = photo.encode()
    assert result.left_out == ("EXIF (damaged)",) and b"eXIf" not in result.data
    assert (photo.to_array() == drawn()).all()


# ---- colours, other chunks -----------------------------------------------------------------------------

P3 = struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)
SRGB_PRIMARIES = struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)


@pytest.mark.parametrize(
    "pair",
    [
        (b"gAMA", struct.pack(">I", 100_000)),
        (b"cHRM", P3),
        (b"sRGB", b"\0"),
        (b"cICP", bytes([1, 13, 0, 1])),
        (b"cICP", bytes([12, 13, 0, 1])),
        (b"bKGD", bytes([0, 1, 0, 2, 0, 3])),
        (b"vpAg", bytes(9)),
    ],
)
def test_colours_and_chunks_that_say_they_may_be_copied_are_kept(pair):
    data = again(png_with(pair))
    names = [name for name, _ in chunks_of(data)]
    assert pair in chunks_of(data) and names.index(pair[0]) < names.index(b"IDAT")


def test_colours_that_another_format_would_lose_are_named():
    def left_out(*pairs: tuple[bytes, bytes], **options) -> tuple[str, ...]:
        return Photo.from_bytes(png_with(*pairs, **options)).encode("jpeg").left_out

    usual = (b"gAMA", struct.pack(">I", 45455))
    assert left_out(usual, (b"cHRM", P3)) == ("colours",)
    assert left_out(usual, (b"cHRM", SRGB_PRIMARIES)) == left_out(usual) == left_out((b"sRGB", b"\0")) == ()
    assert left_out(usual, (b"cHRM", P3), icc_profile=SRGB) == ()


def test_colours_of_display_p3_become_a_profile_in_other_formats():
    photo = Photo.from_bytes(png_with((b"cICP", bytes([12, 13, 0, 1]))))
    with Image.open(io.BytesIO(photo.to_bytes("jpeg"))) as picture:
        assert picture.info["icc_profile"]


@pytest.mark.parametrize(
    ("pair", "name"),
    [
        ((b"caBX", b"signed"), "content credentials"),
        ((b"prVW", b"small"), "other data"),
        ((b"bKGD", b"\0"), "other data"),  # too short for three channels
    ],
)
def test_chunks_that_new_pixels_make_false_are_named(pair, name):
    assert Photo.from_bytes(png_with(pair)).encode().left_out == (name,)


@pytest.mark.parametrize(
    ("mode", "told", "kept"),
    [
        ("P", b"\1", (30, 20, 10)),  # the second colour of the palette
        ("1", b"\0\1", (255,)),
        ("L", b"\0\x70", (0x70,)),
        ("RGB", bytes([0, 1, 0, 2, 0, 3]), (1, 2, 3)),
    ],
)
def test_the_background_colour_is_kept_in_whatever_form_it_stands(mode, told, kept):
    picture = Image.new("P" if mode == "P" else mode, (80, 48))
    if mode == "P":
        picture.putpalette(bytes([1, 2, 3, 30, 20, 10]))
    stream = io.BytesIO()
    picture.save(stream, "PNG")
    data = stream.getvalue()
    at = data.index(b"IDAT") - 4
    photo = Photo.from_bytes(data[:at] + chunk(b"bKGD", told) + data[at:])
    file = photo.with_pixels(photo.pixels).encode()
    assert (b"bKGD", struct.pack(f">{len(kept)}H", *kept)) in chunks_of(file.data) and file.left_out == ()
    assert photo.encode("webp").left_out == ("other data",)


def test_data_behind_the_last_chunk_are_named():
    data = png_with()
    assert Photo.from_bytes(data + bytes(100)).encode().left_out == ()  # fill
    assert Photo.from_bytes(data + b"PK\3\4 of a program").encode().left_out == ("other data",)


def test_chunks_of_the_old_coding_go_without_a_word():
    assert [name for name, _ in chunks_of(again(png_with((b"iDOT", bytes(28)))))] == [b"IHDR", b"IDAT", b"IEND"]


def test_a_damaged_chunk_is_left_out_and_named():
    data = png_with((b"tEXt", b"Title\0Street"), at_the_end=True)
    file = Photo.from_bytes(data.replace(b"Street", b"Strxxt")).encode()
    assert file.left_out == ("other data",) and b"Str" not in file.data


# ---- animations ----------------------------------------------------------------------------------------


def test_an_animation_is_refused():
    stream = io.BytesIO()
    Image.fromarray(drawn()).save(stream, "PNG", save_all=True, append_images=[Image.fromarray(drawn() // 2)])
    with pytest.raises(UnshutterError, match="is an animation: unshutter takes single photos"):
        Photo.from_bytes(stream.getvalue())


def test_an_animation_of_one_frame_is_a_photo():
    frame = struct.pack(">5I2H2B", 0, 80, 48, 0, 0, 1, 1, 0, 0)
    still = png_with((b"acTL", struct.pack(">II", 1, 0)), (b"fcTL", frame))
    assert [name for name, _ in chunks_of(again(still))] == [b"IHDR", b"IDAT", b"IEND"]
    assert Photo.from_bytes(still).encode().left_out == ()
    behind = (
        still[:-12] + chunk(b"fdAT", bytes(4) + zlib.compress(bytes(100))) + still[-12:]
    )  # another than the default
    assert Photo.from_bytes(behind).encode().left_out == ("further pictures",)


def test_packed_texts_are_not_unpacked(monkeypatch):
    """Where they might be long when unpacked, libvips does not see them; they are carried as they are."""
    texts = [(b"zTXt", b"k%d\0\0" % k + zlib.compress(b"of a program")) for k in range(20)]
    data = png_with(*texts)
    shown = []

    def noted(format, source, hide=picture_format.readable):
        shown.append(hide(format, source))
        return shown[-1]

    monkeypatch.setattr(png, "zlib", None)
    monkeypatch.setattr(picture_format, "readable", noted)
    for limit in (png._LONGEST, 1000):
        monkeypatch.setattr(png, "_LONGEST", limit)
        photo = Photo.from_bytes(data)
        made = photo.with_pixels(photo.pixels.copy()).encode()
        assert made.left_out == ()
        assert all(made.data.count(content) == 1 for _, content in texts)
        with shown[-1].stream() as stream:
            assert stream.read().count(b"zTXt") == (0 if limit == 1000 else 20)
