"""Clips converted to another frame rate by repeated or missing frames, and slow motion: the camera's clock is found."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from support import clips
from support.covering import thorough
from unshutter.cli import main
from unshutter.options.clip_options import RectifyClip, Shutter
from unshutter.video.calibrate.camera import find_camera
from unshutter.video.calibrate.repeated_frames import clock_in_frames
from unshutter.video.calibrate.sampled_frames import SampledFrames, TrackedFrame
from unshutter.video.clip_functions import rectify_clip_frames
from unshutter.video.file.array_clip import ArrayClip
from unshutter.video.file.camera_clock import CameraClock
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.measurement import measure_clips

SHAKEN = {"readout_ratio": clips.RATIO, "focal_px": clips.FOCAL}


def converted(frames, share):
    """The frames as a program shows them that repeats some, or leaves some out; each as an encoder changes it."""
    numbers = [int(k * share) for k in range(int(len(frames) / share))]
    noise = np.random.default_rng(0)
    return [np.clip(frames[k] + noise.integers(-1, 2, frames[k].shape), 0, 255).astype(np.uint8) for k in numbers]


def arrays(frames):
    clip = ArrayClip.of(frames, 1 / 30)
    assert clip is not None
    return clip


def clock_of(clip, **shutter):
    camera, _ = find_camera(ClipRequest.of(clip, RectifyClip(Shutter(**shutter))))
    return camera.clock


@pytest.mark.parametrize("share", ["4/5", thorough("5/6"), thorough("2/5"), thorough("1/2"), thorough("5/12")])
def test_repeated_frames_are_not_the_cameras(share):
    """24 frames a second shown at 30: the readout time is counted on the camera's clock, by its own frames."""
    share = Fraction(share)
    clip = arrays(converted(clips.moving(75)[1], share))
    camera, sampled = find_camera(ClipRequest.of(clip, RectifyClip()))
    assert camera.clock is not None and camera.clock.share == share
    assert sum(map(len, sampled.parts)) == pytest.approx(75, abs=2)
    right_s = clips.RATIO / 30 / float(share)
    assert abs(camera.readout_time.seconds - right_s) < 3 * camera.readout_time.error_s < 0.3 * right_s


@pytest.mark.parametrize("share", ["5/4", thorough("6/5")])
def test_missing_frames_took_their_time(share):
    """30 frames a second shown at 24: between some frames, the camera took another one."""
    share = Fraction(share)
    clip = replace(arrays(converted(clips.moving(110)[1], share)), interval_s=float(share) / 30)
    clock = clock_of(clip)
    assert clock is not None and clock.share == share
    assert clock.interval_s(clip.interval_s) == pytest.approx(1 / 30)


def test_frames_that_fill_gaps_are_no_conversion():
    """The camera took none where a frame is repeated now and then: the file's clock is right."""
    frames = clips.moving(75)[1]
    for at in (5, 9, 20, 31, 33, 50, 62):
        frames[at] = frames[at - 1]
    assert clock_of(arrays(frames)) is None
    assert clock_of(arrays(clips.moving(75)[1])) is None
    assert clock_of(arrays(clips.standing(75))) is None


def test_frames_that_fill_regular_gaps_are_no_conversion():
    """The picture moves on while every eighth frame is repeated: the camera took none in its place."""
    frames = clips.moving(75)[1]
    frames[7::8] = frames[6::8][: len(frames[7::8])]
    assert clock_of(arrays(frames)) is None
    assert clock_of(arrays(frames), **SHAKEN) is None  # few frames are followed


def test_the_pattern_may_begin_anywhere_after_each_cut():
    """An editor's clips begin anywhere, and each part has a pattern of its own."""
    parts = []
    for begin in range(3):
        changes = [0.01 if (k + begin) % 5 == 0 else 1.0 + 0.1 * k for k in range(40)]
        parts.append([TrackedFrame(0.0), *(TrackedFrame(k / 30, 1.0, changed_px=px) for k, px in enumerate(changes))])
    clock = clock_in_frames(arrays(clips.standing(3)), SampledFrames(parts))
    assert clock is not None and clock.share == Fraction(4, 5) and 0.02 < clock.same_px < 0.6


@pytest.mark.parametrize("more", [{}, thorough({"stabilize": 0.5}), thorough({"edges": "keep"})])
def test_repeats_are_straightened_like_the_frame_they_repeat(more):
    """Also where a readout time and focal length are stated, so that nothing needs to be examined."""
    frames = clips.moving(48)[1]
    shown = [frames[int(k * 0.8)] for k in range(60)]
    straight = list(rectify_clip_frames(shown, **SHAKEN, **more))
    repeats = [k for k in range(1, 60) if shown[k] is shown[k - 1]]
    assert len(repeats) > 10 and all(np.array_equal(straight[k], straight[k - 1]) for k in repeats)
    if "stabilize" in more:  # over seconds of the file
        return
    alone = list(rectify_clip_frames(frames, **SHAKEN, **more))
    own = [k for k in range(60) if k not in repeats]
    far = [float(np.abs(straight[k].astype(int) - alone[int(k * 0.8)]).mean()) for k in own]
    assert np.mean(far) < 1.5 < 0.3 * np.mean([np.abs(alone[k].astype(int) - frames[k]).mean() for k in range(48)])


def test_with_depths_repeats_are_linked_to_the_neighbours_of_the_frame_they_repeat(tmp_path, straighten):
    frames = clips.moving(24)[1]
    clip = clips.write(tmp_path / "in.mkv", [frames[k // 2] for k in range(48)], "ffv1", "gray")
    out, record, printed = straighten(clip, "--model", "dense", "--edges", "borrow", "--readout-ratio", "0.6")
    assert record["rectified"] == 48 and record["camera_fps"] == 15
    assert "15 of 30 frames a second are the camera's" in printed
    straight = clips.luma(out)
    assert np.array_equal(straight[::2], straight[1::2])


def test_slow_motion_is_measured_on_the_cameras_clock(tmp_path, capsys):
    """Android states the rate at which frames were taken."""
    frames = clips.moving(60)[1]
    tags = {"tags": {"com.android.capture.fps": "240.0"}, "container": {"movflags": "use_metadata_tags"}}
    as_taken = clips.write(tmp_path / "plain.mp4", frames, options={"crf": "10"})
    clip = clips.write(tmp_path / "slow.mp4", frames, options={"crf": "10"}, **tags)
    plain, slow = measure_clips([as_taken, clip])
    assert slow.clock == CameraClock(slowed=8.0) and plain.clock.is_files
    assert plain.readout_time is not None and slow.readout_time is not None
    assert slow.readout_time.ms == pytest.approx(plain.readout_time.ms / 8, rel=0.03)  # encoders with threads differ
    assert slow.as_json()["camera_fps"] == 240 and slow.as_json()["fps"] == 30
    assert main(["measure", str(clip)]) == 0
    assert "slow motion: the camera took 240 frames a second" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("stated", "slowed"), [("240", 8), ("30.0", 1), ("29.97", 1), ("44", 1), ("nan", 1), ("many", 1), ("1e9", 1)]
)
def test_a_rate_that_is_not_that_of_slow_motion(tmp_path, stated, slowed):
    """Phones state their highest rate, too, and take fewer frames where it is dark."""
    tags = {"tags": {"com.android.capture.fps": stated}, "container": {"movflags": "use_metadata_tags"}}
    clip = read_clip_facts(clips.write(tmp_path / "a.mp4", clips.standing(9), **tags))
    assert clip.clock == CameraClock(slowed=slowed)


def test_sony_states_the_rate_in_a_document(tmp_path):
    """In the metadata of the file, with the handler nrtm."""
    path = clips.write(tmp_path / "a.mp4", clips.standing(9))
    assert read_clip_facts(path).clock.is_files
    document = b'<NonRealTimeMeta><VideoFrame captureFps="119.88p" formatFps="29.97p"/></NonRealTimeMeta>'
    handler = (8 + 25).to_bytes(4, "big") + b"hdlr" + bytes(8) + b"nrtm" + bytes(13)
    xml = (12 + len(document)).to_bytes(4, "big") + b"xml " + bytes(4) + document
    meta = bytes(4) + handler + xml
    path.write_bytes(path.read_bytes() + (8 + len(meta)).to_bytes(4, "big") + b"meta" + meta)
    assert read_clip_facts(path).clock.slowed == pytest.approx(119.88 / 30)


def test_a_motion_file_states_the_cameras_interval(tmp_path, straighten):
    frames = clips.moving(40)[1]
    clip = clips.write(tmp_path / "in.mkv", [frames[k // 2] for k in range(80)], "ffv1", "gray")
    out, record, _ = straighten(clip, *clips.KNOWN, "--save-motion", tmp_path / "motion.json")
    first = out.read_bytes()
    again, by_file, _ = straighten(clip, "--motion", tmp_path / "motion.json")
    assert again.read_bytes() == first and record["rectified"] == 80
    assert by_file["readout_ms"] == pytest.approx(record["readout_ms"]) == 1000 * clips.RATIO / 15
