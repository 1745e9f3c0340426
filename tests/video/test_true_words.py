"""What is said of a clip is true: hardly moved, missing frames, cuts, and how far the search is."""

import numpy as np
import pytest

from support import clips
from support.hand_held import log_of, pan
from unshutter.frames.self_calibration import Shot
from unshutter.frames.tracks import Tracks, background
from unshutter.options.clip_options import RectifyClip, Shutter
from unshutter.progress import ClipObserver
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate.motion_estimation import grey_copies
from unshutter.video.clip_rectification import rectify_clip_file
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts


def test_a_camera_that_moves_gently_does_not_stand_still(tmp_path, straighten):
    gentle = log_of(lambda t: 0.9 * np.sin(6 * t), lambda t: 0 * t, lambda t: 0.7 * np.sin(8 * t))
    clip = clips.write(tmp_path / "in.mkv", clips.moving(30, gentle)[1], "ffv1", "gray")
    _, record, shown = straighten(clip, "--readout-ms", "5")
    assert [reason["code"] for reason in record["declined"]] == [Code.HARDLY_MOVED]
    assert "stood still" not in shown


def test_a_short_readout_is_not_a_camera_that_stands_still(tmp_path, straighten):
    """From frame to frame the camera moves by a pixel, while one is read out by a hundredth of that."""
    clip = clips.write(tmp_path / "in.mkv", clips.moving(30, pan(9.0))[1], "ffv1", "gray")
    _, record, _ = straighten(clip, "--readout-ratio", "0.01")
    assert [reason["code"] for reason in record["declined"]] == [Code.HARDLY_MOVED]


def test_the_readout_time_is_found_although_frames_are_missing(tmp_path, straighten):
    """Every seventh; the file says when the others are shown."""
    times = [k for k in range(50) if k % 7]
    greys = clips.moving(50)[1]
    clip = clips.write(tmp_path / "in.mkv", [greys[k] for k in times], "ffv1", "gray", times=[k / 30 for k in times])
    _, record, shown = straighten(clip, "--focal-px", str(clips.FOCAL))
    assert record["found_by"] == "motion" and record["readout_ms"] == pytest.approx(20, abs=1.6)
    assert 0 < record["readout_ratio_sd"] < 0.08 and "readout time" in shown


def test_the_time_since_a_frame_before_missing_ones_counts(tmp_path):
    times = [0, 1, 2, 4, 5]
    greys = [clips.moving(6)[1][k] for k in times]
    path = clips.write(tmp_path / "in.mkv", greys, "ffv1", "gray", times=[k / 30 for k in times])
    clip = read_clip_facts(path)
    copies = list(grey_copies(ClipRequest.of(clip, RectifyClip()), clip.frames_between()))
    assert [copy.after for copy in copies[1:]] == pytest.approx([1, 1, 2, 1], abs=0.02)


def test_missing_frames_are_not_called_a_shaking_camera(tmp_path, straighten):
    """Every seventh is missing, and the file does not say where."""
    clip = clips.write(tmp_path / "in.mkv", [g for k, g in enumerate(clips.moving(36)[1]) if k % 7], "ffv1", "gray")
    _, _, shown = straighten(clip, "--focal-px", str(clips.FOCAL))
    assert "does not show its readout time" not in shown or "or missing frames" in shown


def test_near_and_far_are_no_cut():
    """Nearly all corners are found again, but no motion of a camera explains them; across a cut, hardly any are."""
    rng = np.random.default_rng(0)
    start = rng.uniform((0, 0), (480, 270), (180, 2))
    apart = background(Tracks(start, start + rng.normal(0, 12, start.shape), 270, 480, 200))
    assert not apart.joined and not apart.cut
    few = start[:14]
    assert background(Tracks(few, few + rng.normal(0, 40, few.shape), 270, 480, 200)).cut
    shots = [Shot(Reason(code), number=3, scene=1).next_shot() for code in (Code.NO_COMMON_MOTION, Code.SCENES_DIFFER)]
    assert [(shot.number, shot.scene) for shot in shots] == [(4, 1), (4, 2)]


def test_the_search_reports_its_progress_frame_by_frame(tmp_path):
    steps, observer = [], ClipObserver()
    observer.note_progress = lambda *step: steps.append(step)
    clip = clips.write(tmp_path / "in.mkv", clips.moving(24)[1], "ffv1", "gray")
    rectify_clip_file(
        str(clip),
        str(tmp_path / "out.mkv"),
        RectifyClip(Shutter(focal_px=clips.FOCAL)),
        observer=observer,
    )
    search = [(done, total) for what, done, total in steps if what == "readout time"]
    assert search == [(k + 1, 24) for k in range(24)]
