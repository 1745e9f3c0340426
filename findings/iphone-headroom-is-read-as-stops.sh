#!/bin/sh
# pyvips 3.2.0 with libvips 8.18.7 (libultrahdr in it): an iPhone's JPEG becomes far too bright, 8 times white turns into 256 times.
#
# Behaviour: the gain map of an iPhone's JPEG states in XMP by what factor white can be brighter, HDRGainMapHeadroom. Since iOS 17 this is
# the factor itself: of one photo, 3.847906, and its maker note gives 1.944 stops, which are the same. uhdrload takes the number
# for stops: of a map that states 8, "gainmap-max-content-boost" is 256 instead of 8.
# One would guess otherwise because Apple calls headroom a ratio of luminances, and the same loader is right for
# Google's and ISO's metadata, whose numbers are stops or their powers.
# Whom it hurts: converters that make HDR pictures of iPhone photos: lamps and skies are wrong by stops.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check pyvips==3.2.0 pyvips-binary==8.18.7 numpy==2.4.6
"$work/venv/bin/python" - "$work/iphone.jpg" > "$work/seen.txt" <<'PYTHON'
import struct
import sys

import numpy as np
import pyvips

TYPE = "urn:com:apple:photo:2020:aux:hdrgainmap"


def jpeg(value, bands, size, segments=b""):
    pixels = np.full((*size, bands), value, np.uint8)
    data = pyvips.Image.new_from_array(pixels).jpegsave_buffer(Q=95, keep=0)
    return data[:2] + segments + data[2:]


def segment(marker, content):
    return struct.pack(">BBH", 255, marker, len(content) + 2) + content


def made(headroom):
    packet = f"""<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description rdf:about="" xmlns:apdi="http://ns.apple.com/pixeldatainfo/1.0/"
 xmlns:HDRGainMap="http://ns.apple.com/HDRGainMap/1.0/"><apdi:AuxiliaryImageType>{TYPE}</apdi:AuxiliaryImageType>
<HDRGainMap:HDRGainMapVersion>131072</HDRGainMap:HDRGainMapVersion>
<HDRGainMap:HDRGainMapHeadroom>{headroom}</HDRGainMap:HDRGainMapHeadroom></rdf:Description></rdf:RDF></x:xmpmeta>"""
    gain_map = jpeg(255, 1, (32, 32), segment(0xE1, b"http://ns.adobe.com/xap/1.0/\0" + packet.encode()))
    length = len(jpeg(128, 3, (64, 64))) + 90
    entries = struct.pack(">IIIHH", 0x30000, length, 0, 0, 0) + struct.pack(">IIIHH", 0, len(gain_map), length - 10, 0, 0)
    tags = struct.pack(">HHI4sHHIIHHIII", 0xB000, 7, 4, b"0100", 0xB001, 4, 1, 2, 0xB002, 7, 32, 50, 0)
    listed = segment(0xE2, b"MPF\0MM\0*" + struct.pack(">IH", 8, 3) + tags + entries)
    base = jpeg(128, 3, (64, 64), listed)
    assert len(base) == length, (len(base), length)
    return base + gain_map


for headroom in (2, 8):
    photo = pyvips.Image.uhdrload_buffer(made(headroom))
    boost = photo.get("gainmap-max-content-boost")[0]
    print(f"states {headroom} times white, is read as {boost:.0f} times")
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> states 2 times white, is read as 4 times
#> states 8 times white, is read as 256 times
