"""WebP: lossless files stay so."""

import numpy as np
import pytest

from support.drawn_photos import encoded, textured
from support.tagged_files import (
    SRGB,
)
from unshutter.photo import Photo


@pytest.mark.parametrize("lossless", [False, True])
@pytest.mark.parametrize("extended", [False, True])  # with an ICC profile the coding is behind other chunks
def test_lossless_webp_stays_lossless(lossless, extended):
    more = {"icc_profile": SRGB + bytes(1 - len(SRGB) % 2)} if extended else {}  # of odd length: padded
    photo = Photo.from_bytes(encoded(textured(48, 80), "WEBP", lossless=lossless, **more))
    changed = photo.with_pixels(~photo.pixels)
    assert np.array_equal(Photo.from_bytes(changed.to_bytes()).to_array(), changed.to_array()) == lossless
    assert not np.array_equal(Photo.from_bytes(changed.to_bytes(quality=50)).to_array(), changed.to_array())
