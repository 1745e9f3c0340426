"""A first look at a long clip: what leaves it, and that the liveliest part is among what is looked at."""

import numpy as np
import pytest

from support import clips
from unshutter import rectify_clip
from unshutter.reasons import Code
from unshutter.video.calibrate import first_look, sampled_frames
from unshutter.video.file.clip_facts import read_clip_facts

SHORT_GROUPS = {"crf": "16", "g": "15"}


@pytest.fixture
def followed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Counts pairs of frames whose corners are tracked as a clip is looked at."""
    calls: list[int] = []
    real = sampled_frames.follow
    monkeypatch.setattr(sampled_frames, "follow", lambda *given: calls.append(1) or real(*given))
    return calls


def test_a_long_clip_that_shows_nothing_is_left_after_a_first_look(tmp_path, followed):
    still = clips.standing(1) * 300
    at_once = clips.moving(244, clips.shaken(9), ratio=0.0)[1]
    for name, greys, code in (("still", still, Code.NOTHING_TO_SEE), ("global", at_once, Code.READ_AT_ONCE)):
        clip = clips.write(tmp_path / f"{name}.mp4", greys, options=SHORT_GROUPS)
        followed.clear()
        outcome = rectify_clip(clip, tmp_path / f"{name}.out.mp4")
        assert [each["code"] for each in outcome.as_json()["declined"]] == [code]
        assert outcome.frames == len(greys) and outcome.rectified == 0 and "camera_fps" not in outcome.as_json()
        assert len(followed) <= first_look.SERIES * first_look.FRAMES
        assert (tmp_path / f"{name}.out.mp4").read_bytes() == clip.read_bytes()


def test_the_part_in_which_most_moves_is_found_by_the_sizes_of_packets(tmp_path):
    greys = clips.standing(1) * 150 + clips.moving(40)[1] + clips.standing(1) * 150
    for name in ("index.mp4", "none.mkv"):
        packets = read_clip_facts(clips.write(tmp_path / name, greys, options=SHORT_GROUPS)).packets()
        assert packets is not None
        liveliest = packets.liveliest(0.0, 11.0, 40)
        assert liveliest is not None
        assert liveliest == pytest.approx(150 / clips.FPS, abs=0.2)
        assert packets.key_before(liveliest) <= liveliest < packets.key_before(liveliest) + 15 / clips.FPS + 1e-6
        assert packets.liveliest(0.0, 2.0, 40) is None
        assert packets.frames == (len(greys) if name == "index.mp4" else None)


def test_a_clip_that_moves_once_is_not_left_after_a_first_look(tmp_path, followed):
    greys = clips.standing(1) * 110 + clips.moving(45)[1] + clips.standing(1) * 110
    clip = clips.write(tmp_path / "once.mp4", greys, options=SHORT_GROUPS)
    outcome = rectify_clip(clip, tmp_path / "out.mp4", focal_px=clips.FOCAL)
    assert len(followed) > first_look.SERIES * first_look.FRAMES
    assert outcome.rectified > 30


def test_of_a_file_that_is_cut_off_the_frames_are_not_counted(tmp_path):
    clip = clips.write(tmp_path / "in.mp4", clips.standing(1) * 30, container={"movflags": "faststart"})
    facts = read_clip_facts(clip)
    for cut, frames in ((0, 30), (20, None)):
        clip.write_bytes(clip.read_bytes()[: clip.stat().st_size - cut])
        packets = facts.packets()
        assert packets is not None and packets.frames == frames
        assert np.all(np.diff(packets.times_s) > 0)
