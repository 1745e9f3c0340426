"""Clips of several scenes: one that does not show the readout time of the clip is left unchanged."""

from dataclasses import replace

import numpy as np
import pytest

from support import clips
from unshutter.frames.self_calibration import Shot
from unshutter.frames.tracks import Tracks
from unshutter.options.clip_options import RectifyClip
from unshutter.readout_time import ReadoutRatio, ReadoutSource, ReadoutTime
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate.scene_check import SceneCheck
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.render.clip_motion import MovingFrame, with_motion

FOUND = ReadoutRatio(0.6, 0.02, ReadoutSource.REGRESSION)
CUT, LATER = 36, 40  # frames of the first scene, which is also the third, and of the second


@pytest.fixture(scope="module")
def edited(tmp_path_factory) -> ClipRequest:
    """Two scenes that were read row by row, and between them one of a camera that exposes all rows at once."""
    first = clips.moving(CUT)[1]
    second = [255 - grey for grey in clips.moving(LATER, ratio=0.0)[1]]
    path = clips.write(tmp_path_factory.mktemp("edited") / "edited.mkv", [*first, *second, *first], "ffv1")
    return ClipRequest.of(read_clip_facts(path), RectifyClip())


def moved(request: ClipRequest, source: ReadoutSource) -> list[MovingFrame]:
    time = replace(FOUND.seconds(request.clip.interval_s), source=source)
    request = replace(request, options=replace(request.options, shutter=replace(request.options.shutter, focal_px=165)))
    return list(with_motion(request, request.clip.frames_between(), time))


def test_a_scene_of_another_camera_is_left_as_it_is(edited):
    frames = moved(edited, ReadoutSource.REGRESSION)
    second = slice(CUT, CUT + LATER)
    assert [number for number, frame in enumerate(frames) if frame.cut] == [second.start, second.stop]
    assert all(not frame.motion.is_zero for frame in [*frames[:CUT], *frames[second.stop :]])
    assert all(frame.motion.is_zero for frame in frames[second])
    assert {frame.found.reason for frame in frames[second]} == {Reason(Code.SCENE_CONTRADICTS)}


def test_what_the_user_states_is_not_doubted(edited):
    assert all(not frame.motion.is_zero for frame in moved(edited, ReadoutSource.GIVEN))


def shot_of(ratio: float, pairs: int, scene: int = 0) -> Shot:
    """Tracks of a wall before which a camera is held by hand, row by row."""
    rng = np.random.default_rng(1)
    points = rng.uniform(0, [320, 180], (200, 2))
    waves = [(rng.uniform(0.1, 1.2), rng.uniform(0, 6, 2), rng.normal(0, 4, 2)) for _ in range(8)]

    def seen(frame: int) -> np.ndarray:
        at = frame + ratio * points[:, 1] / 180
        return points + sum(size * np.sin(often * at[:, None] + start) for often, start, size in waves)

    tracks = [Tracks(seen(k), seen(k + 1) + rng.normal(0, 0.05, points.shape), 180, 320, 200) for k in range(pairs)]
    return Shot(scene=scene, number=scene, pairs=tracks, times=[float(k) for k in range(pairs + 1)])


@pytest.mark.parametrize(("ratio", "is_left"), [(0.0, True), (0.15, True), (-0.6, True), (0.5, False), (0.9, False)])
def test_frames_are_left_where_less_than_half_of_it_is_there(ratio, is_left):
    reason = SceneCheck(0.6)(shot_of(ratio, 50))
    assert (reason is not None) is is_left


def test_few_frames_contradict_nothing():
    assert SceneCheck(0.6)(shot_of(0.0, 25)) is None


def test_each_scene_speaks_for_itself():
    check = SceneCheck(0.6)
    assert check(shot_of(0.6, 50)) is None
    assert check(shot_of(0.0, 50, scene=1)) is not None
    assert check(shot_of(0.6, 50, scene=2)) is None


@pytest.mark.parametrize("source", ReadoutSource)
def test_only_times_from_frames_are_asked_about(source):
    doubted = source in (ReadoutSource.FRAMES, ReadoutSource.REGRESSION, ReadoutSource.USUAL)
    assert (SceneCheck.of(ReadoutTime(0.02, source=source), 1 / 30) is not None) is doubted
