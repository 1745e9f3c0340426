"""A clip is better afterwards, as tracks kept out of the fit show, or it is left alone."""

from dataclasses import replace

import numpy as np
import pytest

from support import clips
from support.hand_held import log_of, pan, still
from unshutter.options.clip_options import RectifyClip, Shutter
from unshutter.progress import ClipObserver
from unshutter.reasons import Code
from unshutter.video.calibrate import cameras, gain, questions
from unshutter.video.calibrate.cameras import CameraMode
from unshutter.video.calibrate.gain import FrameSteps, Gain
from unshutter.video.calibrate.readout_regression import PairMotion
from unshutter.video.decision import Leave, RectifyFrames, calibrate_and_decide, why_no_gain
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.file.stages import Stage, Work

FRAMES = 24


def gentle():
    """A hand that is nearly still: rows move by a third of a pixel of 1080 rows."""
    return log_of(lambda t: 1.2 * np.sin(6 * t), lambda t: 0 * t, lambda t: 1.0 * np.sin(8 * t))


@pytest.fixture(autouse=True)
def listed(monkeypatch):
    """The table knows the camera of these clips: nothing is searched for, and no time is stated by the user."""
    one = CameraMode("Nemo", "One", "", clips.WIDTH, clips.HEIGHT, 30.0, 20.0, 20.0, 20.0)
    monkeypatch.setattr(cameras, "table", lambda: (one,))


@pytest.fixture
def run(tmp_path, straighten):
    """Rectifies frames as a clip; (the clip, the result, the log's record, what was printed)."""

    def rectified(greys, *flags):
        clip = clips.write(tmp_path / "in.mkv", greys, "ffv1", "gray")
        known = () if "--readout-ms" in flags else ("--camera", "nemo", *clips.KNOWN[2:])
        return clip, *straighten(clip, *flags, *known)

    return rectified


def test_what_a_rolling_shutter_distorted_is_straightened(run):
    camera, greys = clips.moving(FRAMES)
    _, out, record, _ = run(greys, "--edges", "fill")  # in the truth, frames are not enlarged
    true = np.stack(clips.truth(camera)).astype(float)
    assert record["rectified"] == FRAMES and record["found_by"] == "table of cameras"
    assert clips.psnr(clips.luma(out), true) > clips.psnr(np.stack(greys).astype(float), true) + 5


def test_distortion_that_nobody_sees_is_left(run):
    greys = clips.moving(FRAMES, gentle())[1]
    clip, out, record, shown = run(greys)
    assert out.read_bytes() == clip.read_bytes()
    assert [reason["code"] for reason in record["declined"]] == [Code.NO_VISIBLE_DISTORTION]
    assert f"{FRAMES} left unchanged (this clip has no visible rolling-shutter distortion)" in shown
    _, out, record, _ = run(greys, "--readout-ms", "20")  # whoever states the time insists
    assert record["rectified"] > FRAMES / 2 and out.read_bytes() != clip.read_bytes()


@pytest.mark.parametrize("flags", [(), ("--stabilize", "--zoom-limit", "0")])
def test_what_does_not_help_is_not_done(run, flags):
    """A global shutter, said to be a rolling one: undoing what it never did would make it wobble."""
    greys = clips.truth(clips.moving(FRAMES)[0])
    clip, out, record, shown = run(greys, *flags)
    (reason,) = record["declined"]
    assert reason["code"] == Code.NO_GAIN and reason["figures"]["after"] > reason["figures"]["before"]
    assert "undoing the motion hardly helps" in shown and "to straighten it anyway" in shown
    assert record["rectified"] == 0 and (flags or out.read_bytes() == clip.read_bytes())
    if not flags:
        assert run(greys, "--readout-ms", "20")[2]["rectified"] == FRAMES


def test_a_camera_that_stood_still_is_copied(run):
    clip, out, record, _ = run(clips.standing(FRAMES))
    assert out.read_bytes() == clip.read_bytes() and record["declined"][0]["code"] == Code.STOOD_STILL


def test_a_smooth_path_is_not_smoothed(run):
    clip, out, record, shown = run(clips.moving(FRAMES, still())[1], "--stabilize")
    assert out.read_bytes() == clip.read_bytes() and record["frames"] == FRAMES
    assert record["stabilised"]["zoom"] == 1.0 and "the camera's path is smooth already: nothing to stabilise" in shown


def test_a_smooth_path_does_not_keep_a_clip_from_being_straightened(run):
    """An even pan: there is nothing to smooth, but every frame leans."""
    clip, out, record, shown = run(clips.moving(FRAMES, pan(30.0))[1], "--stabilize")
    assert "nothing to stabilise" in shown and record["rectified"] == FRAMES
    assert out.read_bytes() != clip.read_bytes()


@pytest.mark.parametrize("strength", ["0", "1.5"])
def test_a_strength_other_than_asked_of_the_clip_is_obeyed(run, strength):
    """Neither nothing nor more than all of the motion is to be compared with the frames."""
    record = run(clips.moving(FRAMES)[1], "--strength", strength)[2]
    assert not [each for each in record["declined"] if each["code"] in (Code.NO_GAIN, Code.NO_VISIBLE_DISTORTION)]


@pytest.fixture
def told(monkeypatch):
    """The gains that are measured, with three runs of 16 frames, or all frames if these are no more."""
    monkeypatch.setattr(gain, "RUN", 16)
    monkeypatch.setattr(gain, "ALL", 3 * 16)
    short = replace(questions.GAIN, frames=(16,) * 3, all_of=3 * 16)
    asked = tuple(short if each is questions.GAIN else each for each in questions.QUESTIONS)
    monkeypatch.setattr(questions, "QUESTIONS", asked)
    told: list[Gain] = []
    measure = Gain.of
    monkeypatch.setattr(Gain, "of", lambda *given: told.append(measure(*given)) or told[-1])
    return told


def decided(folder, greys, *observer):
    clip = read_clip_facts(str(clips.write(folder / "in.mkv", greys, "ffv1")))
    request = ClipRequest.of(clip, RectifyClip(Shutter(camera="nemo", focal_px=clips.FOCAL)), *observer)
    return calibrate_and_decide(request)[2]


def test_a_few_dozen_pairs_tell(tmp_path, told):
    decision = decided(tmp_path, clips.moving(60)[1])
    before, after = np.median(told[-1].wobble_px, axis=0)
    middle, error = told[-1].gain
    assert isinstance(decision, RectifyFrames) and abs(told[-1].frames - 3 * 16) <= 4
    assert after < before / 2 and middle > 10 * error


class _Shares(ClipObserver):
    def __init__(self):
        self.noted: list[float] = []

    def note_share(self, share, left_s):
        self.noted.append(share)


def test_all_are_asked_before_a_clip_is_left_which_has_its_part_of_the_whole_from_the_start(
    tmp_path, monkeypatch, told
):
    expected: list[dict[Stage, int]] = []
    done: list[Stage] = []
    expect = Work.expect
    advance = Work.advance
    monkeypatch.setattr(Work, "expect", lambda work, items: expected.append(items) or expect(work, items))
    monkeypatch.setattr(Work, "advance", lambda work, stage, items=1: done.append(stage) or advance(work, stage, items))
    shares = _Shares()
    decision = decided(tmp_path, clips.truth(clips.moving(60)[0]), shares)
    before, after = np.median(told[-1].wobble_px, axis=0)
    assert isinstance(decision, Leave) and decision.frames == 60 and abs(told[-1].frames - 60) <= 4
    assert after > before and told[-1].gain[0] < 0
    assert expected[0][Stage.SURVEY_ALL] == 15 and expected[0][Stage.JUDGE_ALL] == 15 * gain.SOLVED
    again = next(items for items in expected[1:] if items.get(Stage.SURVEY_ALL))
    assert again[Stage.SURVEY_ALL] == 60 and again[Stage.JUDGE_ALL] == 60 * gain.SOLVED
    assert done.count(Stage.SURVEY_ALL) == 60 and done.count(Stage.JUDGE_ALL) > 0
    second = done.index(Stage.SURVEY_ALL)
    assert shares.noted == sorted(shares.noted) and shares.noted[second - 1] < 0.9
    assert len(set(shares.noted[second:])) == len(done) - second


@pytest.mark.parametrize(("after", "declined"), [(0.97, Code.NO_GAIN), (0.90, None)])
def test_a_sure_gain_must_be_worth_the_sharpness(after, declined):
    pairs = 40
    known = {"gains": [9.0] * pairs, "wobble_px": [(1.0, after)] * pairs, "changes_px": [(3.0, 3.0)] * pairs}
    reason = why_no_gain(Gain(pairs, 1080, [3.0] * pairs, **known))
    assert (reason and reason.code) == declined


def test_a_wobble_is_told_in_pixels_of_the_clip():
    pairs = 40
    known = {"gains": [9.0] * pairs, "wobble_px": [(2.0, 1.98)] * pairs, "changes_px": [(3.0, 3.0)] * pairs}
    reason = why_no_gain(Gain(pairs, 480, [3.0] * pairs, **known))
    assert str(reason) == "undoing the motion hardly helps: wobble of 0.89 px before, 0.88 px after"


def test_a_clip_with_one_large_step_is_left_for_that():
    """All other steps get smaller: what is said is how large that one gets."""
    rng = np.random.default_rng(1)
    steps = FrameSteps()
    for number, shape in enumerate(rng.normal(0, 0.3, (30, 2))):
        after = np.array([0.0, 1.9]) if number == 12 else shape / 4
        steps.add(PairMotion(np.zeros(2), shape), PairMotion(np.zeros(2), after), np.zeros(2))
    reason = why_no_gain(Gain(frames=30, displaced_px=[5.0] * 30, steps=steps))
    assert reason is not None and reason.code is Code.NO_GAIN
    figures = dict(reason.figures)
    assert figures["after"] > 1.5 > figures["before"] > 0.5
