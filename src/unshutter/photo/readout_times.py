"""Readout times of photos by the camera's make and model, from one table, in which the first match wins.

A camera wrongly listed as having no rolling shutter is not rectified, so a leaf shutter is listed only if no other kind
of that name is known. If in doubt, the row with the wider range is right.

Source: general knowledge of cameras, unless a row names another source. A focal-plane shutter takes about as long to
cross the frame as the camera's fastest flash synchronisation lasts (1/125 to 1/250 s, by the makers' manuals).
"""

from __future__ import annotations

import re

from unshutter.errors import shortened, visible
from unshutter.photo import exif
from unshutter.readout_time import ReadoutSource, ReadoutTime

_MAKE = 0x010F
_MODEL = 0x0110
# usual time for photos of a kind of camera or shutter, and the longest that such a camera may take
LEAF = ReadoutTime.of_ms(0, ReadoutSource.LEAF)
FOCAL_PLANE = ReadoutTime.of_ms(4, ReadoutSource.FOCAL_PLANE, plausible_ms=(0, 10))
PHONE = ReadoutTime.of_ms(20, ReadoutSource.PHONE, plausible_ms=(0, 50))
DRONE = ReadoutTime.of_ms(30, ReadoutSource.DRONE, plausible_ms=(0, 100))
EITHER = ReadoutTime.of_ms(10, ReadoutSource.EITHER, plausible_ms=(0, 300))
ELECTRONIC = ReadoutTime.of_ms(50, ReadoutSource.ELECTRONIC, plausible_ms=(0, 300))
UNKNOWN = ReadoutTime.of_ms(50, ReadoutSource.UNKNOWN, plausible_ms=(0, 300))

# (makes, model): beginnings of the make, and a pattern for the start of the model, both in lower case
_TABLE: tuple[tuple[str, str, ReadoutTime], ...] = (
    # DSLRs whose live view has an electronic shutter
    ("nikon", r"nikon d(4s?|5|6|780|850)$", EITHER),
    ("canon", r"canon eos(-| )(1d ?x mark iii|90d|850d|rebel t8i|kiss x10i)", EITHER),
    ("pentax|ricoh|asahi", r"pentax (kp|kf|k-1|k-1 mark ii|k-70|k-3 mark iii.*)$", EITHER),
    # DSLRs, which read out behind a focal-plane shutter
    ("canon", r"canon eos[- ](?!m\d|m\b|r(?!ebel)|c\d|kiss m|v)", FOCAL_PLANE),
    ("nikon", r"nikon d\d", FOCAL_PLANE),
    ("pentax|ricoh|asahi", r"pentax (\*ist|k\d{2,3}d?$|k-([357x]|5 ii.*|3 ii|30|50|500|m|r|s[12])$)", FOCAL_PLANE),
    ("sony", r"(dslr|slt)-a", FOCAL_PLANE),
    ("minolta|konica minolta", r"(dynax|maxxum|alpha) ", FOCAL_PLANE),
    ("olympus", r"e-([135]|[3-6]\d\d)$", FOCAL_PLANE),
    ("fujifilm", r"finepix ?s[1235] ?pro", FOCAL_PLANE),
    ("sigma", r"sigma sd\d+", FOCAL_PLANE),
    ("panasonic", r"dmc-l(1|10)$", FOCAL_PLANE),
    ("leica", r"(leica )?m[89]\b", FOCAL_PLANE),
    # CCDs, which expose all lines at once, and fixed lenses with a leaf shutter and no electronic one
    ("canon", r"canon powershot (a\d|e1$|g([1-9]|1[0-2])$|pro1$|s[1-5] is$|s\d\d$|sd(?!4[05]00)\d)", LEAF),
    ("canon", r"canon powershot sx(1[0-3]0|2[01]0|[123]0) ", LEAF),
    ("canon", r"canon digital ixus (?!.*hs)", LEAF),
    ("nikon", r"e\d{3,4}$|coolpix (l\d{1,2}|s\d|s10|p[1-6]|p5[01]00|p6000|p7[01]00|p[89]0)$", LEAF),
    ("olympus", r"c-?\d|e-[12]0|fe-?\d|[uµ]-?(mini|d?\d{3})|x-?\d{3}|sp-?5\d\duz|s760", LEAF),
    ("sony", r"dsc-([fpsuvw]\d|t\d{1,3}$|h[1-9]$|h[1-9]0$|n[12]$|m[12]$|l1$)", LEAF),
    ("panasonic", r"dmc-(lc\d|lz\d|ls\d|fx\d{1,2}$|fz([1-9]|1[058]|2[08]|30|35|38|50)$|tz([1-7]|10)$|lx[1235]$)", LEAF),
    ("fujifilm", r"finepix ?([ae]\d{3}|f(10|11|20|30|31|40|50|100|200)(?!\d)|m603|s[2-5]\d{3}|s7000)", LEAF),
    ("fujifilm", r"finepix ?(z[1-9]\d{0,2}(fd)?$|\d{4})", LEAF),
    ("eastman kodak|kodak", r"kodak (easyshare )?(dc\d|dx\d|cx\d|ls\d|v\d{3}|p[78]\d0)", LEAF),
    ("minolta|konica", r"dimage (?!rd)", LEAF),
    ("casio", r"qv-\d|ex-(z\d|s\d|p\d)", LEAF),
    ("hewlett-packard", r"hp photosmart (c[5-9]\d\d|r\d{3})", LEAF),
    ("pentax|asahi", r"pentax optio (?!wg|vs|rz)", LEAF),
    ("ricoh", r"caplio|gr digital", LEAF),
    ("sigma", r"(sigma )?dp\d", LEAF),
    ("fujifilm", r"(finepix x100|x100s)$", LEAF),
    ("hasselblad", r"hasselblad h[2-5]d", LEAF),
    # Only an electronic shutter
    ("sigma", r"sigma fp", ELECTRONIC),
    # Drones and action cameras
    ("hasselblad", r"l[123]d", DRONE),
    ("dji|gopro|parrot|autel|skydio|yuneec|insta360|sensefly", r"", DRONE),
    # Phones and tablets
    ("apple", r"ip(hone|ad|od)", PHONE),
    ("google|huawei|honor|xiaomi|redmi|oneplus|oppo|vivo|realme|htc|motorola|nokia|hmd|zte|fairphone", r"", PHONE),
    ("lge|lg electronics|lg mobile|blackberry|research in motion|rim|microsoft|nothing|lenovo|asus|palm", r"", PHONE),
    ("samsung", r"(sm|gt|sch|sgh|sph|shv|sc)-|galaxy", PHONE),
    ("sony", r"xq-|so-|sov|sgp|[cdefghij]\d{4}|lt\d|st\d|mt\d|xperia", PHONE),
    ("sony ericsson|sonyericsson", r"", PHONE),
    # Mirrorless cameras and compacts with CMOS sensors: a mechanical shutter, an electronic one, or both
    ("canon|nikon|sony|panasonic|olympus|om digital|fujifilm|leica|pentax|ricoh|sigma|hasselblad|samsung", r"", EITHER),
)


def camera(blob: bytes | None) -> str:
    """Returns make and model of the camera named in an EXIF blob; empty if none is named."""
    tree = exif.read(blob)
    return " ".join(filter(None, (tree.text(_MAKE), tree.text(_MODEL))))


def camera_in_words(blob: bytes | None) -> str:
    """Returns the camera named in an EXIF blob for a sentence: ``a Canon PowerShot A70``."""
    tree = exif.read(blob)
    make = tree.text(_MAKE)
    model = tree.text(_MODEL)
    named = model if model.partition(" ")[0].lower() in make.lower() else f"{make.partition(' ')[0]} {model}"
    return visible(shortened(f"{'an' if named[:1] in 'AEIOaeio' else 'a'} {named}"))


def readout_time(blob: bytes | None) -> ReadoutTime:
    """Returns the readout time of the camera named in an EXIF blob; that of an unknown camera if none is named."""
    tree = exif.read(blob)
    return readout_time_of(tree.text(_MAKE), tree.text(_MODEL))


def readout_time_of(make: str, model: str) -> ReadoutTime:
    """Returns the readout time of a camera from EXIF's make and model."""
    make = make.strip().lower()
    model = model.strip().lower()
    rows = (row for row in _TABLE if make.startswith(tuple(row[0].split("|"))))
    return next((time for _, pattern, time in rows if re.match(pattern, model)), UNKNOWN)
