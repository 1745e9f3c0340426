"""The progress of a clip: one share from start to end, and how long the rest takes."""

import time

import pytest

from support import clips
from support.covering import thorough
from support.hand_held import pan
from unshutter.options.clip_options import ClipUndo, RectifyClip, Shutter, Steadiness
from unshutter.progress import ClipObserver
from unshutter.video.clip_rectification import rectify_clip_file
from unshutter.video.file import stages
from unshutter.video.file.stages import Stage, Work


class _Notes(ClipObserver):
    """What was noted, and the processor's time at each note: however busy the machine is, that is the work's own."""

    def __init__(self):
        self.shares: list[float] = []
        self.left_s: list[float | None] = []
        self.at_s = [time.process_time()]

    def note_share(self, share, left_s):
        self.shares.append(share)
        self.left_s.append(left_s)
        self.at_s.append(time.process_time())


@pytest.mark.parametrize(
    "options",
    [
        RectifyClip(Shutter(focal_px=clips.FOCAL), steadiness=Steadiness(stabilize=2.0)),
        thorough(RectifyClip()),
        thorough(RectifyClip(undo=ClipUndo(edges="crop"))),
        thorough(RectifyClip(Shutter(readout_ratio=0.6), ClipUndo(model="dense"))),
    ],
)
def test_the_bar_never_falls_and_never_stands_still(tmp_path, options):
    clip = clips.write(tmp_path / "in.mkv", clips.moving(60)[1], "ffv1", "gray")
    notes = _Notes()
    rectify_clip_file(str(clip), str(tmp_path / "out.mkv"), options, notes)
    notes.at_s.append(time.process_time())
    assert notes.shares == sorted(notes.shares) and notes.shares[0] < 0.02 and notes.shares[-1] == 1.0
    assert len(set(notes.shares)) > 150
    assert max(later - earlier for earlier, later in zip(notes.at_s, notes.at_s[1:], strict=False)) < 2.0


def _worked(monkeypatch, expected, done, pace=1.0, closing=1e-9):
    """The shares and the times that are left as stages are done, at a pace."""
    clock = [0.0]
    monkeypatch.setattr(stages.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(stages, "_COSTS_S", dict.fromkeys(Stage, (1.0, 0.0)))
    monkeypatch.setattr(stages, "_CLOSING_S", closing)
    notes = _Notes()
    counted = Work(notes, 1.0)
    counted.expect(expected)
    for stage in done:
        clock[0] += pace
        counted.advance(stage)
    return notes


def test_each_stage_takes_its_part(monkeypatch):
    stages = [Stage.SURVEY] * 4 + [Stage.DRAW] * 6
    notes = _worked(monkeypatch, {Stage.SURVEY: 4, Stage.DRAW: 6}, stages, pace=3.0)
    assert notes.shares == pytest.approx([k / 10 for k in range(1, 11)])
    assert [left or 0.0 for left in notes.left_s] == pytest.approx([3.0 * k for k in reversed(range(10))], abs=1e-6)


def test_what_nobody_expected_takes_its_part_too(monkeypatch):
    """Neither an unexpected stage nor one that is longer than the file states lets the bar stand still."""
    stages = [Stage.SURVEY] * 4 + [Stage.SEARCH] * 5 + [Stage.DRAW] * 30
    notes = _worked(monkeypatch, {Stage.SURVEY: 4, Stage.DRAW: 6}, stages, closing=0.5)
    assert all(earlier < later for earlier, later in zip(notes.shares, notes.shares[1:], strict=False))
    assert notes.shares[3] == pytest.approx(4 / 10.5) and notes.shares[-1] < 1
    assert max(left for left in notes.left_s if left is not None) <= 10


def test_a_stage_that_is_left_out_shortens_the_rest(monkeypatch):
    notes = _worked(monkeypatch, {Stage.SURVEY: 4, Stage.JUDGE: 0, Stage.DRAW: 4}, [Stage.SURVEY] * 2)
    counted = Work(notes, 1.0)
    counted.expect({Stage.SURVEY: 2, Stage.DRAW: 6})
    counted.advance(Stage.SURVEY)
    counted.expect({Stage.SURVEY: 0})
    counted.advance(Stage.DRAW)
    assert notes.shares[-1] == pytest.approx(1 / 8 + 7 / 8 / 6)
    counted.finish()
    assert notes.shares[-1] == 1.0


def test_a_stage_that_takes_more_for_each_frame_than_usual_keeps_its_part(monkeypatch):
    notes = _worked(monkeypatch, {Stage.JUDGE: 20}, [])
    counted = Work(notes, 1.0)
    counted.expect({Stage.JUDGE: 20})
    for done in range(1, 11):  # of 10 frames, each of which takes 4 fits instead of 2
        for _ in range(4):
            counted.advance(Stage.JUDGE)
        counted.expect_as_before(Stage.JUDGE, done, 10 - done)
    assert notes.shares[3] == pytest.approx(4 / 20) and notes.shares[4] == pytest.approx(4 / 20 + 16 / 20 / 36)
    assert notes.shares[3:24:4] == pytest.approx([0.2 + 0.8 * k / 9 for k in range(6)])


def test_fits_leave_some_of_the_bar_until_they_are_done(monkeypatch):
    """A window of frames may take all the fits that were expected of the clip, and go on."""
    notes = _worked(monkeypatch, {Stage.JUDGE: 20}, [Stage.JUDGE] * 40)
    assert notes.shares[12] == pytest.approx(13 / 20) and 0.85 < notes.shares[-1] < 0.97
    assert min(later - earlier for earlier, later in zip(notes.shares, notes.shares[1:], strict=False)) > 0.002


def test_a_search_for_the_readout_time_is_foreseen(tmp_path, monkeypatch):
    """The camera moves too evenly for a regression to tell."""
    totals = []

    def noted(counted, stage, items=1, advance=Work.advance):
        advance(counted, stage, items)
        totals.append(counted._spent_s + counted._left_s)

    monkeypatch.setattr(Work, "advance", noted)
    clip = clips.write(tmp_path / "in.mkv", clips.moving(60, pan())[1], "ffv1", "gray")
    rectify_clip_file(str(clip), str(tmp_path / "out.mkv"), RectifyClip())
    assert max(totals) < 1.5 * totals[0]  # 1.33 or 1.38, by the versions of libraries
