"""Bars round the picture of a clip: found in all forms in which editors make them, and left as they are."""

import json

import cv2
import numpy as np
import pytest

from support import clips
from support.covering import thorough
from unshutter.video.clip_functions import rectify_clip_frames
from unshutter.video.file.array_clip import ArrayClip

LETTERBOX, PILLARBOX, LOWER, ROUND = (24, 24, 0, 0), (0, 0, 30, 26), (0, 20, 0, 0), (16, 24, 20, 20)
ALL = clips.HEIGHT, clips.WIDTH


def boxed(frames, sides=LETTERBOX, level=16, soft=0):
    """Frames in bars: (rows above and below, columns to the left and right)."""
    return [_boxed(frame, sides, level, soft) for frame in frames]


def _boxed(frame, sides, level, soft):
    out = cv2.copyMakeBorder(frame, *sides, cv2.BORDER_CONSTANT, value=level)
    if soft:
        top, bottom, left, right = sides
        blurred = cv2.blur(out, (soft, soft))
        inner = out[top + soft : len(out) - bottom - soft, left + soft : out.shape[1] - right - soft].copy()
        out = blurred
        out[top + soft : len(out) - bottom - soft, left + soft : out.shape[1] - right - soft] = inner
    return out


def picture_of(frames):
    clip = ArrayClip.of(frames, 1 / 30)
    assert clip is not None
    return clip.picture


def within(sides):
    top, _, left, _ = sides
    return top, top + ALL[0], left, left + ALL[1]


@pytest.mark.parametrize("sides", [LETTERBOX, PILLARBOX, LOWER, ROUND])
@pytest.mark.parametrize("level", [16, thorough(0), thorough(60)])
def test_bars_are_found(sides, level):
    assert picture_of(boxed(clips.moving()[1], sides, level)) == within(sides)


def test_bars_may_have_noise_a_logo_and_soft_edges():
    rng = np.random.default_rng(0)
    frames = boxed(clips.moving()[1])
    for number, frame in enumerate(frames):
        frame[4:16, 8:60] = 200
        cv2.putText(frame, f"00:{number:02}", (60, 186), cv2.FONT_HERSHEY_SIMPLEX, 0.5, 235)
    noisy = [np.clip(frame + rng.normal(0, 0.7, frame.shape), 0, 255).astype(np.uint8) for frame in frames]
    assert picture_of(noisy) == within(LETTERBOX)
    inner = picture_of(boxed(clips.moving()[1], soft=4))
    assert inner is not None and 24 <= inner.top <= 28 and 164 <= inner.bottom <= 168


def test_what_is_only_dark_or_even_is_no_bar():
    frames = clips.moving()[1]
    assert picture_of(frames) is None
    assert picture_of([np.full_like(frames[0], 16)] * 9) is None
    row = np.arange(ALL[0])[:, None]
    skyline = 40 + (15 * np.sin(np.arange(ALL[1]) / 9)).astype(int)
    night = [np.where(row < skyline, 16, frame) for frame in frames]
    assert picture_of([each.astype(np.uint8) for each in night]) is None
    gradient = np.broadcast_to(np.minimum(60 + np.maximum(row - 30, 0), 200), ALL).astype(np.uint8)
    assert picture_of([gradient] * 9) is None
    assert picture_of([*boxed(frames[:8]), *[cv2.resize(each, (192, 192)) for each in frames[8:]]]) is None


@pytest.mark.parametrize("more", [{}, thorough({"edges": "fill"}), thorough({"stabilize": 0.5})])
def test_the_picture_is_straightened_as_without_bars_and_bars_stay(more):
    known = {"readout_ratio": clips.RATIO, "focal_px": clips.FOCAL}
    frames = clips.moving(24)[1]
    shown = boxed(frames, ROUND)
    alone = list(rectify_clip_frames(frames, **known, **more))
    top, bottom, left, right = within(ROUND)
    for before, after, without in zip(shown, rectify_clip_frames(shown, **known, **more), alone, strict=True):
        assert np.array_equal(after[top:bottom, left:right], without) and not np.array_equal(before, after)
        after[top:bottom, left:right] = before[top:bottom, left:right]
        assert np.array_equal(after, before)


@pytest.mark.parametrize("pixel_format", ["yuv420p", thorough("nv12"), thorough("yuv422p10le"), thorough("rgb24")])
def test_bars_of_a_file_stay_byte_for_byte(tmp_path, straighten, pixel_format):
    codec = "rawvideo" if pixel_format in ("nv12", "rgb24") else "ffv1"
    name = "in.mov" if pixel_format == "rgb24" else "in.mkv"
    clip = clips.write(tmp_path / name, boxed(clips.moving(24)[1]), codec, pixel_format)
    out, record, printed = straighten(clip, *clips.KNOWN)
    assert (
        record["picture"] == list(ALL) and "bars are left unchanged: the picture between them has 192x144 px" in printed
    )
    assert record["rectified"] == 24
    before, after = clips.luma(clip), clips.luma(out)
    assert np.array_equal(before[:, :24], after[:, :24]) and np.array_equal(before[:, -24:], after[:, -24:])
    assert not np.array_equal(before, after)


def test_a_motion_file_knows_the_picture(tmp_path, straighten):
    clip = clips.write(tmp_path / "in.mkv", boxed(clips.moving()[1], PILLARBOX), "ffv1", "gray")
    out, _, _ = straighten(clip, *clips.KNOWN, "--save-motion", tmp_path / "motion.json")
    first = out.read_bytes()
    out, _, _ = straighten(clip, "--motion", tmp_path / "motion.json")
    assert out.read_bytes() == first
    told = json.loads((tmp_path / "motion.json").read_text())["picture"]
    assert told == {"top": 0, "bottom": 144, "left": 30, "right": 222}


def test_with_depths_and_a_crop(tmp_path, straighten):
    clip = clips.write(tmp_path / "in.mkv", boxed(clips.moving(12)[1]), "ffv1", "gray")
    out, record, _ = straighten(clip, "--model", "dense", "--edges", "borrow", "--readout-ratio", "0.6")
    assert record["rectified_densely"] > 0
    before, after = clips.luma(clip), clips.luma(out)
    assert np.array_equal(before[:, :24], after[:, :24]) and np.array_equal(before[:, -24:], after[:, -24:])
    out, _, _ = straighten(clip, *clips.KNOWN, "--edges", "crop")
    height, width = clips.luma(out).shape[1:]
    assert height < ALL[0] and width < ALL[1] and clips.luma(out)[:, 0].mean() > 40  # no bar is left
