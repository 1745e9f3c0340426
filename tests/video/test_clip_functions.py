"""Clips from Python: a whole file with its progress, and frames of another decoder."""

from itertools import chain

import numpy as np
import pytest

import unshutter
from support import clips, hand_held
from support.hand_held import pan
from unshutter.errors import UnknownRatioError
from unshutter.motion.lens import Lens

CAMERA, GREYS = clips.moving(24)
TRUTH = np.stack(clips.truth(CAMERA)).astype(float)


def test_a_whole_clip(tmp_path, capfd):
    clip = clips.write(tmp_path / "in.mkv", GREYS, "ffv1", "gray")
    steps: list[tuple[str, int, int]] = []
    outcome = unshutter.rectify_clip(
        clip,
        tmp_path / "out.mkv",
        readout_ratio=0.6,
        focal_px=clips.FOCAL,
        edges="fill",
        save_motion=tmp_path / "motion.json",
        progress=lambda *step: steps.append(step),
    )
    assert isinstance(outcome, unshutter.ClipOutcome) and outcome.frames == outcome.rectified == 24
    assert (tmp_path / "motion.json").exists() and capfd.readouterr() == ("", "")
    assert steps == [("frames", k + 1, 24) for k in range(24)]
    assert clips.psnr(clips.luma(tmp_path / "out.mkv"), TRUTH) > clips.psnr(np.stack(GREYS).astype(float), TRUTH) + 5


def test_options_are_checked(tmp_path):
    for options, complaint in (({"crf": 80}, "between 0 and 63"), ({"edges": "borrow"}, "needs model dense")):
        with pytest.raises(unshutter.UsageError, match=complaint):
            unshutter.rectify_clip("in.mp4", tmp_path / "out.mp4", **options)


@pytest.mark.parametrize("kind", ["grey", "rgb", "16 bits"])
def test_frames_of_another_decoder(kind):
    frames = {
        "grey": GREYS,
        "rgb": [np.stack([grey, grey, 255 - grey], axis=-1) for grey in GREYS],
        "16 bits": [grey.astype(np.uint16) * 257 for grey in GREYS],
    }[kind]
    before = [frame.copy() for frame in frames]
    results = list(
        unshutter.rectify_clip_frames(iter(frames), readout_ms=20, fps=30, focal_px=clips.FOCAL, edges="fill")
    )
    assert [(each.shape, each.dtype) for each in results] == [(each.shape, each.dtype) for each in frames]
    assert all(np.array_equal(*pair) for pair in zip(frames, before, strict=True))
    grey = [
        {"grey": each, "rgb": each[..., 0] if each.ndim == 3 else each, "16 bits": each / 257}[kind] for each in results
    ]
    now = np.stack(grey).astype(float)
    assert clips.psnr(now, TRUTH) > clips.psnr(np.stack(GREYS).astype(float), TRUTH) + 5


def test_frames_come_while_others_are_still_to_be_decoded():
    taken = []

    def decoder():
        for k in range(200):
            taken.append(k)
            yield GREYS[k % 24 if k // 24 % 2 == 0 else 23 - k % 24]

    results = unshutter.rectify_clip_frames(decoder(), readout_ratio=0.6, focal_px=clips.FOCAL, edges="keep")
    next(results)
    assert len(taken) < 60


def test_a_lens_is_found_in_frames_as_it_is_in_files():
    """Seen through 140 degrees from corner to corner, at even angles."""
    focal = np.hypot(hand_held.HEIGHT, hand_held.WIDTH) / 2 / np.radians(70)
    lens = Lens(focal / hand_held.HEIGHT, (0.0, 0.0, 0.0, 0.0))
    camera = hand_held.camera(clips.shaken(), frames=30, lens=lens, focal_px=focal)
    frames = list(camera.rendered(clips.wall()))
    truth = np.stack(list(camera.rendered(clips.wall(), global_shutter=True))).astype(float)
    as_straight = list(unshutter.rectify_clip_frames(frames, readout_ratio=0.6, focal_px=focal))
    found = list(unshutter.rectify_clip_frames(iter(frames), readout_ratio=0.6))
    straight, bent = (clips.psnr(np.stack(each).astype(float), truth) for each in (as_straight, found))
    assert bent > straight + 3


def test_the_focal_length_counts():
    right, wrong = (
        np.stack(list(unshutter.rectify_clip_frames(GREYS, readout_ratio=0.6, focal_px=focal, edges="fill"))).astype(
            float
        )
        for focal in (clips.FOCAL, 20.0)
    )
    assert clips.psnr(right, TRUTH) > clips.psnr(wrong, TRUTH) + 1


@pytest.mark.parametrize(
    ("frames", "options", "error", "complaint"),
    [
        (None, {"readout_ratio": 0.5}, unshutter.UsageError, "a list, or another iterable"),
        ([None, *GREYS], {"readout_ratio": 0.5}, unshutter.UsageError, "uint8 or uint16"),
        (
            [np.zeros((900, 900), np.uint8)],
            {"readout_ratio": 0.5, "focal_px": 4.0},
            unshutter.UsageError,
            "^focal_px must",
        ),
        ([np.zeros((144, 192))], {"readout_ratio": 0.5}, unshutter.UsageError, "uint8 or uint16"),
        ([np.zeros((144, 192, 5), np.uint8)], {"readout_ratio": 0.5}, unshutter.UsageError, "1 to 4 bands"),
        ([GREYS[0], GREYS[0][1:]], {"readout_ratio": 0.5}, unshutter.UnshutterError, "the same size and type"),
        ([GREYS[0][:20]], {"readout_ratio": 0.5}, unshutter.UnshutterError, "192x20"),
        (GREYS, {"readout_ratio": 1.5}, unshutter.UsageError, "at most 1"),
        (GREYS, {"readout_ms": 20}, unshutter.UsageError, "give both"),
        (GREYS, {"readout_ratio": 0.5, "edges": "crop"}, unshutter.UsageError, "keep or fill"),
        (
            clips.moving(24, pan())[1],
            {"focal_px": clips.FOCAL},
            UnknownRatioError,
            "give readout_ratio, or readout_ms and fps",
        ),
    ],
)
def test_what_cannot_be_is_refused(frames, options, error, complaint):
    with pytest.raises(error, match=complaint):
        list(unshutter.rectify_clip_frames(frames, **options))


def test_no_frames_give_none():
    assert list(unshutter.rectify_clip_frames([], readout_ratio=0.5)) == []


# ---- as in a file ---------------------------------------------------------------------------------------------------


def of_file(folder, frames, **options):
    """Pixels of a clip whose file has the same frames, at exactly even times."""
    clip = clips.write(folder / "in.avi", frames, "ffv1", "gray")
    unshutter.rectify_clip(clip, folder / "out.avi", **options)
    return clips.luma(folder / "out.avi")


def of_arrays(frames, **options):
    return np.stack(list(unshutter.rectify_clip_frames(frames, **options)))


@pytest.mark.parametrize(
    "options", [{"stabilize": 1.0, "focal_px": clips.FOCAL}, {"strength": 0.5, "reference": "first"}]
)
def test_pixels_are_those_of_a_file(tmp_path, options):
    known = {"readout_ratio": 0.6, **options}
    expected = of_file(tmp_path, GREYS, **known)
    for frames in (GREYS, np.stack(GREYS)) if "stabilize" in options else (iter(GREYS),):
        assert np.array_equal(of_arrays(frames, **known), expected)
    assert not np.array_equal(expected, np.stack(GREYS))


def test_readout_time_and_direction_are_found_as_in_a_file(tmp_path):
    camera, frames = clips.moving(61, hand_held.hand(4, seconds=6.0))
    turned = [np.ascontiguousarray(np.rot90(frame)) for frame in frames]
    options = {"focal_px": clips.FOCAL, "edges": "fill"}
    found = of_arrays(iter(turned), **options)
    assert np.array_equal(found, of_file(tmp_path, turned, **options))
    truth = np.stack(clips.truth(camera)).astype(float)
    before, after = (clips.psnr(np.rot90(each, -1, axes=(1, 2)).astype(float), truth) for each in (turned, found))
    assert after > before + 5


def test_a_global_shutter_is_not_undone():
    for frames in (clips.moving(61, ratio=0.0)[1], iter(clips.moving(61, ratio=0.0)[1])):
        with pytest.raises(UnknownRatioError, match="at once"):
            list(unshutter.rectify_clip_frames(frames))


def test_a_camera_at_rest_needs_no_ratio():
    standing = clips.standing(40)
    for frames in (standing, iter(standing)):
        assert all(now is before for now, before in zip(unshutter.rectify_clip_frames(frames), standing, strict=True))
    with pytest.raises(UnknownRatioError):  # who knows what comes after the frames that are examined
        next(unshutter.rectify_clip_frames(chain(standing * 6, GREYS), focal_px=clips.FOCAL))


class Stream:
    """Cannot start again, like what reads from a pipe; ``again``: what the second pass yields nevertheless."""

    def __init__(self, frames, again=()):
        self._passes = [list(frames), list(again)]

    def __iter__(self):
        return iter(self._passes.pop(0))


def test_no_frame_is_lost_of_what_cannot_start_again():
    known = {"readout_ratio": 0.6, "focal_px": clips.FOCAL}
    assert np.array_equal(of_arrays(Stream(GREYS), **known), of_arrays(GREYS, **known))


@pytest.mark.parametrize(("again", "complaint"), [(GREYS[:20], "fewer frames"), (GREYS + GREYS[:1], "more frames")])
def test_a_second_pass_of_another_length(again, complaint):
    known = {"readout_ratio": 0.6, "focal_px": clips.FOCAL, "stabilize": 1.0}
    assert len(of_arrays(Stream(GREYS, GREYS), **known)) == 24
    with pytest.raises(unshutter.UsageError, match=complaint):
        of_arrays(Stream(GREYS, again), **known)
