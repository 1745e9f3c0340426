"""How often a clip's file is opened, and how many frames are decoded, until its result is written."""

import builtins
import io
import os

import av
import pytest

from support import clips
from unshutter.options.clip_options import RectifyClip, Shutter
from unshutter.video.clip_rectification import rectify_clip_file
from unshutter.video.file import containers

FRAMES = 30


@pytest.fixture
def counted(monkeypatch, tmp_path):
    """Rectifies a clip; returns the outcome, the number of times that its file was opened, and of frames decoded."""

    def rectified(greys, options):
        clip = clips.write(tmp_path / "in.mp4", greys, sound=True)
        opened, decoded = [], []

        def counting(function):
            def open_counted(file, *args, **kwargs):
                if isinstance(file, str | os.PathLike) and os.path.abspath(file) == str(clip):
                    opened.append(file)
                return function(file, *args, **kwargs)

            return open_counted

        def decode_counted(packet, place, decode=containers.decode_packet):
            frames = decode(packet, place)
            decoded.extend([None] * len(frames))
            return frames

        with monkeypatch.context() as patch:
            for module, name in ((builtins, "open"), (io, "open"), (av, "open")):
                patch.setattr(module, name, counting(getattr(module, name)))
            patch.setattr(containers, "decode_packet", decode_counted)
            outcome = rectify_clip_file(str(clip), str(tmp_path / "out.mp4"), options)
        return outcome, len(opened), len(decoded)

    return rectified


def test_a_plain_clip_is_opened_four_times_and_decoded_three_times(counted):
    """To be looked at, for tracks, for its motion, and to be written; two looks take a frame each."""
    options = RectifyClip(Shutter(focal_px=clips.FOCAL))
    outcome, opened, decoded = counted(clips.moving(FRAMES, clips.shaken(3.0))[1], options)
    assert outcome.rectified == FRAMES and 1 < opened <= 4 and FRAMES < decoded <= 3 * FRAMES + 2


def test_a_clip_that_is_left_is_decoded_once(counted):
    outcome, opened, decoded = counted(clips.standing(FRAMES), RectifyClip())
    assert outcome.rectified == 0 and outcome.frames == FRAMES and opened <= 3 and decoded == FRAMES + 1


def test_a_stated_readout_time_needs_no_parts_but_a_look_for_repeated_frames(counted):
    shutter = Shutter(readout_ratio=clips.RATIO, focal_px=clips.FOCAL)
    outcome, opened, decoded = counted(clips.moving(FRAMES)[1], RectifyClip(shutter))
    assert outcome.rectified == FRAMES and opened <= 4 and decoded == 3 * FRAMES + 2
