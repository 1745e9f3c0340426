"""Renders the frames of a clip as decided: their motion comes from the frames, a file or a first pass.

Frame -> MovingFrame -> (LinkedFrame ->) NewFrame
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.frame_motion import READOUT_FRACTION
from unshutter.motion import Motion, RowMotion
from unshutter.motion.edges import EdgePolicy
from unshutter.motion.finding import Finding
from unshutter.motion.warp import thread_count
from unshutter.video.calibrate.camera import ClipCamera
from unshutter.video.calibrate.clip_gyro import level_rotations
from unshutter.video.decision import Decision, Leave, RectifyFrames
from unshutter.video.file.ahead import ahead
from unshutter.video.file.camera_clock import SIDE, Changes
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.row_samples import ROWS
from unshutter.video.file.stages import Stage
from unshutter.video.gyro.synchronisation import up_directions
from unshutter.video.render.clip_motion import MovingFrame, with_motion
from unshutter.video.render.enlargement import Enlargement
from unshutter.video.render.frame_links import LinkedFrame, linked
from unshutter.video.render.frame_warper import NewFrame, Warper, side_by_side
from unshutter.video.render.stabilisation import CameraPath, Stabilisation, stabilised
from unshutter.video.render.views import StraightView, View

if TYPE_CHECKING:
    from unshutter.video.file.pixels import Frame

_DECODED_AHEAD = 2  # frames, if they are small
_LINKED_AHEAD = 1  # frames, all held in memory
_MOVING_AHEAD = 8  # frames, if they are small
_SOLVED = 9  # how often a pair of frames is part of a fit, usually


@dataclass(frozen=True)
class Rendering:
    """How the frames of a clip are rendered: each step runs ahead of the next in a thread of its own."""

    request: ClipRequest
    camera: ClipCamera
    decision: Decision
    # the frames' stabilised views; None if the camera's path is left unchanged
    stabilisation: Stabilisation | None = None
    straight: StraightView | None = None  # the view in which lines are straight; None if the lens is kept
    path: CameraPath | None = None  # the frames' motion, if a first pass found it
    enlargement: Enlargement | None = None  # that which hides the frames' borders; None if borders may show

    def moving(self, frames: Iterator[Frame]) -> Generator[MovingFrame]:
        """Yields frames with their motion."""
        clip = self.request.clip
        options = self.request.options
        if any(each is not None for each in (self.straight, self.stabilisation, self.enlargement)):
            return self._viewed(replace(self, straight=None, stabilisation=None, enlargement=None).moving(frames))
        decoded = ahead(frames, clip.most_ahead(_DECODED_AHEAD))
        if self.path is not None or isinstance(self.decision, Leave) or self.decision.motion is not None:
            return self._with_known_motion(decoded)
        rotations = self.camera.gyro and self.camera.gyro.rotations
        needs = options.steadiness.stabilize, options.save_motion, options.save_gyro
        with_steps = any(each is not None for each in needs)
        moving = with_motion(
            self.request,
            decoded,
            self.camera.readout_time,
            rotations,
            with_steps,
            self.decision.sampled,
            self.decision.focal_px,
            self.decision.motions,
        )
        return ahead(moving, clip.most_ahead(_MOVING_AHEAD))  # as the next are analysed

    def view(self, number: int) -> View | None:
        """Returns the view of a frame that is shown; None for the camera's own."""
        view = self.straight if self.stabilisation is None else self.stabilisation.view(number)
        return view if self.enlargement is None else self.enlargement.of(view)

    def known(self) -> Iterator[tuple[Motion, View | None]]:
        """Yields motions and views that a first pass, or the decision to leave a clip, has settled."""
        zero = RowMotion.zero(ROWS, ROWS)
        if self.path is None:
            yield zero, self.view(0)
            return
        for number in range(len(self.path)):
            yield zero if isinstance(self.decision, Leave) else self.path.finding(number).motion, self.view(number)

    def _viewed(self, frames: Generator[MovingFrame]) -> Generator[MovingFrame]:
        shown = 0
        changes = Changes(self.request.clip.clock)
        with closing(frames):
            for number, moving in enumerate(frames):
                is_same = self.request.clip.clock.repeats and changes.is_repeated(self.request.grey(moving.frame, SIDE))
                shown = shown if is_same else number
                yield replace(moving, view=self.view(shown))

    def _with_known_motion(self, frames: Generator[Frame]) -> Generator[MovingFrame]:
        decision = self.decision
        unchanged = Finding(RowMotion.zero(ROWS, ROWS), reason=decision.reason) if isinstance(decision, Leave) else None
        with closing(frames):
            for number, frame in enumerate(frames):
                self.request.work.advance(Stage.READ)
                if self.path is not None:
                    found = unchanged or self.path.finding(number)
                    yield MovingFrame(frame, found, self.path.cuts[number], step=self.path.middle_steps[number])
                elif unchanged is not None:
                    yield MovingFrame(frame, unchanged)
                elif isinstance(decision, RectifyFrames) and decision.motion is not None:
                    found, cut, step = decision.motion.at(frame.time or 0.0)
                    yield MovingFrame(frame, found, cut, step=step)

    def rectified(self, warper: Warper, frames: Iterator[Frame]) -> Generator[NewFrame]:
        """Yields the frames to encode."""
        request = self.request
        undo = self.request.options.undo
        moving: Generator[MovingFrame | LinkedFrame] = self.moving(frames)
        if undo.model == "dense" and undo.strength and isinstance(self.decision, RectifyFrames):
            ratio = self.camera.readout_time.ratio(request.clip.camera_interval_s)
            moving = ahead(linked(request, moving, ratio.value), _LINKED_AHEAD)
        return side_by_side(warper, moving, thread_count())


def expected(request: ClipRequest, decision: Decision) -> dict[Stage, int]:
    """Returns how many items of its stages it takes to write a clip's frames as planned."""
    options = request.options
    frames = request.frames
    needs_path = options.steadiness.stabilize is not None or options.save_gyro is not None
    is_left = isinstance(decision, Leave)
    needs_borders = not is_left and (options.may_enlarge or EdgePolicy(options.undo.edges).must_crop)
    passes = 2 if needs_path or needs_borders else 1
    is_known = not needs_path if isinstance(decision, Leave) else decision.motion is not None
    searches = 0 if is_known else 1
    fits = 0 if isinstance(decision, RectifyFrames) and decision.motions is not None else _SOLVED * searches
    is_linked = options.undo.model == "dense" and not is_left
    each = {Stage.FOLLOW: searches, Stage.FIT: fits, Stage.READ: passes - searches}
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
    return StraightView.of(request.lens, request.scan_direction, width / height)


def with_views(rendering: Rendering) -> Rendering:
    """Returns how a clip is rendered as its options ask: stabilised, and enlarged until no border shows."""
    options = rendering.request.options
    if options.steadiness.stabilize is not None:
        rendering = _with_steady_views(rendering)
    if options.save_gyro is not None:
        rendering = with_known_motion(rendering)
    return _with_hidden_borders(rendering) if options.may_enlarge else rendering


def _with_steady_views(rendering: Rendering) -> Rendering:
    """Returns how a clip is rendered stabilised, after a first pass that determines the camera's path."""
    request = rendering.request
    options = rendering.request.options
    rotations = level_rotations(rendering.camera.gyro) if options.steadiness.level else None
    decision = rendering.decision
    motion = None if isinstance(decision, Leave) else decision.motion
    path = path_of(rendering)
    if motion is not None and not any(path.middle_steps):
        raise UnshutterError(
            f"{options.motion} is from an earlier version and lacks the turns between frames: "
            "save it again with {--save-motion}"
        )
    times_s = np.array(path.times_s) / request.clip.clock.slowed
    up = rotations and up_directions(rotations, times_s, READOUT_FRACTION[options.undo.reference])
    steady = stabilised(path, options.steadiness, request.clip.interval_s, up)
    if isinstance(decision, Leave):
        decision = replace(decision, frames=len(path))
    return replace(rendering, decision=decision, path=path, stabilisation=steady)


def with_known_motion(rendering: Rendering) -> Rendering:
    """Returns how a clip is rendered with the motion from a first pass, unless that is known or nothing is undone."""
    if rendering.path is not None or isinstance(rendering.decision, Leave):
        return rendering
    return replace(rendering, path=path_of(rendering))


def _with_hidden_borders(rendering: Rendering) -> Rendering:
    """Returns how a clip is rendered with all frames enlarged alike, as far as a first pass finds necessary.

    A stabilised path has its zoom already.
    """
    steady = rendering.stabilisation
    if isinstance(rendering.decision, Leave) or (steady is not None and not steady.is_idle):
        return rendering
    rendering = with_known_motion(rendering)
    assert rendering.path is not None
    size = rendering.request.clip.picture_size
    return replace(rendering, enlargement=Enlargement.least(rendering.path, *size, rendering.straight))


def path_of(rendering: Rendering) -> CameraPath:
    """Returns the motion of a clip's frames, by a first pass unless it is known; none is undone if the clip is left."""
    if rendering.path is not None:
        return rendering.path
    request = rendering.request
    is_left = isinstance(rendering.decision, Leave)
    if is_left:
        rendering = replace(rendering, decision=RectifyFrames())
    undo = replace(request.options.undo, strength=0.0) if is_left else request.options.undo
    height, width = request.frame_size
    path = CameraPath(undo, request.scan_direction, width / height, request.lens)
    for moving in watched(rendering):
        path.add(moving.found, moving.step, moving.cut, moving.frame.time or 0.0)
    return path


def watched(rendering: Rendering) -> Generator[MovingFrame]:
    """Yields the frames with their motion in a pass before the one that writes the video, and reports progress."""
    steps = rendering.request.steps("looking")
    options = rendering.request.options
    decoded = rendering.request.clip.frames_between(options.start, options.end)
    with closing(rendering.moving(decoded)) as frames:
        for moving in frames:
            steps.advance()
            yield moving
