"""The questions about a clip's camera, and the frames that answer each of them, as a table.

The first question that is open decides: it needs the most frames, and these answer the others, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from unshutter.video.calibrate import clip_gyro, gain, lenses
from unshutter.video.calibrate import readout_time as readout
from unshutter.video.calibrate.first_look import Parts, look_first, shows_nothing, spread, with_liveliest
from unshutter.video.calibrate.readout_time import listed_time
from unshutter.video.calibrate.sampled_frames import SampledFrames, sample_frames
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.stages import Stage, Steps
from unshutter.video.gyro.gyro_log import GyroLog

FIRST_LOOK = 40  # frames that show whether some are repeated
Log: TypeAlias = GyroLog | clip_gyro.ClipGyro | None


@dataclass(frozen=True)
class Question:
    """A question about a clip's camera, and the frames that answer it."""

    is_open: Callable[[ClipRequest, Log], bool]
    frames: tuple[int, ...]  # of each part, spread evenly over the clip
    name: str = ""  # of the progress, if frames are counted
    fits: int = 0  # how often a pair of frames is part of a fit, usually
    all_of: int = 0  # frames: of a clip that has no more, all are asked
    looks_first: bool = False  # whether a clip may be left after a first look (first_look.py)
    # a look at fewer frames: every such part, or so many frames at the beginning; and whether these are enough
    every: int = 0
    first: int = 0
    is_answered: Callable[[SampledFrames], bool] = lambda sampled: True


def _is_time_open(request: ClipRequest, log: Log) -> bool:
    if request.options.shutter.states_time:
        return False
    listed = None if request.clip.camera.is_stabilised else listed_time(request)
    return listed is None or listed.plausible_s is not None


def _is_gain_open(request: ClipRequest, log: Log) -> bool:
    return not request.options.shutter.states_time and gain.is_tested(request.options)


def _is_time_certain(sampled: SampledFrames) -> bool:
    shown = sampled.regression
    return shown is not None and (shown.is_none or shown.is_precise)


READOUT_TIME = Question(
    is_open=_is_time_open,
    frames=(readout.PART + 1,) * readout.MOST_PARTS,
    name="readout time",
    fits=readout.SOLVED,
    looks_first=True,
    every=3,
    is_answered=_is_time_certain,
)
GYRO = Question(
    is_open=lambda request, log: isinstance(log, GyroLog), frames=(clip_gyro.PART,) * clip_gyro.MOST_PARTS, name="gyro"
)
GAIN = Question(is_open=_is_gain_open, frames=(gain.RUN,) * gain.RUNS, name="looking", all_of=gain.ALL)
LENS = Question(
    is_open=lambda request, log: request.options.shutter.lens is None and request.options.shutter.focal_px is None,
    frames=(lenses.FIRST, *[lenses.PART] * lenses.FURTHER),
    first=lenses.PART + 1,
    is_answered=lambda sampled: not lenses.may_bend_lines(sampled),
)
NONE = Question(is_open=lambda request, log: True, frames=())
QUESTIONS = READOUT_TIME, GYRO, GAIN, LENS, NONE


def open_question(request: ClipRequest, log: Log) -> tuple[Question, Parts]:
    """Returns the first open question, and the parts of the clip that answer it."""
    question = next(each for each in QUESTIONS if each.is_open(request, log))
    everything = [(request.options.start, request.options.end)]
    if question is GYRO and isinstance(log, GyroLog):
        starts_s = clip_gyro.lively_parts(request, log)
        length_s = (clip_gyro.PART - 0.5) * request.clip.camera_step_s
        return question, everything if starts_s is None else [(start, start + length_s) for start in starts_s]
    if question.looks_first and isinstance(log, GyroLog):  # the log shows what frames do not
        question = replace(question, looks_first=False)
    if _frames_in(request, [request.span]) <= question.all_of:
        return question, everything
    return question, spread(request, question.frames)


def ask(request: ClipRequest, question: Question, parts_s: Parts) -> SampledFrames:
    """Decodes what a question needs: fewer frames first, if it has such, and the others unless it is answered.

    What that is expected to take is stated, and what then follows, until a clip is judged.
    """
    frames = _frames_in(request, parts_s) if parts_s else 0
    searches = {Stage.SURVEY: frames, Stage.SEARCH: question.fits * frames}
    all_frames = 0.25 * request.frames  # how likely all are asked: the time that is left is right either way
    is_whole = list(parts_s) == [(request.options.start, request.options.end)]
    if is_whole:
        judging = gain.expected(request, frames, 0) if frames <= gain.ALL else gain.expected(request, 0, frames)
    else:
        judging = gain.expected(request, min(frames, gain.ALL), all_frames)
    again = 0 if is_whole or not judging[Stage.JUDGE] else round(all_frames)
    request.work.expect(searches | {Stage.SURVEY_ALL: again} | judging)
    seen = look_first(request) if question.looks_first else SampledFrames()
    if shows_nothing(request, seen):
        request.work.expect(dict.fromkeys(searches, 0))
        return seen
    steps = Steps(request.work, question.name, frames) if question.name else None
    first_s = spread(request, [question.first])[:1] if question.first else []
    if question.every and len(parts_s) == len(question.frames):
        first_s = parts_s[1 :: question.every]
    if not first_s:
        return sample_frames(request, parts_s, steps, known=seen.by_time)
    first = sample_frames(request, first_s, steps, known=seen.by_time)
    others_s = [part for part in parts_s if part not in first_s]
    if question.is_answered(first) or not others_s:
        request.work.expect(dict.fromkeys(searches, 0))
        return first
    others = sample_frames(request, others_s, steps, known=seen.by_time)
    return others if len(others_s) == len(parts_s) else first.with_parts(others)


def most_parts(request: ClipRequest) -> tuple[Parts, bool]:
    """Returns the most of a clip that is looked at before it is left, and whether its liveliest part is among it."""
    return with_liveliest(request, spread(request, READOUT_TIME.frames))


def first_look(request: ClipRequest) -> Parts:
    """Returns the part of a clip by which repeated frames are noticed if no question asks as many."""
    return spread(request, [FIRST_LOOK])


def _frames_in(request: ClipRequest, parts_s: Parts) -> int:
    """Returns about how many frames there are in some parts."""
    begin, last = request.span
    seconds = sum((end or last) - (start or begin) for start, end in parts_s)
    return max(round(seconds / request.clip.camera_step_s), 2)
