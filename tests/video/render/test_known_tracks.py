"""Corners that were followed to judge a clip are not followed again to render it."""

import numpy as np

from support import clips
from unshutter.cli import main
from unshutter.frames import self_calibration
from unshutter.frames.tracks import follow
from unshutter.options.clip_options import RectifyClip
from unshutter.video.calibrate import sampled_frames
from unshutter.video.calibrate.motion_estimation import grey_copies
from unshutter.video.calibrate.sampled_frames import sample_frames
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts

FRAMES = 40


def test_a_clip_that_was_judged_whole_is_followed_once(tmp_path, monkeypatch, capsys):
    count = []

    def counted(*pair):
        count.append(1)
        return follow(*pair)

    clip = clips.write(tmp_path / "in.mkv", clips.moving(FRAMES)[1], "ffv1")
    for module in (sampled_frames, self_calibration):
        monkeypatch.setattr(module, "follow", counted)
    assert main(["video", str(clip), "-o", str(tmp_path / "out.mkv"), "--focal-px", str(clips.FOCAL)]) == 0
    assert f"{FRAMES} of {FRAMES} frames straightened" in capsys.readouterr().err
    assert len(count) == FRAMES - 1


def test_tracks_that_are_known_are_those_of_the_copies(tmp_path):
    """Of parts, the frames between are copied, and each part's last frame, to which the next is followed."""
    clip = read_clip_facts(clips.write(tmp_path / "in.mkv", clips.moving(30)[1], "ffv1"))
    request = ClipRequest.of(clip, RectifyClip())
    sampled = sample_frames(request, [(0.2, 0.5), (0.7, 0.8)])
    known = list(grey_copies(request, clip.frames_between(), sampled))
    new = list(grey_copies(request, clip.frames_between()))
    assert 0 < sum(frame.followed is not None for frame in known) < len(known)
    greys = [frame.grey for frame in new]
    for k, frame in enumerate(known):
        if frame.followed is None:
            np.testing.assert_array_equal(frame.grey, greys[k])
            assert not k or known[k - 1].grey.size
        else:
            np.testing.assert_array_equal(frame.followed.end, follow(greys[k - 1], greys[k]).end)
