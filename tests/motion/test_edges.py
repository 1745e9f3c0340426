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
from unshutter.motion.edges import valid_window
from unshutter.motion.warp import edge_decision, straighten, validity_mask


def rectangle(mask: np.ndarray, any_shape: bool = False) -> tuple[int, int, int, int]:
    tile = valid_window(mask, any_shape)
    return tile.left, tile.top, tile.right - tile.left, tile.bottom - tile.top


@pytest.mark.parametrize("bands", [1, 2, 3, 4])
def test_keep_is_black_and_transparent_a_pixel_beyond_what_the_photo_saw(bands):
    pixels = np.full((90, 120, bands), 200, dtype=np.uint8)
    motion = shake(90, 120)
    kept = straighten(pixels, motion, "keep")[0]
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
    assert (straighten(pixels, slight, "keep")[0] == 200).all()
    more = RowMotion.from_polynomials([0, 3.5], [0], 90, 120)
    assert (straighten(pixels, more, "keep")[0] == 0).any()


def test_fill_mirrors_the_photo():
    pixels = drawn_scene(90, 120)
    motion = shake(90, 120)
    filled = straighten(pixels, motion, "fill")[0].astype(int)
    kept = straighten(pixels, motion, "keep")[0]
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
    filled = straighten(pixels, motion, "fill")[0]
    kept = straighten(pixels, motion, "keep")[0]
    corner = np.flatnonzero(kept[-1] == 0)
    assert corner.size > 50
    assert np.ptp(filled[-1][corner].astype(int)) > 100


def test_crop_keeps_only_valid_pixels():
    for height, width in ((90, 120), (150, 100), (77, 77)):
        motion = shake(height, width)
        cropped = straighten(np.full((height, width), 200, np.uint8), motion, "crop")[0]
        assert (cropped == 200).all()
        rows, cols = cropped.shape[:2]
        assert rows * cols > 0.5 * height * width
        seen = inside(*backward_map(motion), height, width, -1)
        left, top, w, h = rectangle(seen, any_shape=True)
        assert (w, h) == (cols, rows)
        kept = straighten(drawn_scene(height, width), motion)[0][top : top + h, left : left + w]
        assert np.array_equal(straighten(drawn_scene(height, width), motion, "crop")[0], kept)


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


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 10**6), height=st.integers(1, 12), width=st.integers(1, 12), holes=st.integers(0, 6))
def test_the_crop_is_the_largest_of_any_shape_or_nearly_and_of_the_photos_shape(seed, height, width, holes):
    rng = np.random.default_rng(seed)
    mask = np.ones((height, width), dtype=bool)
    mask[rng.integers(0, height, holes), rng.integers(0, width, holes)] = False
    left, top, w, h = rectangle(mask, any_shape=True)
    best = max(
        (bottom - y) * (right - x) * mask[y:bottom, x:right].all()
        for y in range(height)
        for bottom in range(y + 1, height + 1)
        for x in range(width)
        for right in range(x + 1, width + 1)
    )
    assert mask[top : top + h, left : left + w].all()
    shaped = rectangle(mask)
    if best - shaped[2] * shaped[3] < 0.03 * height * width:
        assert (left, top, w, h) == shaped
    else:
        assert w * h == best


def test_a_leaning_photo_is_cropped_to_the_largest_rectangle_of_any_shape():
    """The demo's case: a shear takes a triangle of each side; the photo's own shape would lose its height as well."""
    lean = RowMotion.from_polynomials([0, 120], [0], 480, 640)
    pixels, found = straighten(drawn_scene(480, 640), lean, "auto")
    assert found.edges == "crop" and pixels.shape[:2] == (480, 640 - 119)  # a corner is a pixel outside
    shaped, _ = straighten(drawn_scene(480, 640), RowMotion.from_polynomials([0, 9], [0], 480, 640), "auto")
    height, width = shaped.shape[:2]  # here the photo's shape costs less than 3 % of the area
    assert width == 632 and height == round(632 * 480 / 640)


@pytest.mark.parametrize(("height", "width"), [(600, 800), (1500, 2000)])
def test_the_search_in_large_masks_finds_what_a_search_of_every_pixel_finds(height, width):
    """Against all pairs of rows of a mask whose rows are seen from one column to another."""
    row, col = np.mgrid[:height, :width]
    mask = (np.abs(col - width / 2 - 0.1 * row) < 0.41 * width - 0.0003 * (row - height / 3) ** 2) & (row > 11)
    first, last = mask.argmax(1), width - mask[:, ::-1].argmax(1)
    best = 0
    for top in range(12, height):
        wide = np.minimum.accumulate(last[top:]) - np.maximum.accumulate(first[top:])
        best = max(best, int((wide * np.arange(1, height - top + 1)).max()))
    left, top, w, h = rectangle(mask, any_shape=True)
    assert mask[top : top + h, left : left + w].all()
    assert w * h >= 0.999 * best or (w * h >= best - 0.03 * height * width and abs(w / h - width / height) < 0.01)


def test_largest_rectangle_of_a_large_mask_is_valid_and_hardly_smaller():
    row, col = np.mgrid[:1500, :2003]
    mask = (np.hypot(row - 700, col - 1100) < 600) & (col > 700)
    left, top, w, h = rectangle(mask)
    assert mask[top : top + h, left : left + w].all()
    assert w >= 4 * rectangle(mask[::4, ::4])[2] - 16


def test_crop_that_leaves_nothing_says_so():
    image = np.full((100, 100), 9, np.uint8)
    with pytest.raises(UnshutterError, match="9 % of the photo: use other edges, keep or fill"):
        straighten(image, RowMotion(100, np.full(100, 92.0), np.zeros(100)), "crop")[0]
    with pytest.raises(UnshutterError, match="0 % of the photo"):
        straighten(image, RowMotion(100, np.full(100, 500.0), np.zeros(100)), "crop")[0]


@pytest.mark.parametrize(("height", "width"), [(480, 640), (1500, 2000), (2003, 1501)])
def test_large_pictures_are_cropped_to_what_the_photo_saw(height: int, width: int):
    motion = shake(height, width)
    pixels, found = straighten(np.full((height, width), 200, np.uint8), motion, "crop")
    assert (pixels == 200).all()
    exact = rectangle(validity_mask(motion), any_shape=True)
    assert pixels.shape[1] >= exact[2] - 8
    assert found.area_left == pytest.approx(pixels.size / (height * width))


@pytest.mark.parametrize("share", [0.3, 5.0])
def test_automatic_edges_crop_however_much_is_lost(share: float):
    pixels, motion = drawn_scene(300, 400), shake(300, 400, share)
    cropped, found = straighten(pixels, motion, "auto")
    assert found.edges == "crop" and found.area_left is not None and (found.area_left < 0.8) == (share == 5.0)
    np.testing.assert_array_equal(cropped, straighten(pixels, motion, "crop")[0])


def test_where_a_crop_leaves_next_to_nothing_automatic_edges_keep_the_photo():
    pixels = drawn_scene(100, 100)
    motion = RowMotion(100, np.full(100, 95.0), np.zeros(100))
    kept, found = straighten(pixels, motion, "auto")
    assert found.edges == "keep" and found.area_left == pytest.approx(0.06, abs=0.011)
    np.testing.assert_array_equal(kept, straighten(pixels, motion, "keep")[0])


@pytest.mark.parametrize(("height", "width"), [(90, 120), (1001, 1503)])
def test_less_than_a_pixel_is_not_cropped_away(height: int, width: int):
    pixels = drawn_scene(height, width)
    cropped, found = straighten(pixels, RowMotion.from_polynomials([0, 0.9], [0], height, width), "auto")
    assert cropped.shape == pixels.shape and found.area_left == 1


@pytest.mark.parametrize("edges", ["keep", "crop", "fill", "auto"])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_what_would_be_done_about_edges_is_what_is_done(edges, share):
    pixels, motion = drawn_scene(90, 120), shake(90, 120, share)
    frame = edge_decision(motion, edges)
    made, decision = straighten(pixels, motion, edges)
    assert (frame.edges, frame.area_left) == (decision.edges, decision.area_left)
    assert (frame.window.bottom - frame.window.top, frame.window.right - frame.window.left) == made.shape[:2]
    if frame.edges == "crop":
        kept = straighten(pixels, motion, "fill")[0]
        rows, cols = slice(frame.window.top, frame.window.bottom), slice(frame.window.left, frame.window.right)
        assert np.array_equal(kept[rows, cols], made)
