"""Readout ratio and direction of drawn tracks, and of rendered clips, by regression."""

import numpy as np
import pytest

from support import clips
from support.hand_held import hand
from unshutter.frames.tracks import Tracks
from unshutter.motion.rotations import rotation_matrix
from unshutter.options.clip_options import RectifyClip
from unshutter.orientation import ScanDirection
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate.camera import find_camera
from unshutter.video.calibrate.readout_regression import PairMotion, regression, runs_of, spline_slopes
from unshutter.video.decision import why_unfit
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts

HEIGHT, WIDTH, PAIRS = 360, 640, 70


def path(at):
    """Position of the picture [px] at times [frames], smooth but never even."""
    across = 20 * np.sin(0.4 * at) + 7 * np.sin(1.1 * at + 1)
    down = 9 * np.sin(0.5 * at + 2) + 6 * np.sin(0.9 * at)
    return np.stack([across, down], axis=-1)


def pairs_of(ratio, columns=False, depth=0.0, noise=0.1, seed=0):
    """Pairs of frames of a picture that moves along the path; depth skews it as the speed says."""
    rng = np.random.default_rng(seed)
    for k in range(PAIRS):
        scene = rng.uniform([-60, -60], [WIDTH + 60, HEIGHT + 60], (300, 2))
        ends = []
        for frame in (k, k + 1):
            seen = scene
            for _ in range(20):  # the row in which a point appears tells when it was seen
                share = seen[:, 0] / WIDTH if columns else seen[:, 1] / HEIGHT
                seen = scene + path(frame + ratio * (share - 0.5))
            ends.append(seen + rng.normal(0, noise, seen.shape))
        speed = path(k + 1.0) - path(float(k))
        lower = (ends[0][:, 1] / HEIGHT - 0.5)[:, None]
        ends[1] = ends[1] + depth * speed * lower
        inside = (ends[0] > 0).all(axis=1) & (ends[0] < [WIDTH, HEIGHT]).all(axis=1)
        yield PairMotion.of([Tracks(ends[0][inside], ends[1][inside], HEIGHT, WIDTH, 300)])[0], 1.0


@pytest.mark.parametrize("ratio", [0.3, 0.9, -0.6])
def test_ratio_and_direction_of_drawn_tracks(ratio):
    found = regression(runs_of(pairs_of(ratio), HEIGHT / WIDTH))
    assert found is not None and found.is_sure and not found.is_none and not found.is_turned
    assert found.rows.ratio == pytest.approx(ratio, rel=0.08)


def test_the_focal_length_tells_how_much_faster_the_sides_move_than_the_middle():
    """Of a camera that rotates: without the focal length, the ratio is too large by as much."""
    focal, ratio, rng = 0.9 * HEIGHT, 0.6, np.random.default_rng(0)

    def seen(rays, at):
        turned = np.einsum("nij,nj->ni", rotation_matrix(np.stack([*(path(at) / focal / 4).T, 0 * at], axis=-1)), rays)
        return turned[:, :2] / turned[:, 2:] * focal + [WIDTH / 2, HEIGHT / 2]

    pairs = []
    for k in range(PAIRS):
        where = rng.uniform([-40, -40], [WIDTH + 40, HEIGHT + 40], (400, 2)) - [WIDTH / 2, HEIGHT / 2]
        rays = np.concatenate([where / focal, np.ones((400, 1))], axis=1)
        ends = []
        for frame in (k, k + 1):
            row = np.full(400, HEIGHT / 2)
            for _ in range(20):
                there = seen(rays, frame + ratio * (row / HEIGHT - 0.5))
                row = there[:, 1]
            ends.append(there + rng.normal(0, 0.05, there.shape))
        inside = (ends[0] > 0).all(axis=1) & (ends[0] < [WIDTH, HEIGHT]).all(axis=1)
        pairs.append(Tracks(ends[0][inside], ends[1][inside], HEIGHT, WIDTH, 400))
    motions = [PairMotion.of(pairs), PairMotion.of(pairs, focal / HEIGHT)]
    alone, known = (regression(runs_of([(each, 1.0) for each in some], HEIGHT / WIDTH)) for some in motions)
    assert alone is not None and known is not None
    assert alone.rows.ratio > 1.1 * ratio
    assert known.rows.ratio == pytest.approx(ratio, rel=0.04)


def test_depth_is_not_mistaken_for_a_rolling_shutter():
    found = regression(runs_of(pairs_of(0.0, depth=0.1), HEIGHT / WIDTH))
    assert found is not None and found.is_none and not found.is_sure
    found = regression(runs_of(pairs_of(0.5, depth=0.1), HEIGHT / WIDTH))
    assert found is not None and found.rows.ratio == pytest.approx(0.5, rel=0.08)


def test_a_picture_turned_by_90_degrees_shows_in_the_columns():
    found = regression(runs_of(pairs_of(0.6, columns=True), HEIGHT / WIDTH))
    assert found is not None and found.is_turned and not found.is_sure
    assert found.columns.ratio == pytest.approx(0.6, rel=0.1)


def test_repeated_frames_are_left_out():
    taken = list(pairs_of(0.5))
    nothing = PairMotion(np.zeros(2), np.zeros(2))
    repeated = [each for k, pair in enumerate(taken) for each in ([(nothing, 0.0), pair] if k % 7 == 3 else [pair])]
    found = regression(runs_of(repeated, HEIGHT / WIDTH))
    assert found is not None and found.rows.ratio == pytest.approx(0.5, rel=0.08)


def test_few_pairs_show_nothing():
    assert regression(runs_of(list(pairs_of(0.5))[:12], HEIGHT / WIDTH)) is None
    few = Tracks(np.zeros((5, 2)), np.ones((5, 2)), HEIGHT, WIDTH, 5)
    start = np.random.default_rng(1).uniform(0, [WIDTH, HEIGHT], (60, 2))
    many = Tracks(start, start + np.array([3.0, 1.0]), HEIGHT, WIDTH, 60)
    low = start * np.array([1.0, 0.3])
    strip = Tracks(low, low + 2.0, HEIGHT, WIDTH, 60)
    before, moved, narrow = PairMotion.of([few, many, strip])
    assert before is None and narrow is None
    np.testing.assert_allclose(moved.shift, [3.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(moved.shape, 0.0, atol=1e-6)


def test_slopes_of_a_spline_are_exact_for_cubics():
    times = np.array([0.0, 1.0, 2.5, 3.0, 4.0, 6.0])
    values = np.stack([times**3 - 2 * times, 5 - times**2], axis=1)
    assert spline_slopes(times, values) == pytest.approx(np.stack([3 * times**2 - 2, -2 * times], axis=1))


@pytest.mark.parametrize(
    ("upside_down", "readout"), [(False, ScanDirection.TOP_TO_BOTTOM), (True, ScanDirection.BOTTOM_TO_TOP)]
)
def test_a_clip_shows_its_readout_time_and_direction(tmp_path, upside_down, readout):
    greys = clips.moving(60, hand(4, seconds=6.0), ratio=0.6)[1]
    greys = [np.ascontiguousarray(np.rot90(grey, 2)) for grey in greys] if upside_down else greys
    clip = read_clip_facts(str(clips.write(tmp_path / "in.mkv", greys, "ffv1")))
    camera, _ = find_camera(ClipRequest.of(clip, RectifyClip()))
    assert (camera.scan_direction or ScanDirection.TOP_TO_BOTTOM) == readout
    assert camera.readout_time.seconds / clip.interval_s == pytest.approx(0.6, rel=0.1)


def test_a_global_shutter_is_reported(tmp_path):
    greys = clips.truth(clips.moving(60, hand(4, seconds=6.0), ratio=0.6)[0])
    clip = read_clip_facts(str(clips.write(tmp_path / "in.mkv", greys, "ffv1")))
    camera, _ = find_camera(ClipRequest.of(clip, RectifyClip()))
    assert why_unfit(camera) == Reason(Code.READ_AT_ONCE)
