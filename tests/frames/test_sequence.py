"""Sequences of frames in, a motion for each out: close to the truth, or none where the frames do not say it."""

import tracemalloc

import numpy as np
import pytest

from support.covering import covering, thorough
from support.drawn_photos import one_line, textured
from support.hand_held import FOCAL, HEIGHT, WIDTH, clip, hand, pan, still
from unshutter import Photo, UsageError
from unshutter.frames.sequence import CameraMotion, estimate_frames
from unshutter.options import Clock
from unshutter.readout_time import ReadoutRatio
from unshutter.reasons import Code, Reason
from unshutter_lab.evaluation.metrics import motion_error


def errors(frames, moving, **options):
    findings = list(estimate_frames(frames, **options))
    assert len(findings) == moving.frames
    return [motion_error(found.motion, moving.motion(k)).epe for k, found in enumerate(findings)]


@pytest.mark.parametrize("ratio", [thorough(0.3), 0.9])
def test_motions_are_true_with_the_ratio_given(ratio):
    """Frames are solved for in windows: no frame stands out where two windows meet."""
    moving, frames = clip(hand(4), ratio, frames=50)
    errors_px = errors(frames, moving, readout_ratio=ratio, focal_px=FOCAL)
    assert np.mean(errors_px) < 0.15 and max(errors_px) < 0.5


def test_ratio_and_focal_length_are_found_where_they_are_not_given():
    moving, frames = clip(hand(4), 0.6, frames=45)
    camera = CameraMotion()
    motions = [frame.finding("middle").motion for frame in camera.frames(frames)]
    assert camera.ratio.value == pytest.approx(0.6, abs=0.04)
    assert {motion.reference for motion in motions} == {"middle"}
    truth = [moving.motion(k) for k in range(45)]
    errors_px = [motion_error(m.rereferenced("first"), t).epe for m, t in zip(motions, truth, strict=True)]
    assert np.mean(errors_px) < 0.3
    assert motions[20].focal_px == pytest.approx(FOCAL, rel=0.1)


def test_copies_take_the_motion_of_the_frame_that_they_repeat():
    """Programs put copies where frames are missing: the camera did not stand still meanwhile."""
    moving, frames = clip(hand(4), 0.6, frames=24)
    shown = [k - 1 if k % 8 == 7 else k for k in range(24)]
    findings = list(estimate_frames([frames[k] for k in shown], readout_ratio=0.6, focal_px=FOCAL))
    errors_px = [motion_error(found.motion, moving.motion(k)).epe for found, k in zip(findings, shown, strict=True)]
    assert np.mean(errors_px) < 0.15 and max(errors_px) < 0.5
    assert findings[7].motion == findings[6].motion


def test_a_camera_that_stops_takes_no_copies():
    """However alike its frames are then, they are later moments."""
    frames = clip(hand(4), 0.6, frames=12)[1]
    motions = list(CameraMotion(ReadoutRatio(0.6), FOCAL).frames(frames + frames[-1:] * 6))
    assert len(motions) == 18
    assert [motion.after for motion in motions[11:]] == [1, 0, 0, 3, 1, 1, 1]


def test_a_readout_along_columns():
    moving, frames = clip(hand(4), 0.9, frames=12)
    turned = [np.ascontiguousarray(np.rot90(frame)) for frame in frames]  # row 0 becomes the first column
    findings = list(estimate_frames(turned, readout_ratio=0.9, readout="left-to-right", focal_px=FOCAL))
    assert (findings[5].motion.height, findings[5].motion.width) == (HEIGHT, WIDTH)
    assert motion_error(findings[5].motion, moving.motion(5)).epe < 0.3


def test_a_still_camera_has_no_motion_with_and_without_a_ratio():
    _, frames = clip(still(), frames=8, noise=3)
    for options in ({}, {"readout_ratio": 0.8}):
        findings = list(estimate_frames(frames, **options))
        assert all(found.motion.is_zero and str(found.reason) == "the camera stood still" for found in findings)


def test_identical_frames_have_no_motion():
    frame = textured(HEIGHT, WIDTH)
    assert all(found.motion.is_zero for found in estimate_frames([frame] * 3, readout_ratio=1.0))


def test_people_before_a_still_camera_do_not_bend_it():
    _, frames = clip(still(), frames=20)
    person = textured(110, 90, bands=1)[::-1, ::-1, 0]
    for k, frame in enumerate(frames):
        frame[60:170, 20 + 6 * k : 110 + 6 * k] = person
    findings = list(estimate_frames(frames, readout_ratio=0.9))
    assert all(found.motion.is_zero for found in findings)
    assert {str(found.reason) for found in findings} == {str(Reason(Code.ONLY_OTHERS_MOVED))}


def test_a_steady_pan_is_undone_with_the_ratio_and_left_alone_without():
    moving, frames = clip(pan(), 0.8, frames=30)
    assert max(errors(frames, moving, readout_ratio=0.8, focal_px=FOCAL)) < 0.3
    findings = list(estimate_frames(frames[:20]))
    assert all(found.motion.is_zero and "readout ratio cannot be found" in str(found.reason) for found in findings)


def test_a_cut_parts_the_sequence():
    moving, frames = clip(pan(), 0.8, frames=6)
    elsewhere = textured(HEIGHT, WIDTH, bands=1)[::-1, :, 0]
    findings = list(estimate_frames([*frames[:3], elsewhere, *frames[3:]], readout_ratio=0.8, focal_px=FOCAL))
    assert findings[3].motion.is_zero and "another scene" in str(findings[3].reason)
    assert [found.motion.is_zero for found in findings] == [False] * 3 + [True] + [False] * 3
    assert motion_error(findings[1].motion, moving.motion(1)).epe < 0.2


def test_frames_of_another_size_part_the_sequence():
    _, frames = clip(pan(), 0.8, frames=3)
    small = textured(HEIGHT - 20, WIDTH, bands=1)[..., 0]
    findings = list(estimate_frames([*frames, small], readout_ratio=0.8))
    assert findings[3].motion.height == HEIGHT - 20 and "another size" in str(findings[3].reason)


@pytest.mark.parametrize(("photons", "size"), covering([2, 8, 30], [(HEIGHT, WIDTH), (360, 640)]))
def test_a_night_without_texture_is_left_alone(size, photons):
    rng = np.random.default_rng(photons)
    for _ in range(4):
        frames = [rng.poisson(photons, size).astype(np.uint8) for _ in range(3)]
        assert all(found.motion.is_zero and found.reason for found in estimate_frames(frames, readout_ratio=0.9))


def test_one_frame_alone_has_no_motion():
    (found,) = estimate_frames([textured(HEIGHT, WIDTH)], readout_ratio=0.5)
    assert found.motion.is_zero and "no frame before or after" in str(found.reason)
    assert list(estimate_frames([])) == []


def test_frames_may_be_paths_bytes_photos_or_deep_pixels(tmp_path):
    _, frames = clip(hand(4), 0.9, frames=4)
    Photo.from_array(frames[0]).save(tmp_path / "0.png")
    sources = [
        tmp_path / "0.png",
        Photo.from_array(frames[1]),
        Photo.from_array(frames[2]).to_bytes("png"),
        frames[3].astype(np.uint16) * 257,
    ]
    of_files = list(estimate_frames(sources, readout_ratio=0.9, focal_px=FOCAL))
    of_arrays = list(estimate_frames(frames, readout_ratio=0.9, focal_px=FOCAL))
    assert all(motion_error(a.motion, b.motion).epe < 0.05 for a, b in zip(of_files, of_arrays, strict=True))
    assert not of_arrays[2].motion.is_zero


def test_frames_are_not_kept():
    """Memory does not grow with the length of the sequence."""
    _, frames = clip(hand(4), 0.6, frames=30)

    def endless(count):
        for k in range(count):
            yield frames[k % 30 if k // 30 % 2 == 0 else 29 - k % 30].copy()

    def most_memory(count):
        tracemalloc.start()
        for _ in CameraMotion(Clock(0.6).stated_ratio, FOCAL).frames(endless(count)):
            pass
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    most_memory(5)
    assert most_memory(120) < 1.3 * most_memory(60)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"readout_ratio": 1.2}, "at most 1"),
        ({"readout_ratio": 0}, "above 0"),
        ({"readout_ratio": float("nan")}, "above 0"),
        ({"readout_ms": 20}, "give both readout_ms and fps"),
        ({"readout_ms": 20, "fps": 30, "readout_ratio": 0.5}, "not both"),
        ({"readout_ms": 50, "fps": 30}, "at most 1"),
        ({"focal_px": -1}, "focal_px must"),
        ({"reference": "second"}, "reference must be one of"),
    ],
)
def test_what_cannot_be_is_refused_at_once(options, says):
    with pytest.raises(UsageError, match=says) as error:
        estimate_frames([], **options)
    one_line(error)


def test_a_readout_time_and_a_frame_rate_make_a_ratio():
    assert Clock(readout_ms=20, fps=30).stated_ratio.value == pytest.approx(0.6)
    assert Clock().stated_ratio is None
