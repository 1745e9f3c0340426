"""EXIF, IPTC, XMP and colours as cameras and editors write them."""

import io
import struct

import numpy as np
import pyvips
from PIL import Image, ImageCms
from PIL.TiffImagePlugin import IFDRational

from support.drawn_photos import encoded
from unshutter.photo.chunks import encoded_chunk

EXIF, GPS = 0x8769, 0x8825


def exif_blob(orientation=1, **tags):
    """An EXIF blob by Pillow, with tags of the first directory by number."""
    exif = Image.Exif()
    exif.update({0x010F: "Acme", 0x0112: orientation} | {int(tag): value for tag, value in tags.items()})
    return exif.tobytes()


ABOUT_CAMERA = {0x010F: "Acme", 0x0110: "Model 1", 0x0131: "1.0", 0x0132: "2024:05:06 07:08:09", 0x8298: "(c) me"}
ABOUT_EXPOSURE = {
    0x829A: IFDRational(1, 125),
    0x9003: "2024:05:06 07:08:09",
    0x9010: "+02:00",
    0x920A: IFDRational(425, 100),
    0x927C: b"Acme\0\1\2" + bytes(range(100)),
    0x9286: b"ASCII\0\0\0a comment",
    0xA405: 26,
    0xA434: "Lens 24-70 mm",
}
ABOUT_PLACE = {
    1: "N",
    2: (IFDRational(48), IFDRational(51), IFDRational(2949, 100)),
    3: "E",
    4: (IFDRational(2), IFDRational(17), IFDRational(4021, 100)),
    6: IFDRational(351, 10),
}


def full_exif(order="<", orientation=6):
    """An EXIF blob by Pillow, in either byte order, with the tags above."""
    tags = Image.Exif()
    tags.endian = order
    tags.update(ABOUT_CAMERA | {0x0112: orientation})
    tags.get_ifd(EXIF).update(ABOUT_EXPOSURE | {0xA002: 4000, 0xA003: 3000})  # EXIF
    tags.get_ifd(GPS).update(ABOUT_PLACE)  # GPS
    blob = tags.tobytes()
    assert blob[6:8] == (b"II" if order == "<" else b"MM")
    return blob


NOTE = b"Acme\0" + bytes(range(200))


def rich_exif(orientation=1):
    exif = Image.Exif()
    exif.update({0x010F: "Acme", 0x0110: "One", 0x0112: orientation, 0x0132: "2024:05:06 07:08:09"})
    exif.get_ifd(EXIF).update({0x9003: "2024:05:06 07:08:09", 0x927C: NOTE, 0xA405: 26})
    exif.get_ifd(GPS).update({1: "N", 2: (48.0, 51.0, 29.5)})
    return exif.tobytes()


def check_rich_exif(data: bytes) -> None:
    with Image.open(io.BytesIO(data)) as picture:
        tags = picture.getexif()
    assert tags[0x0132] == tags.get_ifd(EXIF)[0x9003] == "2024:05:06 07:08:09"
    assert tags.get_ifd(EXIF)[0x927C] == NOTE and tags.get_ifd(GPS)[2] == (48.0, 51.0, 29.5)


def tiff_with_exif(order, pixels):
    """A TIFF of grey pixels in either byte order with the tags of full_exif, put together by hand."""

    def value(content):
        if isinstance(content, str):
            return 2, content.encode() + b"\0"
        if isinstance(content, bytes):
            return 7, content
        if isinstance(content, int):
            return 4, struct.pack(order + "I", content)
        parts = content if isinstance(content, tuple) else (content,)
        return 5, b"".join(struct.pack(order + "II", part.numerator, part.denominator) for part in parts)

    def directory(tags, at):
        packed, values = struct.pack(order + "H", len(tags)), b""
        for tag, content in sorted(tags.items()):
            kind, data = value(content)
            count = len(data) // {2: 1, 4: 4, 5: 8, 7: 1}[kind]
            packed += struct.pack(order + "HHI", tag, kind, count)
            if len(data) <= 4:
                packed += data.ljust(4, b"\0")
            else:
                packed += struct.pack(order + "I", at + 2 + 12 * len(tags) + 4 + len(values))
                values += data + bytes(len(data) % 2)
        return packed + bytes(4) + values

    height, width = pixels.shape
    data = (b"II*\0" if order == "<" else b"MM\0*") + bytes(4) + pixels.tobytes()
    pointers = {}
    for tag, tags in ((EXIF, ABOUT_EXPOSURE), (GPS, ABOUT_PLACE)):
        data += bytes(len(data) % 2)
        pointers[tag] = len(data)
        data += directory(tags, len(data))
    picture = {256: width, 257: height, 258: 8, 259: 1, 262: 1, 273: 8, 277: 1, 278: height, 279: height * width}
    data += bytes(len(data) % 2)
    start = struct.pack(order + "I", len(data))
    data += directory(picture | ABOUT_CAMERA | {0x0112: 6} | pointers, len(data))
    return data[:4] + start + data[8:]


def jpeg_thumbnail(exif):
    """The thumbnail that an EXIF blob holds, as a picture; None without one."""
    tiff = exif.removeprefix(b"Exif\0\0")
    order = {b"II": "<", b"MM": ">"}[tiff[:2]]
    (first,) = struct.unpack_from(order + "I", tiff, 4)
    (count,) = struct.unpack_from(order + "H", tiff, first)
    (second,) = struct.unpack_from(order + "I", tiff, first + 2 + 12 * count)
    if not second:
        return None
    (count,) = struct.unpack_from(order + "H", tiff, second)
    entries = (struct.unpack_from(order + "HHII", tiff, second + 2 + 12 * i) for i in range(count))
    tags = {tag: value for tag, _, _, value in entries}
    return Image.open(io.BytesIO(tiff[tags[0x0201] : tags[0x0201] + tags[0x0202]]))


def small_jpeg() -> bytes:
    """A thumbnail: red, which no picture here is."""
    stream = io.BytesIO()
    Image.new("RGB", (160, 120), (200, 10, 10)).save(stream, "JPEG")
    return stream.getvalue()


def blob_with_thumbnail(order: str = "<") -> bytes:
    """An EXIF blob, put together by hand, with a thumbnail in its second directory."""
    thumbnail = small_jpeg()
    first = struct.pack(order + "HHHIHHI", 1, 0x0112, 3, 1, 1, 0, 26)
    second = struct.pack(order + "HHHIHH", 3, 0x0103, 3, 1, 6, 0)
    second += struct.pack(order + "HHIIHHIII", 0x0201, 4, 1, 26 + 42, 0x0202, 4, 1, len(thumbnail), 0)
    head = b"II*\0" if order == "<" else b"MM\0*"
    return b"Exif\0\0" + head + struct.pack(order + "I", 8) + first + second + thumbnail


def image_resources(*kinds_and_data: tuple[int, bytes]) -> bytes:
    """Photoshop's image resource blocks."""
    blocks = (
        b"8BIM" + struct.pack(">HHI", kind, 0, len(data)) + data + bytes(len(data) % 2) for kind, data in kinds_and_data
    )
    return b"".join(blocks)


TITLE = b"\x1c\x02\x05\0\x06Street"  # an IPTC record


def jpeg_with(pixels: np.ndarray, *segments: tuple[int, bytes], **options) -> bytes:
    data = encoded(pixels, "JPEG", **options)
    added = (struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content for marker, content in segments)
    return data[:2] + b"".join(added) + data[2:]


RATED_XMP = (
    b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    b'<rdf:Description xmp:Rating="4"/></rdf:RDF></x:xmpmeta>'
)
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def png_with_chunks(data: bytes, *chunks: tuple[bytes, bytes]) -> bytes:
    """The PNG with chunks right behind its header."""
    added = b"".join(encoded_chunk(*pair) for pair in chunks)
    return data[:33] + added + data[33:]


def with_code_points(data: bytes, primaries: int, transfer: int) -> bytes:
    """The same box file with other colours said."""
    at = data.index(b"colrnclx") + 8
    return data[:at] + struct.pack(">HH", primaries, transfer) + data[at + 4 :]


_DRONE_XMP = """<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" {}</rdf:Description></rdf:RDF></x:xmpmeta>"""


ATTRIBUTES = 'drone-dji:GimbalRollDegree="{}" drone-dji:GimbalPitchDegree="{}">'
_ELEMENT = "<drone-dji:Gimbal{0}Degree>{{}}</drone-dji:Gimbal{0}Degree>"


ELEMENTS = ">" + _ELEMENT.format("Roll") + _ELEMENT.format("Pitch")


def jpeg_of_drone(pixels: np.ndarray, roll: str, tilt: str, form: str = ATTRIBUTES) -> bytes:
    image = pyvips.Image.new_from_array(pixels)
    image = image.copy()
    image.set_type(pyvips.GValue.blob_type, "xmp-data", _DRONE_XMP.format(form.format(roll, tilt)).encode())
    return image.jpegsave_buffer(Q=92)
