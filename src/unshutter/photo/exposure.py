"""The time and duration of a photo's exposure, whether it was merged from several, and how long its readout took.

The readout time is estimated from the camera's make and model by one table, in which the first match wins. A camera
wrongly listed as having no rolling shutter is not rectified, so a leaf shutter is listed only if no other kind of that
name is known. If in doubt, the row with the wider range is right.

Source: CIPA DC-008 (EXIF 2.32): DateTimeOriginal, SubSecTimeOriginal, ExposureTime, ShutterSpeedValue, CustomRendered,
CompositeImage; the values that Apple adds to CustomRendered and its maker note's tag 0x000A are those that exiftool.org
lists (facts only). The table: general knowledge of cameras, unless a row names another source. A focal-plane shutter
takes about as long to cross the frame as the camera's fastest flash synchronisation lasts (1/125 to 1/250 s, according
to the makers' manuals).
"""

from __future__ import annotations

import re
import struct
from datetime import datetime
from fractions import Fraction

from unshutter.errors import shortened, visible
from unshutter.photo import exif, maker_notes
from unshutter.photo.directories import EXIF, Entry, Tree
from unshutter.readout_time import ReadoutSource, ReadoutTime

_ORIGINAL = 0x9003
_SUBSECONDS = 0x9291
_EXPOSURE_TIME = 0x829A
_SHUTTER_SPEED = 0x9201
_CUSTOM_RENDERED = 0xA401
_COMPOSITE = 0xA460
_SHORTEST_S, _LONGEST_S = 1e-6, 3600.0  # values beyond these are invalid
# HDR, HDR with the original kept, panorama, portrait HDR (Apple); 1, a maker-specific process, is Google's HDR
_MERGED_BY_CUSTOM_RENDERED = (1, 2, 3, 6, 7)
_MERGED_BY_COMPOSITE = (2, 3)  # a composite; one made while shooting
_APPLE_HDR = 0x000A
_IS_HDR = 3
_EXPOSURE_MODE = 0xA402
_BRACKET = 2
_LENS_MODEL = 0xA434
_FOCAL_35MM = 0xA405
_FISHEYE = re.compile(r"fish-?\s?eye", re.IGNORECASE)
_ACTION_CAMERA = re.compile(r"gopro|insta360|arashi vision|osmo ?action|sjcam|akaso", re.IGNORECASE)
# focal lengths, of 35 mm film
_LINEAR_MM = 20  # from here on, action cameras have straightened the lines
_WIDEST_STRAIGHT_MM = 10
_SETTINGS = 0x829D, 0x8827, 0x920A, 0x9206  # aperture, ISO, focal length, distance of the subject


def taken(blob: bytes | None) -> datetime | None:
    """Returns the time at which a photo was taken, from EXIF, in the camera's time zone; None if unknown."""
    tree = exif.read(blob)
    date = tree.text(_ORIGINAL, EXIF)
    fraction = tree.text(_SUBSECONDS, EXIF)
    try:
        time = datetime.strptime(date, "%Y:%m:%d %H:%M:%S")
    except ValueError:  # zeros or blanks, if the camera's clock was never set
        return None
    return time.replace(microsecond=int(fraction[:6].ljust(6, "0"))) if fraction.isdecimal() else time


def time_s(blob: bytes | None) -> float | None:
    """Returns the exposure time [s] in an EXIF blob; None if it is missing or implausible."""
    tree = exif.read(blob)
    time, speed = (next(iter(tree.numbers(tag, EXIF)), None) for tag in (_EXPOSURE_TIME, _SHUTTER_SPEED))
    if time is None and speed is not None and abs(speed) < 40:
        time = 2.0**-speed  # APEX
    return time if time is not None and _SHORTEST_S <= time <= _LONGEST_S else None


def blob_of(time_s: float) -> bytes | None:
    """Creates EXIF with only an exposure time [s]; returns None for a time that :func:`time_s` would reject."""
    if not _SHORTEST_S <= time_s <= _LONGEST_S:
        return None
    time = Fraction(time_s).limit_denominator(1_000_000)
    entry = Entry(5, 1, struct.pack("<II", time.numerator, time.denominator))
    return exif.of_tiff(Tree("<", [{EXIF: {_EXPOSURE_TIME: entry}}]))


def bends_lines(blob: bytes | None) -> bool:
    """Whether a photo was taken by an action camera or a fisheye, by their names, or wider than straight lenses are."""
    tree = exif.read(blob)
    name = f"{camera(blob)} {tree.text(_LENS_MODEL, EXIF)}"
    mm = tree.number(_FOCAL_35MM, EXIF) or 0
    by_action_camera = _ACTION_CAMERA.search(name) is not None and mm < _LINEAR_MM
    return by_action_camera or _FISHEYE.search(name) is not None or 0 < mm < _WIDEST_STRAIGHT_MM


def is_merged(blob: bytes | None) -> bool:
    """Whether a photo was merged from several exposures, of which its exposure time describes only one.

    Blur then says less about motion: each exposure may have been sharper, or moved more, than the whole.
    """
    tree = exif.read(blob)
    if tree.number(_CUSTOM_RENDERED, EXIF) in _MERGED_BY_CUSTOM_RENDERED:
        return True
    if tree.number(_COMPOSITE, EXIF) in _MERGED_BY_COMPOSITE:
        return True
    return maker_notes.apple(blob).numbers(_APPLE_HDR) == (_IS_HDR,)


def setting(blob: bytes | None) -> tuple[object, ...] | None:
    """Returns the camera and its setting, except for the exposure time; None for a photo of a bracket or a merged one.

    Settings that are not recorded are empty.
    """
    tree = exif.read(blob)
    if not tree or tree.number(_EXPOSURE_MODE, EXIF) == _BRACKET or is_merged(blob):
        return None
    return camera(blob), *(tree.numbers(tag, EXIF) for tag in _SETTINGS)


# ---- readout time --------------------------------------------------------------------------------------

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
