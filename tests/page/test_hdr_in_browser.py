"""What a browser shows of results with gain maps on a screen that has the brightness for it."""

from base64 import b64decode, b64encode

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from support.browser import path_of_browser
from support.gain_maps import STOPS, hdr_photo, light_of
from unshutter import RowMotion, rectify

_FLAGS = ("--no-sandbox", "--force-color-profile=hdr10", "--enable-experimental-web-platform-features")
_DRAWN = """async ([address, stops]) => {
    const image = new Image();
    image.src = address;
    await image.decode();
    const canvas = new OffscreenCanvas(image.width, image.height);
    const drawing = canvas.getContext("2d", {colorType: "float16", colorSpace: "srgb"});
    if (drawing.globalHDRHeadroom === undefined) return null;
    drawing.globalHDRHeadroom = stops;
    drawing.drawImage(image, 0, 0);
    const form = {pixelFormat: "rgba-float16", colorSpace: "srgb-linear"};
    return new Uint8Array(drawing.getImageData(0, 0, image.width, image.height, form).data.buffer).toBase64();
}"""


def shown(page: Page, data: bytes, kind: str, stops: float) -> np.ndarray:
    """The light [H, W, 3] that a browser shows of a photo, on a screen so many stops brighter than white."""
    size = light_of(data).shape[:2]
    address = f"data:image/{kind};base64,{b64encode(data).decode()}"
    pixels = page.evaluate(_DRAWN, [address, stops])
    if pixels is None:
        pytest.skip("this browser does not tell what it shows on a bright screen")
    return np.frombuffer(b64decode(pixels), np.float16).reshape(*size, 4)[..., :3].astype(float)


def test_a_browser_shows_the_light_of_results(chromium: Browser) -> None:
    """Chromium reads gain maps by libraries of its own: Skia for JPEG, libavif for AVIF."""
    motion = RowMotion.from_polynomials([0, 16, 5], [0, 0.03], 240, 320)
    result = rectify(hdr_photo(iso=b""), motion=motion, edges="crop")
    bright = chromium.browser_type.launch(executable_path=path_of_browser(), args=_FLAGS)
    try:
        page = bright.new_page()
        for kind in ("jpeg", "avif"):
            data = result.encode(kind).data
            light = light_of(data)
            off = np.log2((shown(page, data, kind, STOPS) + 0.01) / (light + 0.01))
            assert light.max() > 6 and np.abs(off).mean() < 0.01 and np.abs(off).max() < 0.1
            assert shown(page, data, kind, 0).max() <= 1.01  # a usual screen shows SDR
    finally:
        bright.close()
