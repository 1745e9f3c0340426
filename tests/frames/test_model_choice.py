"""Which of both models a frame gets: the camera's where everything moves with it, the dense one where it does not."""

import json

import numpy as np
import pytest

import unshutter
from support.drawn_photos import textured
from support.frame_pairs import Scene, off
from support.hand_held import FOCAL, HEIGHT, WIDTH, clip, hand, still
from unshutter.cli import main
from unshutter.frames.flow import Flow
from unshutter.frames.model_choice import camera_misses, flow_misses
from unshutter.frames.sequence import CameraMotion
from unshutter.frames.tracks import follow
from unshutter.options import Clock
from unshutter.photo import Photo
from unshutter_lab.evaluation.metrics import motion_error

PARALLAX = Scene(speed=(16, 2), board_speed=(9, 0))
SHIFT = np.array([3.0, 1.0])


def saved(frames, folder):
    paths = [folder / f"{k}.png" for k in range(len(frames))]
    for path, frame in zip(paths, frames, strict=True):
        Photo.from_array(frame).save(path)
    return paths


def between(frames, **options):
    """What becomes of the middle one of three frames."""
    photos = [Photo.from_array(frame) for frame in frames]
    return list(unshutter.rectify_frames(photos, **options))[1]


def test_a_turning_camera_is_described_as_one():
    moving, frames = clip(hand(4), 0.9, frames=3, noise=1)
    result = between(frames, readout_ratio=0.9, focal_px=FOCAL)
    assert result.model == "camera"
    assert motion_error(result.motion, moving.motion(1)).epe < 0.3


def test_near_and_far_are_dense():
    frames = [PARALLAX.frame(k, 0.9) for k in range(3)]
    result = between(frames, readout_ratio=0.9)
    assert result.model == "dense" and result.motion is None
    forced = between(frames, readout_ratio=0.9, model="camera")
    truth, board = PARALLAX.at(1), np.s_[40:110, 100:150]
    assert forced.model == "camera"
    assert off(result.pixels[board], truth[board]) < 0.8 * off(frames[1][board], truth[board])


def test_a_black_frame_says_nothing_of_its_neighbours():
    _, frames = clip(hand(4), 0.9, frames=4, noise=1)
    results = list(unshutter.rectify_frames([np.zeros_like(frames[0]), *frames], readout_ratio=0.9, focal_px=FOCAL))
    assert [result.changed for result in results] == [False, True, True, True, True]


@pytest.mark.parametrize(("option", "model"), [({"at": 0.2}, "dense"), ({"edges": "borrow"}, "dense")])
def test_what_only_one_of_them_can_do_is_done_by_it(option, model):
    _, frames = clip(hand(4), 0.9, frames=3, noise=1)
    assert between(frames, readout_ratio=0.9, focal_px=FOCAL, **option).model == model


def test_half_the_strength_is_half_the_motion():
    _, frames = clip(hand(4), 0.9, frames=3, noise=1)
    options = {"readout_ratio": 0.9, "focal_px": FOCAL, "model": "camera"}
    whole, half = between(frames, **options).motion, between(frames, strength=0.5, **options).motion
    np.testing.assert_allclose(half.rotations, whole.rotations / 2, atol=1e-4)


def test_errors_of_both_are_in_pixels_of_256_rows():
    picture = textured(HEIGHT + 20, WIDTH + 20, bands=1)[..., 0]
    first, second = picture[10:-10, 10:-10], picture[9:-11, 7:-13]  # everything moves by SHIFT
    tracks = follow(np.ascontiguousarray(first), np.ascontiguousarray(second))
    wrong = np.broadcast_to((SHIFT + np.array([2, 0])).astype(np.float32), (HEIGHT, WIDTH, 2))
    assert flow_misses(Flow(wrong, -wrong, np.eye(3), 1.0), tracks) == pytest.approx(2 * 256 / HEIGHT, abs=0.1)
    camera = next(CameraMotion(Clock(0.5).stated_ratio, 20 * FOCAL).frames([first.copy(), second.copy()]))
    assert camera_misses(camera, tracks, 0) < 0.15
    assert camera_misses(camera, tracks.only(np.zeros(len(tracks), bool)), 0) == np.inf


def test_line_and_log_say_which(tmp_path, capsys):
    frames = saved([PARALLAX.frame(k, 0.9) for k in range(2)], tmp_path)
    words = ["rectify", str(frames[0]), "--after", str(frames[1]), "--readout-ratio", "0.9", "-o"]
    assert main([*words, str(tmp_path / "out.png"), "--json-log", str(tmp_path / "log")]) == 0
    assert "model dense" in capsys.readouterr().err
    events = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]
    assert events[0]["model"] == "dense"


# ---- do no harm: nothing moves by more than 0.3 px, or there is a clear line --------------------------------------


def test_people_before_a_still_camera_do_not_bend():
    _, frames = clip(still(), frames=3, noise=2)
    person = textured(110, 90, bands=1)[::-1, ::-1, 0]
    for k, frame in enumerate(frames):
        frame[60:170, 20 + 6 * k : 110 + 6 * k] = person
    result = between(frames, readout_ratio=0.9)
    assert not result.changed and result.reason == "the camera stood still"
    np.testing.assert_array_equal(result.pixels[..., 0], frames[1])


@pytest.mark.parametrize("ratio", [None, 0.9])
def test_a_still_camera_and_identical_frames_stay(ratio):
    frame = textured(HEIGHT, WIDTH)
    for frames in ([frame] * 3, clip(still(), frames=3, noise=3)[1]):
        result = between(frames, readout_ratio=ratio)
        np.testing.assert_array_equal(result.pixels.reshape(frames[1].shape), frames[1])


@pytest.fixture
def cut(tmp_path):
    """Two photos of different places."""
    frame = clip(hand(4), frames=1)[1][0]
    return saved([frame, np.ascontiguousarray(textured(HEIGHT, WIDTH, bands=1)[::-1, :, 0])], tmp_path)


def test_a_cut_is_a_clear_line_or_with_fallback_one_photo_alone(cut, tmp_path, capsys):
    words = ["rectify", str(cut[0]), "--after", str(cut[1]), "--readout-ratio", "0.9", "-o", str(tmp_path / "out.png")]
    assert main(words) == 1
    error = capsys.readouterr().err
    assert "too little in common" in error and error.count("\n") == 1
    assert not (tmp_path / "out.png").exists()
    alone = ["--fallback", "--estimator", "none", "--json-log", str(tmp_path / "log")]
    assert main([*words, *alone]) == 0
    assert json.loads((tmp_path / "log").read_text().splitlines()[0])["model"] == "alone"
    assert (tmp_path / "out.png").read_bytes() == cut[0].read_bytes()


@pytest.mark.parametrize("seed", range(12))
def test_night_without_texture_is_a_clear_line_or_stays(seed):
    rng = np.random.default_rng(seed)
    frames = [rng.poisson(2, (HEIGHT, WIDTH)).astype(np.uint8) for _ in range(3)]
    try:
        result = between(frames, readout_ratio=0.9)
    except unshutter.UnshutterError as error:
        assert "too little in common" in str(error)
    else:
        np.testing.assert_array_equal(result.pixels[..., 0], frames[1])
