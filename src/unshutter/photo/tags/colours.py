"""Colours that files give by numbers (code points) instead of an ICC profile.

Source: ISO/IEC 23091-2 (colour code points).
"""

from __future__ import annotations

from unshutter.errors import UnshutterError
from unshutter.photo.libvips import libvips

# sRGB and "unspecified", Display P3; transfers that are shown alike: Rec. 709, unspecified, Rec. 601, sRGB.
_SRGB, _P3, _USUAL_TRANSFERS = (1, 2), 12, (1, 2, 6, 13)


def profile_of(primaries: int, transfer: int, source: object) -> bytes | None:
    """ICC profile of such colours; None where they are sRGB or unspecified.

    Args:
        primaries: code point.
        transfer: code point.
        source: for the message.

    Raises:
        UnshutterError: those of HDR or video: pixels that look right only with these numbers, which are lost.
    """
    if transfer in _USUAL_TRANSFERS:
        if primaries in _SRGB:
            return None
        if primaries == _P3:
            return libvips().Image.profile_load("p3")
    raise UnshutterError(
        f"{{photo}} has colours of HDR or video (code points {primaries}/{transfer}): convert it first", photo=source
    )
