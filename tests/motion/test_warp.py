"""Pictures drawn by a motion, and the map that they are drawn with: against the exact inverse and plain NumPy."""

import math
import os

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from support.looking_back import backward_map
from support.shaken_scenes import drawn_scene, inside, shake
from support.stored import as_stored
from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import RowMotion, warp
from unshutter.motion import grid as sampling_map
from unshutter.motion.grid import SamplingGrid, gs_to_rs_map
from unshutter.motion.warp import distort_pixels, straighten, validity_mask, warp_plane
from unshutter.orientation import ScanDirection
from unshutter.storage import files
from unshutter_lab.synthesis.row_motions import draw_quadratic


def positions_by_motion(motion):
    """Exact RS positions of every pixel, stored frame, straight from Motion and Readout."""
    size = motion.scan_direction.frame_size(motion.height, motion.width)
    row, col = np.mgrid[: size[0], : size[1]].astype(float)
    frame = motion.gs_to_rs(*motion.scan_direction.points_to_frame(col, row, *size))
    return motion.scan_direction.points_to_stored(*frame, *size)


def bicubic(pixels, col, row, a=-0.75):
    """[H, W, C] at float positions, its border repeated; Keys's cubic convolution in plain NumPy, float."""
    pixels = np.pad(pixels.astype(float), ((4, 4), (4, 4), (0, 0)), mode="edge")
    height, width = pixels.shape[:2]
    col, row = np.clip(col, -2, width - 7) + 4, np.clip(row, -2, height - 7) + 4
    left, top = np.floor(col).astype(int), np.floor(row).astype(int)

    def weights(f):
        def near(d):
            return (a + 2) * d**3 - (a + 3) * d**2 + 1

        def far(d):
            return a * (d**3 - 5 * d**2 + 8 * d - 4)

        return far(1 + f), near(f), near(1 - f), far(2 - f)

    out = np.zeros(1)
    for i, wy in enumerate(weights(row - top)):
        for j, wx in enumerate(weights(col - left)):
            out = out + (wy * wx)[..., None] * pixels[top + i - 1, left + j - 1]
    return out


def bilinear(pixels, col, row):
    """[H, W, C] at float positions, 0 outside; plain NumPy, float."""
    height, width = pixels.shape[:2]
    within = inside(col, row, height, width)
    col, row = np.clip(col, 0, width - 1), np.clip(row, 0, height - 1)
    left, top = np.minimum(col.astype(int), width - 2), np.minimum(row.astype(int), height - 2)
    fx, fy = (col - left)[..., None], (row - top)[..., None]
    p = pixels.astype(float)
    upper = p[top, left] * (1 - fx) + p[top, left + 1] * fx
    lower = p[top + 1, left] * (1 - fx) + p[top + 1, left + 1] * fx
    return (upper * (1 - fy) + lower * fy) * within[..., None]


# ---- the map ----------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=25)
@given(
    height=st.integers(2, 200),
    width=st.integers(2, 200),
    readout=st.sampled_from(ScanDirection),
    tx=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)),
    rz=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
)
@example(
    height=129, width=65, readout=ScanDirection.LEFT_TO_RIGHT, tx=(0.1, 0.1), rz=(0.05, 0.05)
)  # nodes on the border
@example(height=83, width=2, readout=ScanDirection.RIGHT_TO_LEFT, tx=(0, 0.0625), rz=(0.046875, 0))  # cells across it
def test_map_and_mask_equal_the_exact_inverse_at_every_pixel(height, width, readout, tx, rz):
    rows, cols = readout.frame_size(height, width)
    if not 0.5 <= rows / cols <= 2:
        rows = cols
        height, width = readout.frame_size(rows, cols)
    motion = RowMotion.from_polynomials((0, *(t * rows for t in tx)), (0, *rz), rows, cols, scan_direction=readout)
    col, row = positions_by_motion(motion)
    found_col, found_row = backward_map(motion)
    mask = validity_mask(motion)
    assert found_col.shape == found_row.shape == mask.shape == (height, width)
    seen = inside(col, row, height, width)
    assert np.abs(found_col - col)[seen].max(initial=0) < 0.02
    assert np.abs(found_row - row)[seen].max(initial=0) < 0.02
    assert mask[inside(col, row, height, width, 0.0)].all()
    assert not mask[~inside(col, row, height, width, -0.03)].any()


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_map_of_a_large_picture(jitter):
    rng = np.random.default_rng(0)
    smooth = shake(1500, 2000)
    motion = RowMotion(2000, smooth.tx_px + rng.normal(0, jitter, 1500) if jitter else smooth.tx_px, smooth.rz_rad)
    found_col, found_row = backward_map(motion)
    at = rng.integers(0, (1500, 2000), (20000, 2))
    col, row = motion.gs_to_rs(at[:, 1], at[:, 0])
    seen = inside(col, row, 1500, 2000)
    assert np.abs(found_col[at[:, 0], at[:, 1]] - col)[seen].max() < 0.02
    assert np.abs(found_row[at[:, 0], at[:, 1]] - row)[seen].max() < 0.02


@pytest.mark.parametrize("readout", ScanDirection)
def test_a_smooth_motion_needs_few_nodes(readout):
    """That is what makes the map cheap; a kink at the border would refine the grid to every pixel."""
    motion = shake(*readout.frame_size(1500, 2000), share=0.5, scan_direction=readout)
    grid = SamplingGrid.of(gs_to_rs_map(motion), 1500, 2000)
    assert grid.row_step * grid.col_step >= 16 * 16


def test_a_motion_that_folds_the_picture_is_refused():
    rz = np.concatenate([np.zeros(50), np.full(50, 0.1)])
    with pytest.raises(UnshutterError, match="faster than rows are read"):
        backward_map(RowMotion(100, np.zeros(100), rz))


# ---- what is drawn ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("readout", ScanDirection)
def test_signs_on_a_drawn_bar(readout):
    """t_x > 0 moves what a row saw to the right; a distorted bar stands where t_x says, and upright again after."""
    frame = np.zeros((80, 100), dtype=np.uint8)
    frame[:, 30] = 200
    motion = RowMotion.from_polynomials([0, 20], [0, 0], 80, 100, scan_direction=readout)
    rs = distort_pixels(as_stored(frame, readout), motion)
    in_frame = readout.to_scan_frame(rs)
    middle = (in_frame * np.arange(100)).sum(1) / in_frame.sum(1)
    assert middle == pytest.approx(30 + motion.tx_px, abs=0.05)
    back = straighten(rs, motion)[0]
    again = readout.to_scan_frame(back)
    assert (again * np.arange(100.0)).sum(1) / again.sum(1) == pytest.approx(np.full(80, 30), abs=0.1)


def test_signs_on_a_turned_dot():
    """r_z > 0 turns the scene clockwise: what is right of the centre moves down."""
    gs = np.zeros((101, 101), dtype=np.uint8)
    gs[50, 80] = 250
    turned = RowMotion(101, np.zeros(101), np.full(101, np.radians(30)))
    rs = distort_pixels(gs, turned)
    row, col = np.unravel_index(rs.argmax(), rs.shape)
    assert (row, col) == (50 + round(30 * np.sin(np.radians(30))), 50 + round(30 * np.cos(np.radians(30))))


@pytest.mark.parametrize("seed", range(3))
def test_round_trip_is_within_half_a_decibel_of_the_interpolation_limit(seed):
    motion = draw_quadratic(np.random.default_rng(seed), 256, 356).crop
    gs = drawn_scene(256, 256, dtype=np.uint16, finest=10.0)
    rs = distort_pixels(gs, motion)
    found = straighten(rs, motion)[0]

    row, col = np.mgrid[:256, :256].astype(float)
    forward, backward = motion.rs_to_gs(col, row), motion.gs_to_rs(col, row)
    limit = bicubic(bilinear(gs, *forward), *backward)

    whole = inside(*forward, 256, 256).astype(float)[..., None]  # no black among the 16 pixels that are mixed
    usable = (bicubic(whole, *backward)[..., 0] > 1 - 1e-9) & inside(*backward, 256, 256, 2)
    assert usable.mean() > 0.4

    def psnr(a):
        return 10 * np.log10(65535**2 / np.mean((a.astype(float) - gs)[usable] ** 2))

    assert psnr(limit) > 40
    assert abs(psnr(found) - psnr(limit)) < 0.5
    assert psnr(rs) < psnr(found) - 15


@pytest.mark.parametrize("readout", ScanDirection)
@pytest.mark.parametrize("edges", ["keep", "crop", "fill"])
def test_readouts_give_the_same_picture_turned(readout, edges):
    frame = drawn_scene(120, 160, dtype=np.uint16)
    upright = straighten(frame, shake(120, 160), edges)[0]
    stored = straighten(as_stored(frame, readout), shake(120, 160, scan_direction=readout), edges)[0]
    if edges == "crop":  # of two equally good places the first is taken, and turning may change which
        assert readout.to_scan_frame(stored).shape == upright.shape
        return
    difference = np.abs(readout.to_scan_frame(stored).astype(int) - upright)
    if edges == "keep":  # on the very border rounding decides
        difference = difference[validity_mask(shake(120, 160))]
    assert difference.max() <= 257  # one grey level of 8 bits


@pytest.mark.parametrize("bands", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_no_displacement_gives_bit_identical_pixels(bands, dtype):
    pixels = np.random.default_rng(0).integers(0, np.iinfo(dtype).max + 1, (70, 90, bands)).astype(dtype)
    if bands in (2, 4):
        pixels[..., -1] = np.iinfo(dtype).max
    assert straighten(pixels, RowMotion.zero(70, 90))[0] is pixels
    assert distort_pixels(pixels, RowMotion.zero(70, 90)) is pixels
    barely = RowMotion(90, np.full(70, 1e-9), np.zeros(70))  # goes the whole way nevertheless
    for edges in ("keep", "crop", "fill"):
        np.testing.assert_array_equal(straighten(pixels, barely, edges)[0], pixels, strict=True)
    np.testing.assert_array_equal(distort_pixels(pixels, barely), pixels, strict=True)


def test_pixels_equal_an_independent_bicubic():
    gs = drawn_scene(200, 150, finest=8.0)
    motion = shake(200, 150)
    found = straighten(gs, motion)[0]
    expected = np.clip(bicubic(gs, *positions_by_motion(motion)), 0, 255)
    mask = validity_mask(motion)
    assert np.abs(found - expected)[mask].max() < 2.5  # OpenCV rounds positions to 1/32 px
    assert np.abs(found - expected)[mask].mean() < 0.5


# ---- transparency -----------------------------------------------------------------------------------------


def test_transparent_colours_do_not_bleed():
    pixels = np.full((40, 60, 4), 255, dtype=np.uint8)
    pixels[:, :30] = (50, 60, 70, 255)
    pixels[:, 30:, 3] = 0  # white, but transparent
    result = straighten(pixels, RowMotion(60, np.full(40, 3.5), np.zeros(40)), "keep")[0]
    seen = result[..., 3] > 0
    assert np.abs(result[seen][:, :3].astype(int) - (50, 60, 70)).max() <= 1
    assert 0 < result[20, 26, 3] < 255  # the edge is half covered: column 26 looks at 29.5


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("bands", [2, 4])
def test_half_transparent_colours_stay(dtype, bands):
    unit = 1 if dtype == np.uint8 else 257
    pixels = np.full((40, 60, bands), (77, 131, 200, 99)[-bands:], dtype) * dtype(unit)
    motion = RowMotion(60, np.linspace(0, 3.3, 40), np.zeros(40))
    result = straighten(pixels, motion, "fill")[0]
    assert result.dtype == dtype
    assert np.abs(result.astype(int) - pixels).max() <= unit // 257  # uint8: exact


# ---- large ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("edges", ["keep", "crop", "fill"])
def test_pictures_that_are_cut_up_come_out_the_same(edges, monkeypatch):
    """cv2.remap takes no more than 32767 px a side: beyond, tiles look at parts of the picture."""
    pixels, motion = drawn_scene(150, 260, 4), shake(150, 260)
    whole = straighten(pixels, motion, edges)[0]
    monkeypatch.setattr(sampling_map, "_TILE", (32, 80))
    monkeypatch.setattr(warp, "_LONGEST_SOURCE", 30)
    monkeypatch.setattr(files, "SPILL_BYTES", 1000)
    parts = straighten(pixels, motion, edges)[0]
    assert isinstance(parts, np.memmap)
    assert np.abs(whole.astype(int) - parts).max() <= 4  # float32 rounds positions otherwise, to 1/32 px in the end
    assert (whole != parts).mean() < 0.02


def test_threads_are_those_that_libvips_may_use(monkeypatch):
    pixels, motion = drawn_scene(300, 260), shake(300, 260)
    several = straighten(pixels, motion)[0]
    monkeypatch.setenv("VIPS_CONCURRENCY", "1")
    np.testing.assert_array_equal(straighten(pixels, motion)[0], several)
    assert warp.thread_count() == 1
    for odd in ("", "0", "many"):
        monkeypatch.setenv("VIPS_CONCURRENCY", odd)
        assert warp.thread_count() == min(os.cpu_count() or 1, 16)


def test_a_picture_wider_than_remap_takes():
    pixels = np.tile(np.arange(40_000) // 200 % 256, (64, 1)).astype(np.uint8)
    motion = RowMotion(40_000, np.linspace(0, 300, 64), np.zeros(64))
    rectified = straighten(pixels, motion, "fill")[0]
    for row, shift in ((0, 0), (63, 300)):
        looked_at = np.arange(40_000) + shift
        expected = pixels[row, np.where(looked_at > 39_999, 79_999 - looked_at, looked_at)]
        np.testing.assert_array_equal(rectified[row], expected)


# ---- small, wrong -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 50), (50, 1), (2, 3)])
def test_tiny_pictures(height, width):
    pixels = np.full((height, width), 90, np.uint8)
    motion = RowMotion(width, np.linspace(0, 0.3, height), np.linspace(0, 0.001, height), reference="first")
    motion = motion if height > 1 else RowMotion(width, np.array([0.3]), np.array([0.0]))
    for edges in ("keep", "fill"):
        result = straighten(pixels, motion, edges)[0]
        assert result.shape == (height, width)
    assert straighten(pixels, motion, "fill")[0].min() == 90
    assert validity_mask(motion).shape == (height, width)


def test_wrong_size_names_both_sizes():
    image = np.zeros((90, 120), np.uint8)
    for function in (straighten, distort_pixels):
        with pytest.raises(UnshutterError, match="200x100 px but this one has 120x90 px"):
            function(image, shake(100, 200))
    with pytest.raises(UnshutterError, match="90x120 px"):
        straighten(image, shake(90, 120, scan_direction=ScanDirection.LEFT_TO_RIGHT))[0]


def test_unknown_edges():
    with pytest.raises(UsageError, match="keep, crop or fill"):
        straighten(np.zeros((90, 120), np.uint8), shake(90, 120), "mirror")[0]


@pytest.mark.parametrize("subsampling", [(1, 1), (2, 2), (4, 1)])
@pytest.mark.parametrize(("beyond", "border"), [(1.0, 7), (None, 2), (math.inf, 0)])
def test_planes_of_any_resolution_move_with_their_frame(subsampling, beyond, border):
    across, down = subsampling
    plane = np.tile(np.arange(1000, 1000 + 64 // across, dtype=np.uint16), (48 // down, 1))
    grid = SamplingGrid.of_cells(lambda col, row: (col - 8.0, row), step=8, height=48, width=64)
    out = np.empty_like(plane)
    warp_plane(plane, grid, out, subsampling, beyond, black=7, limit=1023)
    shift = 8 // across
    np.testing.assert_array_equal(out[:, shift:], np.minimum(plane, 1023)[:, :-shift])
    first = {7: 7, 2: 1000 + shift - 1, 0: 1000}[border]  # black, mirrored, repeated
    assert (out[:, 0] == first).all()
