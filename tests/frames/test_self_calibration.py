"""The readout ratio: found where the motion says it, and refused where it does not."""

import pickle

import numpy as np
import pytest

from support.covering import covering, thorough
from support.hand_held import FOCAL, HEIGHT, camera, exact_tracks, hand, pan, shaking, still
from unshutter.errors import UnknownRatioError
from unshutter.frames.camera import ROWS
from unshutter.frames.self_calibration import ratio_from_motion
from unshutter.reasons import Code


def ratio_of(log, ratio, frames=45, noise=0.1):
    return ratio_from_motion(exact_tracks(camera(log, ratio, frames), noise=noise), FOCAL * ROWS / HEIGHT)


@pytest.mark.parametrize("ratio", [0.3, thorough(0.6), 0.9])
def test_a_hand_says_it(ratio):
    answer = ratio_of(hand(seed=int(10 * ratio)), ratio)
    assert answer.value == pytest.approx(ratio, abs=0.03)
    assert abs(answer.value - ratio) < 3 * answer.error
    assert 0 < answer.error < 0.05


@pytest.mark.parametrize(
    ("log", "because"),
    [(still(), Code.STOOD_STILL), (pan(), Code.TOO_EVEN), (shaking(52), Code.SHOOK_TOO_FAST)],
)
def test_where_it_cannot_be_told_it_is_not_guessed(log, because):
    with pytest.raises(UnknownRatioError) as caught:
        ratio_of(log, 0.6)
    reason = caught.value.reason
    assert reason.code is Code.RATIO_UNKNOWN and dict(reason.figures)["because"] == because
    passed_on = pickle.loads(pickle.dumps(caught.value.with_advice("say it")))  # as between processes
    assert passed_on.reason == reason and str(passed_on) == f"{reason}: say it"
    assert "--" not in str(reason)  # flags are the command line's business


@pytest.mark.parametrize(("log", "frames"), covering([hand(1), pan(), shaking(52)], [2, 3]))
def test_two_or_three_frames_do_not_say_why_not(log, frames):
    with pytest.raises(UnknownRatioError, match=f"\\({frames} frames are too few to show it\\)$"):
        ratio_of(log, 0.6, frames=frames)


def test_no_tracks_are_no_answer():
    with pytest.raises(UnknownRatioError, match="stood still"):
        ratio_from_motion([], 300.0)


def test_more_noise_is_less_sure():
    sure, unsure = ratio_of(hand(5), 0.6), ratio_of(hand(5), 0.6, noise=0.2)
    assert unsure.error > sure.error
    assert np.abs([sure.value - 0.6, unsure.value - 0.6]).max() < 0.1


def test_fast_shaking_is_believed_where_parts_agree_and_something_else_would_contradict():
    pairs = exact_tracks(camera(shaking(23), 0.8, 50), noise=0.1)
    with pytest.raises(UnknownRatioError, match="too abruptly"):
        ratio_from_motion(pairs, FOCAL * ROWS / HEIGHT)
    assert ratio_from_motion(pairs, FOCAL * ROWS / HEIGHT, is_checked=True).value == pytest.approx(0.8, abs=0.05)
