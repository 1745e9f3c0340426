"""Renders the frames of a clip as planned: with their motion from the frames, a file or a first pass, and their views.

Frame -> MovingFrame -> (LinkedFrame ->) NewFrame
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.frame_motion import SHARES
from unshutter.motion import RowMotion
from unshutter.motion.finding import Finding
from unshutter.motion.warp import thread_count
from unshutter.video.ahead import ahead
from unshutter.video.camera import ClipCamera
from unshutter.video.clip import ClipRequest
from unshutter.video.clip_gyro import level_turns
from unshutter.video.clip_motion import ROWS, MovingFrame, with_motion
from unshutter.video.frame_links import LinkedFrame, linked
from unshutter.video.frame_map import StraightView
from unshutter.video.frame_warper import NewFrame, Warper, side_by_side
from unshutter.video.gyro_fit import up_directions
from unshutter.video.plan import Leave, Plan, Undo
from unshutter.video.stabilisation import CameraPath, Stabilisation, stabilised
from unshutter.video.work import Stage

if TYPE_CHECKING:
    from unshutter.video.pixels import Frame

_DECODED_AHEAD = 2  # frames, if they are small
_LINKED_AHEAD = 1  # frames, all held in memory
_MOVING_AHEAD = 8  # frames, if they are small
_SOLVED = 9  # how often a pair of frames is part of a fit, usually


@dataclass(frozen=True)
class Rendering:
    """How the frames of a clip are rendered: each step runs ahead of the next in a thread of its own."""

    request: ClipRequest
    camera: ClipCamera
    plan: Plan
    # the frames' views and motion from a first pass; None if the camera's path is left unchanged
    stabilisation: Stabilisation | None = None
    straight: StraightView | None = None  # the view in which lines are straight; None if the lens is kept

    def moving(self, frames: Iterator[Frame]) -> Generator[MovingFrame]:
        """Yields frames with their motion."""
        clip = self.request.clip
        options = self.request.options
        if self.straight is not None:
            return self._straightened(replace(self, straight=None).moving(frames))
        decoded = ahead(frames, clip.most_ahead(_DECODED_AHEAD))
        if self.stabilisation is not None or isinstance(self.plan, Leave) or self.plan.motion is not None:
            return self._with_known_motion(decoded)
        turns = self.camera.gyro and self.camera.gyro.turns
        whole_path = options.steadiness.stabilize is not None or options.save_motion is not None
        moving = with_motion(self.request, decoded, self.camera.readout, turns, whole_path)
        return ahead(moving, clip.most_ahead(_MOVING_AHEAD))  # as the next are analysed

    def _straightened(self, frames: Generator[MovingFrame]) -> Generator[MovingFrame]:
        with closing(frames):
            for moving in frames:
                yield replace(moving, view=self.straight)

    def _with_known_motion(self, frames: Generator[Frame]) -> Generator[MovingFrame]:
        plan = self.plan
        unchanged = Finding(RowMotion.zero(ROWS, ROWS), reason=plan.reason) if isinstance(plan, Leave) else None
        with closing(frames):
            for number, frame in enumerate(frames):
                self.request.work.advance(Stage.READ)
                if self.stabilisation is not None:
                    path = self.stabilisation.path
                    view = self.stabilisation.view(number)
                    found = unchanged or path.finding(number)
                    yield MovingFrame(frame, found, path.cuts[number], step=path.middle_steps[number], view=view)
                elif unchanged is not None:
                    yield MovingFrame(frame, unchanged)
                elif isinstance(plan, Undo) and plan.motion is not None:
                    found, cut, step = plan.motion.at(frame.time or 0.0)
                    yield MovingFrame(frame, found, cut, step=step)

    def rectified(self, warper: Warper, frames: Iterator[Frame]) -> Generator[NewFrame]:
        """Yields the frames to encode."""
        request = self.request
        undo = self.request.options.undo
        moving: Generator[MovingFrame | LinkedFrame] = self.moving(frames)
        if undo.model == "dense" and undo.strength and isinstance(self.plan, Undo):
            ratio = self.camera.readout.ratio(request.clip.interval_s)
            moving = ahead(linked(request, moving, ratio.value), _LINKED_AHEAD)
        return side_by_side(warper, moving, thread_count())


def expected(request: ClipRequest, plan: Plan) -> dict[Stage, int]:
    """Returns how many items of its stages it takes to write a clip's frames as planned."""
    options = request.options
    frames = request.frames
    is_steady = options.steadiness.stabilize is not None
    passes = 1 + is_steady + (options.undo.edges == "crop")
    is_known = plan.motion is not None if isinstance(plan, Undo) else not is_steady
    searches = 0 if is_known else 1 if is_steady else passes
    is_linked = options.undo.model == "dense" and isinstance(plan, Undo)
    each = {Stage.FOLLOW: searches, Stage.FIT: _SOLVED * searches, Stage.READ: passes - searches}
    each |= {Stage.LINK: is_linked, Stage.DRAW: 1, Stage.ENCODE: 1}
    return {stage: frames * many for stage, many in each.items()}


# ---- views --------------------------------------------------------------------------------------------------------


def straight_view(request: ClipRequest) -> StraightView:
    """Returns the view in which lines are straight; raises UnshutterError if the lens is unknown."""
    if request.lens is None:
        raise UnshutterError(
            "{clip} shows no lens that bends lines, and none is known for its camera: name one with {--lens}",
            clip=request.clip.path,
        )
    height, width = request.frame_size
    return StraightView.of(request.lens, request.readout, width / height)


def with_steady_views(rendering: Rendering) -> Rendering:
    """Returns how a clip is rendered stabilised, after a first pass that determines the camera's path."""
    request = rendering.request
    options = rendering.request.options
    turns = level_turns(rendering.camera.gyro) if options.steadiness.level else None
    undo = replace(options.undo, strength=0.0) if isinstance(rendering.plan, Leave) else options.undo
    height, width = request.frame_size
    path = CameraPath(undo, request.readout, width / height, request.lens)
    motion = rendering.plan.motion if isinstance(rendering.plan, Undo) else None
    for moving in watched(replace(rendering, plan=Undo(motion))):
        path.add(moving.found, moving.step, moving.cut, moving.frame.time or 0.0)
    if motion is not None and not any(path.middle_steps):
        raise UnshutterError(
            f"{options.motion} is from an earlier version and lacks the turns between frames: "
            "save it again with {--save-motion}"
        )
    up = turns and up_directions(turns, np.array(path.times_s), SHARES[options.undo.reference])
    steady = stabilised(path, options.steadiness, request.clip.interval_s, up)
    plan = replace(rendering.plan, frames=len(path)) if isinstance(rendering.plan, Leave) else rendering.plan
    return replace(rendering, plan=plan, stabilisation=steady)


def watched(rendering: Rendering) -> Generator[MovingFrame]:
    """Yields the frames with their motion, reporting progress for each: a pass before that which writes the film."""
    steps = rendering.request.steps("looking")
    options = rendering.request.options
    decoded = rendering.request.clip.frames_between(options.start, options.end)
    with closing(rendering.moving(decoded)) as frames:
        for moving in frames:
            steps.advance()
            yield moving
