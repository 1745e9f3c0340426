"""The edges of a rectified picture, where nothing was seen: kept black, cropped or filled."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.looking_back import backward_map
from support.shaken_scenes import drawn_scene, inside, shake
from unshutter.errors import UnshutterError
from unshutter.motion import RowMotion
from unshutter.motion.grid import valid_window
from unshutter.motion.warp import edge_decision, rectify_pixels, straighten, validity_mask


def rectangle(mask: np.ndarray) -> tuple[int, int, int, int]:
    tile = valid_window(mask)
    return tile.left, tile.top, tile.right - tile.left, tile.bottom - tile.top


@pytest.mark.parametrize("bands", [1, 2, 3, 4])
def test_keep_is_black_and_transparent_a_pixel_beyond_what_the_photo_saw(bands):
    pixels = np.full((90, 120, bands), 200, dtype=np.uint8)
    motion = shake(90, 120)
    kept = rectify_pixels(pixels, motion, "keep")
    mask = validity_mask(motion)
    assert 0.5 < mask.mean() < 0.99
    assert (kept[mask] == 200).all()
    near, far = inside(*backward_map(motion), 90, 120, -0.98), inside(*backward_map(motion), 90, 120, -1.02)
    assert (kept[near] == 200).all()
    assert (kept[~far] == 0).all() and not far.all()
    assert (near & ~mask).any()


def test_less_than_a_pixel_leaves_no_black_hairline():
    pixels = np.full((90, 120, 3), 200, dtype=np.uint8)
    slight = RowMotion.from_polynomials([0, 0.9], [0], 90, 120)
    assert not validity_mask(slight).all()
    assert (rectify_pixels(pixels, slight, "keep") == 200).all()
    more = RowMotion.from_polynomials([0, 3.5], [0], 90, 120)
    assert (rectify_pixels(pixels, more, "keep") == 0).any()


def test_fill_mirrors_the_photo():
    pixels = drawn_scene(90, 120)
    motion = shake(90, 120)
    filled = rectify_pixels(pixels, motion, "fill").astype(int)
    kept = rectify_pixels(pixels, motion, "keep")
    mask = validity_mask(motion)
    assert np.array_equal(filled[mask], kept[mask])
    assert not np.array_equal(filled, kept)
    col, row = backward_map(motion)
    large = np.pad(pixels, ((90, 90), (120, 120), (0, 0)), mode="symmetric")
    expected = cv2.remap(large, col.astype(np.float32) + 120, row.astype(np.float32) + 90, cv2.INTER_CUBIC).astype(int)
    outside = ~inside(col, row, 90, 120, -2)
    assert outside.sum() > 100
    assert np.abs(filled - expected)[outside].max() <= 4  # float32 rounds positions otherwise


def test_fill_does_not_streak():
    """Far from the border a filled corner is as rich as the photo itself: no row of it repeats one pixel."""
    pixels = np.random.default_rng(0).integers(0, 256, (120, 160), np.uint8)
    motion = RowMotion.from_polynomials([0, 60], [0], 120, 160)
    filled = rectify_pixels(pixels, motion, "fill")
    kept = rectify_pixels(pixels, motion, "keep")
    corner = np.flatnonzero(kept[-1] == 0)
    assert corner.size > 50
    assert np.ptp(filled[-1][corner].astype(int)) > 100


def test_crop_keeps_the_aspect_and_only_valid_pixels():
    for height, width in ((90, 120), (150, 100), (77, 77)):
        motion = shake(height, width)
        cropped = rectify_pixels(np.full((height, width), 200, np.uint8), motion, "crop")
        assert (cropped == 200).all()
        rows, cols = cropped.shape[:2]
        assert abs(cols * height / width - rows) <= 1
        assert rows * cols > 0.5 * height * width
        seen = inside(*backward_map(motion), height, width, -1)
        left, top, w, h = rectangle(seen)
        assert (w, h) == (cols, rows)
        kept = rectify_pixels(drawn_scene(height, width), motion)[top : top + h, left : left + w]
        assert np.array_equal(rectify_pixels(drawn_scene(height, width), motion, "crop"), kept)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 10**6), height=st.integers(1, 12), width=st.integers(1, 12), holes=st.integers(0, 6))
def test_largest_rectangle_equals_brute_force(seed, height, width, holes):
    rng = np.random.default_rng(seed)
    mask = np.ones((height, width), dtype=bool)
    mask[rng.integers(0, height, holes), rng.integers(0, width, holes)] = False
    left, top, w, h = rectangle(mask)
    best = 0
    for long in range(1, max(height, width) + 1):
        if width >= height:
            size = long, max(round(long * height / width), 1)
        else:
            size = max(round(long * width / height), 1), long
        for y in range(height - size[1] + 1):
            for x in range(width - size[0] + 1):
                if mask[y : y + size[1], x : x + size[0]].all():
                    best = max(best, size[0] * size[1])
    assert w * h == best
    assert best == 0 or mask[top : top + h, left : left + w].all()


def test_largest_rectangle_of_a_large_mask_is_valid_and_hardly_smaller():
    row, col = np.mgrid[:1500, :2003]
    mask = (np.hypot(row - 700, col - 1100) < 600) & (col > 700)
    left, top, w, h = rectangle(mask)
    assert mask[top : top + h, left : left + w].all()
    assert w >= 4 * rectangle(mask[::4, ::4])[2] - 16


def test_crop_that_leaves_nothing_says_so():
    image = np.full((100, 100), 9, np.uint8)
    with pytest.raises(UnshutterError, match="9 % of the photo: use other edges, keep or fill"):
        rectify_pixels(image, RowMotion(100, np.full(100, 71.0), np.zeros(100)), "crop")
    with pytest.raises(UnshutterError, match="0 % of the photo"):
        rectify_pixels(image, RowMotion(100, np.full(100, 500.0), np.zeros(100)), "crop")


@pytest.mark.parametrize(("height", "width"), [(480, 640), (1500, 2000), (2003, 1501)])
def test_large_pictures_are_cropped_to_what_the_photo_saw(height: int, width: int):
    motion = shake(height, width)
    found = straighten(np.full((height, width), 200, np.uint8), motion, "crop")
    assert (found.pixels == 200).all()
    exact = rectangle(validity_mask(motion))
    assert found.pixels.shape[1] >= exact[2] - 8
    assert found.whole == pytest.approx(found.pixels.size / (height * width))


@pytest.mark.parametrize(("share", "edges"), [(0.3, "crop"), (2.5, "fill")])
def test_automatic_edges_crop_where_little_is_lost(share: float, edges: str):
    pixels, motion = drawn_scene(300, 400), shake(300, 400, share)
    found = straighten(pixels, motion, "auto")
    assert found.edges == edges
    assert found.whole is not None and (found.whole >= 0.8) == (edges == "crop")
    np.testing.assert_array_equal(found.pixels, rectify_pixels(pixels, motion, found.edges))


@pytest.mark.parametrize(("height", "width"), [(90, 120), (1001, 1503)])
def test_less_than_a_pixel_is_not_cropped_away(height: int, width: int):
    pixels = drawn_scene(height, width)
    found = straighten(pixels, RowMotion.from_polynomials([0, 0.9], [0], height, width), "auto")
    assert found.pixels.shape == pixels.shape and found.whole == 1


@pytest.mark.parametrize("edges", ["keep", "crop", "fill", "auto"])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_what_would_be_done_about_edges_is_what_is_done(edges, share):
    pixels, motion = drawn_scene(90, 120), shake(90, 120, share)
    frame, made = edge_decision(motion, edges), straighten(pixels, motion, edges)
    assert (frame.edges, frame.whole) == (made.edges, made.whole)
    assert (frame.window.bottom - frame.window.top, frame.window.right - frame.window.left) == made.pixels.shape[:2]
    if frame.edges == "crop":
        kept = rectify_pixels(pixels, motion, "fill")
        rows, cols = slice(frame.window.top, frame.window.bottom), slice(frame.window.left, frame.window.right)
        assert np.array_equal(kept[rows, cols], made.pixels)
