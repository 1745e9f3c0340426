"""Photos with videos and gain maps beside the picture, as phones write them."""

import struct

import numpy as np

from support.tagged_files import jpeg_with

VIDEO = b"\0\0\0\x18ftypmp42" + bytes(12) + bytes(range(256)) * 8
GAIN_MAP = b"\xff\xd8gain map\xff\xd9"


def item(semantic: str, length: int, mime: str = "image/jpeg") -> str:
    told = f'Item:Mime="{mime}" Item:Semantic="{semantic}" Item:Length="{length}" Item:Padding="7"'
    return f'<rdf:li rdf:parseType="Resource"><Container:Item {told}/></rdf:li>'


def packet(items: str, attributes: str = "", more: str = "") -> bytes:
    return (
        '<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
        'xmlns:Cam="http://ns.google.com/photos/1.0/camera/" xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" '
        'xmlns:Container="http://ns.google.com/photos/1.0/container/" xmlns:xmp="http://ns.adobe.com/xap/1.0/" '
        f'xmlns:Item="http://ns.google.com/photos/1.0/container/item/" xmp:Rating="4" {attributes}>'
        f"<Container:Directory><rdf:Seq>{items}</rdf:Seq></Container:Directory>{more}"
        '</rdf:Description></rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
    ).encode()


WITH_ALL = packet(
    item("Primary", 0) + item("GainMap", len(GAIN_MAP)) + item("MotionPhoto", len(VIDEO), "video/mp4"),
    'hdrgm:Version="1.0" Cam:MotionPhoto="1" Cam:MotionPhotoVersion="1"',
    "<hdrgm:GainMapMax>3.0</hdrgm:GainMapMax>",
)


def motion_photo(pixels: np.ndarray, xmp: bytes = WITH_ALL, after: bytes = GAIN_MAP + VIDEO) -> bytes:
    return jpeg_with(pixels, (0xE1, b"http://ns.adobe.com/xap/1.0/\0" + xmp)) + after


def block(kind: int, name: bytes, content: bytes) -> bytes:
    """A block of Samsung's trailer."""
    return struct.pack("<2xHI", kind, len(name)) + name + content


VIDEO_BLOCK = block(0x0A30, b"MotionPhoto_Data", VIDEO)
TIME = block(0x0A01, b"Image_UTC_Data", b"1700000000000")
DEPTHS = block(0x0AB1, b"DualShot_DepthMap", bytes(range(100)))
VERSION = block(0x0A31, b"MotionPhoto_Version", b"mpv3")


def trailer(*blocks: bytes) -> bytes:
    """Samsung's trailer: blocks, and how far before the directory each of them begins."""
    ends = [sum(map(len, blocks[k:])) for k in range(len(blocks))]
    entries = b"".join(
        each[:4] + struct.pack("<II", before, len(each)) for each, before in zip(blocks, ends, strict=True)
    )
    directory = b"SEFH" + struct.pack("<II", 107, len(blocks)) + entries
    return b"".join(blocks) + directory + struct.pack("<I", len(directory)) + b"SEFT"
