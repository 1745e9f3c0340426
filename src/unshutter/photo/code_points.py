"""Colours stated as code points that no profile replaces: HDR (PQ, HLG) and the wide primaries of video.

Pixels stay code values: these are perceptual, so they are interpolated as they are. What states them is carried: the
chunks cICP, mDCV and cLLI of PNG, and the box colr of AVIF and HEIC with those of light levels next to it.

Source: ITU-T H.273 (code points), ITU-R BT.2100 (PQ, HLG), BT.2408 (203 cd/m² for white), W3C, PNG third edition,
ISO/IEC 14496-12 and 23008-12 (clli, mdcv, cclv, amve, ndwt).
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from unshutter.errors import UnshutterError
from unshutter.photo.libvips import libvips

if TYPE_CHECKING:
    import numpy as np
    import pyvips

_UNSPECIFIED = 2
_P3 = 12
_PQ, _HLG = HDR_TRANSFERS = 16, 18
_SDR = (1, 2, 6, 13, 14, 15)  # transfer functions displayed alike: those of sRGB and of SDR video
# x and y of red, green and blue, by primaries; white is D65
_PRIMARIES = {
    1: ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06)),
    9: ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)),
    _P3: ((0.68, 0.32), (0.265, 0.69), (0.15, 0.06)),
}
_WHITE = 0.3127, 0.3290
_WHITE_NITS = 203.0  # luminance of diffuse white [cd/m²]
_HLG_NITS = 1000.0  # peak of the display on which HLG is shown [cd/m²]
_LIGHT = frozenset({b"clli", b"mdcv", b"cclv", b"amve", b"ndwt"})  # boxes next to colr: light levels, displays
_RGB, _GBR = (0, 1, 2), (2, 0, 1)  # order of primaries in the chunk mDCV; where the box mdcv has them


@dataclass(frozen=True)
class CodePoints:
    """Primaries and transfer function of a picture's colours (ITU-T H.273), and light levels as boxes."""

    primaries: int
    transfer: int
    light: tuple[tuple[bytes, bytes], ...] = ()  # (name, content) of boxes

    @property
    def is_hdr(self) -> bool:
        """Whether highlights can be brighter than white."""
        return self.transfer in (_PQ, _HLG)

    @property
    def title(self) -> str:
        """The kind of colours, for sentences."""
        return {_PQ: "HDR colours (PQ)", _HLG: "HDR colours (HLG)"}.get(self.transfer, "colours of video (BT.2020)")

    def chunks(self) -> tuple[tuple[bytes, bytes], ...]:
        """Returns the chunks of a PNG that state the same."""
        light = dict(self.light)
        chunks = [(b"cICP", bytes([self.primaries, self.transfer, 0, 1]))]
        if len(mastering := light.get(b"mdcv", b"")) == 24:
            chunks.append((b"mDCV", _reordered(mastering, _GBR)))
        if len(levels := light.get(b"clli", b"")) == 4:
            chunks.append((b"cLLI", struct.pack(">II", *(10_000 * each for each in struct.unpack(">HH", levels)))))
        return tuple(chunks)

    def boxes(self, matrix: int) -> tuple[tuple[bytes, bytes], ...]:
        """Returns the boxes of a picture in AVIF, coded by matrix coefficients with full range."""
        return (b"colr", b"nclx" + struct.pack(">HHHB", self.primaries, self.transfer, matrix, 0x80)), *self.light


def light_in_boxes(boxes: Iterable[tuple[bytes, bytes]]) -> tuple[tuple[bytes, bytes], ...]:
    """Returns the boxes with light levels among a picture's properties."""
    return tuple((name, content) for name, content in boxes if name in _LIGHT)


def light_in_chunks(chunks: Mapping[bytes, bytes]) -> tuple[tuple[bytes, bytes], ...]:
    """Returns the light levels in a PNG's chunks as boxes."""
    light = []
    if len(levels := chunks.get(b"cLLI", b"")) == 8:  # in 0.0001 cd/m²
        nits = (min(round(each / 10_000), 0xFFFF) for each in struct.unpack(">II", levels))
        light.append((b"clli", struct.pack(">HH", *nits)))
    if len(mastering := chunks.get(b"mDCV", b"")) == 24:
        light.append((b"mdcv", _reordered(mastering, (1, 2, 0))))
    return tuple(light)


def _reordered(mastering: bytes, order: tuple[int, int, int]) -> bytes:
    """Returns a mastering display whose primaries are in another order."""
    return b"".join(mastering[4 * at : 4 * at + 4] for at in order) + mastering[12:]


def colours(
    primaries: int, transfer: int, light: tuple[tuple[bytes, bytes], ...], source: object
) -> tuple[bytes | None, CodePoints | None]:
    """Returns an ICC profile for colours given as code points, or these if there is none; neither for sRGB.

    Raises:
        UnshutterError: the colours are unknown.
    """
    if transfer in _SDR and primaries in (1, _UNSPECIFIED):
        return None, None
    if transfer in _SDR and primaries == _P3:
        return libvips().Image.profile_load("p3"), None
    if transfer in (*_SDR, _PQ, _HLG) and primaries in (*_PRIMARIES, _UNSPECIFIED):
        return None, CodePoints(primaries, transfer, light)
    raise UnshutterError(
        f"{{photo}} has unusual colours (code points {primaries}/{transfer}): convert it first", photo=source
    )


# ---- copies in SDR -------------------------------------------------------------------------------------

_SHOULDER = 0.5  # relative luminance from which highlights are compressed


def for_screen(image: pyvips.Image, code_points: CodePoints) -> pyvips.Image:
    """Converts an image of 1 or 3 bands to sRGB of 8 bits.

    White of 203 cd/m² becomes 0.82 of the screen's light: up to half of it nothing is changed, above that, brighter
    light approaches the screen's white. Colours keep their hue; those outside sRGB are clipped.
    """
    image = image.maplut(libvips().Image.new_from_array(_light(code_points.transfer, str(image.format))[None]))
    if image.bands == 3:
        image = image.recomb(libvips().Image.new_from_array(_to_srgb(code_points.primaries)))
        if code_points.transfer == _HLG:  # the display's brightness follows the luminance of the scene
            luminance = image.recomb(libvips().Image.new_from_array([[0.2126, 0.7152, 0.0722]]))
            image *= (luminance > 0).ifthenelse(luminance, 1e-9) ** 0.2
    elif code_points.transfer == _HLG:
        image = image**1.2
    if code_points.transfer == _HLG:
        image *= _HLG_NITS / _WHITE_NITS
    if code_points.is_hdr:
        peak = image if image.bands == 1 else _greatest(image)
        above = (peak - _SHOULDER) / (1 - _SHOULDER)
        shown = 1 - (1 - _SHOULDER) * (above * -1).exp()
        image *= (peak > _SHOULDER).ifthenelse(shown / peak, 1)
    if image.bands == 1:
        image = image.bandjoin([image, image])
    return image.copy(interpretation="scrgb").colourspace("srgb")


def grey_table(code_points: CodePoints, format: str) -> pyvips.Image:
    """Returns a table from code values to grey levels of 8 bits, in the contrast of SDR pictures, for estimates."""
    import numpy as np

    light = _light(code_points.transfer, format)
    if code_points.transfer == _HLG:
        light = light**1.2 * (_HLG_NITS / _WHITE_NITS)
    if code_points.is_hdr:
        shown = 1 - (1 - _SHOULDER) * np.exp(-(light - _SHOULDER) / (1 - _SHOULDER))
        light = np.where(light > _SHOULDER, shown, light)
    levels = np.where(light > 0.0031308, 1.055 * light ** (1 / 2.4) - 0.055, 12.92 * light)
    return libvips().Image.new_from_array(np.rint(255 * levels.clip(0, 1)).astype(np.uint8)[None])


def _greatest(image: pyvips.Image) -> pyvips.Image:
    """Returns the greatest of three bands."""
    red, green, blue = image.bandsplit()
    greater = (red > green).ifthenelse(red, green)
    return (greater > blue).ifthenelse(greater, blue)


@cache
def _light(transfer: int, format: str) -> np.ndarray:
    """Returns the light of each code value as float32, relative to white; of HLG, that of the scene, up to 1."""
    import numpy as np

    code = np.linspace(0, 1, 256 if format == "uchar" else 65_536)
    if transfer == _PQ:
        root = code ** (1 / 78.84375)
        light = (np.maximum(root - 0.8359375, 0) / (18.8515625 - 18.6875 * root)) ** (1 / 0.1593017578125)
        light *= 10_000 / _WHITE_NITS
    elif transfer == _HLG:
        a, b, c = 0.17883277, 0.28466892, 0.55991073
        light = np.where(code <= 0.5, code**2 / 3, (np.exp((code - c) / a) + b) / 12)
    else:
        light = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    return light.astype(np.float32)


def _to_srgb(primaries: int) -> np.ndarray:
    """Returns the matrix [3, 3] from linear colours to those of sRGB."""
    import numpy as np

    own = _PRIMARIES.get(primaries, _PRIMARIES[9])
    return np.linalg.inv(_to_xyz(_PRIMARIES[1])) @ _to_xyz(own)


def _to_xyz(primaries: tuple[tuple[float, float], ...]) -> np.ndarray:
    import numpy as np

    columns = np.array([[x / y, 1, (1 - x - y) / y] for x, y in (*primaries, _WHITE)]).T
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3])
