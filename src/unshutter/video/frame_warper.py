"""Finds the motion of a clip's frames, and renders the frames that a global shutter would have taken.

They are rendered by the camera's motion or, for depths, by optical flow. The flow between each frame and its neighbours
is computed on small grey copies (frames/neighbours.py). It determines where each pixel of a rectified frame is sampled,
and the planes are warped by it as they are by the camera's motion (frame_map.py). Unlike photos, frames are not
averaged: grain would vary from row to row.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import cv2
import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.frame_motion import AT_REST, FrameMotion, Step, Timing
from unshutter.frames.neighbours import Link, copy_side, link, motion_field
from unshutter.frames.self_calibration import GreyFrame
from unshutter.frames.sequence import CameraMotion, Window
from unshutter.motion import Motion, RotationMotion
from unshutter.motion.finding import Finding
from unshutter.motion.grid import EdgePolicy, Tile, valid_window
from unshutter.options.clip_options import ClipUndo
from unshutter.orientation import Readout
from unshutter.readout_time import ReadoutTime
from unshutter.reasons import Code
from unshutter.video.clip import Clip, ClipRequest
from unshutter.video.frame_map import FrameMap, Scratch, View, borrow_plane, on_plane, undone_part, warp_plane
from unshutter.video.gyro_fit import GyroTurns
from unshutter.video.pixels import Frame, of_file
from unshutter.video.scene_check import SceneCheck

if TYPE_CHECKING:
    from unshutter.motion.shapes import UInt, UInt8


_ALMOST_ALL = 0.8  # share of the picture found in both frames
_MOST_ROWS = 400  # short side [px] of clips' small copies; for copies this large, the flow is computed at half the size
ROWS = 65  # of the small pictures to which the motions of clips refer
GYRO_ROWS = 257  # if a gyro recorded the camera's vibration
COPY_SIDE = 270  # px, short side of the copies in which corners are tracked
FEWEST = 8  # frames of a shot: shorter ones are usually errors, not cuts
_FADED = 5  # frames, over which the correction of a clip fades where no motion is found
_WAITING = (8, 40)  # fewest and most frames awaiting their motion: those of a window, and of its margin ahead
_AHEAD = 4  # fewest frames of a margin
_IN_MEMORY = 72_000_000  # bytes of frames awaiting their motion


@dataclass(frozen=True)
class MovingFrame:
    """A frame of a clip and its motion."""

    frame: Frame  # the decoded frame
    # motion of a small picture of the same shape, first row as the reference; zero, with a reason, if none was found
    found: Finding
    cut: bool = False  # whether it shows another scene than the previous frame
    dense: bool = False  # whether it was rectified by the flow to its neighbours instead of this motion
    step: Step | None = None  # the camera's rotation since the previous frame; None if unknown
    view: View | None = None  # the stabilised or straightened view; None for the camera's own

    @property
    def motion(self) -> Motion:
        """The motion of the small picture."""
        return self.found.motion


def window_for(size: float) -> Window:
    """Returns the window for estimating motion that memory allows for a frame size [bytes]."""
    waiting = int(min(max(_IN_MEMORY / size, _WAITING[0]), _WAITING[1]))
    ahead = min(Window.ahead, max(2 * waiting // 5, _AHEAD))
    return Window(core=waiting - ahead, ahead=ahead)


def camera_motion(
    request: ClipRequest,
    time: ReadoutTime,
    turns: GyroTurns | None = None,
    whole_path: bool = False,
    keep_out: int | None = None,
    focal_px: float | None = None,
) -> CameraMotion:
    """Returns what estimates the motion of a clip's frames; see :func:`with_motion` and :class:`CameraMotion`."""
    focal_px = focal_px or (request.focal and request.focal * request.frame_size[0])
    if focal_px is None and turns is not None:
        focal_px = turns.focal_px(request.frame_size[0])
    return CameraMotion(
        ratio=time.ratio(request.clip.interval_s),
        focal_px=focal_px,
        readout=request.readout,
        window=window_for(request.clip.frame_bytes),
        fewest=FEWEST,
        turns=turns,
        whole_path=whole_path,
        keep_out=keep_out,
        lens=request.lens,
        check=SceneCheck.of(time, request.clip.interval_s),
    )


def grey_copies(request: ClipRequest, frames: Iterable[Frame]) -> Iterator[GreyFrame | None]:
    """Yields the small copies of frames in which corners are tracked, and None where frames are missing."""
    before = None
    for frame in frames:
        since = request.clip.since(before, frame)
        if since is None:
            yield None
        grey, size = request.grey(frame, COPY_SIDE), request.readout.frame_size(frame.height, frame.width)
        yield GreyFrame(*size, grey, after=1.0 if since is None else since, time_s=frame.time or 0.0)
        before = frame


def with_motion(
    request: ClipRequest,
    frames: Iterable[Frame],
    time: ReadoutTime,
    turns: GyroTurns | None = None,
    whole_path: bool = False,
) -> Iterator[MovingFrame]:
    """Yields the frames of a clip with their motion; they are delayed by some frames.

    Args:
        turns: the camera's rotation from a gyro; None to use only the frames.
        whole_path: whether the camera's rotation is needed even where it is too small to be undone.
    """
    camera = camera_motion(request, time, turns, whole_path)
    waiting: deque[Frame] = deque()

    def read() -> Iterator[Frame]:
        for frame in frames:
            waiting.append(frame)
            yield frame

    last = None
    for motion, small in _bridged(camera.motions(grey_copies(request, read()))):
        cut, step = last is not None and motion.scene != last.scene, motion.step_from(last)
        yield MovingFrame(waiting.popleft(), small, cut=cut, step=step)
        last = motion


def small_finding(motion: FrameMotion) -> Finding:
    """Returns the motion for a picture of ``ROWS`` rows, or ``GYRO_ROWS`` with a gyro."""
    rows = ROWS if motion.turns is None else GYRO_ROWS
    width = max(1, round(motion.width * rows / motion.height))
    return replace(motion, height=rows, width=width).finding()


_Known: TypeAlias = tuple[int, Finding, int]  # motion of another frame: scene, motion, and how many frames away it is


def _bridged(motions: Iterable[FrameMotion]) -> Iterator[tuple[FrameMotion, Finding]]:
    """Yields the motions, also for small pictures; those not found are filled in from the frames before and after.

    Otherwise, single frames would jump back to their distortion. In longer gaps, the correction fades out and in.
    """
    lost: deque[tuple[FrameMotion, Finding, list[_Known]]] = deque()
    before: list[_Known] = []

    def release(most: int, *after: tuple[int, Finding]) -> Iterator[tuple[FrameMotion, Finding]]:
        while len(lost) > most:
            motion, none, known = lost.popleft()
            yield motion, _mixed(motion.scene, none, known + [(*each, len(lost) + 1) for each in after])

    for motion in motions:
        small = small_finding(motion)
        before = [(scene, known, apart + 1) for scene, known, apart in before]
        if small.reason is None or small.reason.code in AT_REST:
            yield from release(0, (motion.scene, small))
            yield motion, small
            before = [(motion.scene, small, 0)]
        else:
            lost.append((motion, small, before))
            yield from release(_FADED - 1)
    yield from release(0)


def _mixed(scene: int, none: Finding, known: list[_Known]) -> Finding:
    """Returns a motion like those of frames nearby, the less so the further away; otherwise ``none``."""
    alike = [each for each in known if each[0] == scene]
    is_own = none.reason is not None and none.reason.code is Code.SCENE_CONTRADICTS  # a scene that is known as another
    if not alike and len(known) == 2 and not is_own:  # a scene of so few frames is an error
        alike = known
    shares = [(found.motion, max(0.0, 1 - apart / _FADED)) for _, found, apart in alike]
    total = max(1.0, sum(share for _, share in shares))
    turns = [(motion, share / total) for motion, share in shares if isinstance(motion, RotationMotion) and share]
    if not turns:
        return none
    return Finding(replace(turns[0][0], rotations=sum(share * motion.rotations for motion, share in turns)))


# ---- flow between neighbours ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Lender:
    """A frame from which another one may borrow areas that it does not show."""

    planes: list[UInt[np.ndarray, "rows columns *bands"]]  # its pixels as stored
    where: FrameMap  # where each pixel of the rectified frame is sampled in it


@dataclass(frozen=True)
class LinkedFrame:
    """A frame and the flow between it and its neighbours."""

    moving: MovingFrame  # the frame, with the camera's motion if known
    links: dict[int, Link]  # -1 and 1 -> the flow to the previous and next frames, if they show the same scene
    # -1 and 1 -> pixels of these frames, if they may be borrowed
    planes: dict[int, list[UInt[np.ndarray, "rows columns *bands"]]]
    timing: Timing  # the clock of the clip
    readout: Readout  # direction in which its stored pixels were read

    def maps(self, undo: ClipUndo) -> tuple[FrameMap | None, list[Lender]]:
        """Returns where each pixel of the rectified frame is sampled, in the frame itself and in possible lenders.

        The first is None if the neighbours are inconclusive.
        """
        if not self.links or not undo.strength:
            return None, []
        motion = motion_field(self.links, self.timing, self.timing.moment(undo.reference))
        if motion.reason:
            return None, []
        own = motion.field.shift(0)
        remainder = (1 - undo.strength) * own  # remaining distortion
        lenders = [
            Lender(planes, self._map(motion.field.shift(side * self.links[side].apart) - remainder))
            for side, planes in self.planes.items()
        ]
        return self._map(own - remainder), lenders

    def _map(self, shift: np.ndarray) -> FrameMap:
        """Converts the shift of every pixel of the small copy to the map of a whole frame."""
        frame = self.moving.frame
        return FrameMap.along(shift, self.readout, frame.height, frame.width, self.moving.view)


def linked(request: ClipRequest, frames: Iterable[MovingFrame], ratio: float) -> Iterator[LinkedFrame]:
    """Yields the frames of a clip linked to their neighbours; three are held at a time."""
    timing = Timing(ratio, request.frame_size[0])
    before: _Copied | None = None
    current: _Copied | None = None
    for moving in frames:
        following = _Copied.of(request, moving)
        if current is not None:
            current.connect(request.clip, following, ratio)
            yield current.with_neighbours(before, following, timing, request.readout)
        before, current = current, following
    if current is not None:
        yield current.with_neighbours(before, None, timing, request.readout)


@dataclass
class _Copied:
    """A frame and the small copy in which flow is computed."""

    moving: MovingFrame
    copy: UInt8[np.ndarray, "rows columns"]  # small and grey, in the readout frame
    planes: list[np.ndarray]  # empty unless pixels are borrowed
    to_next: Link | None = None  # flow to the next frame

    @classmethod
    def of(cls, request: ClipRequest, moving: MovingFrame) -> _Copied:
        clip, borrow = request.clip, request.options.undo.edges == "borrow"
        side = min(copy_side(clip.height, clip.width), _MOST_ROWS)
        # The frame itself may be overwritten before its neighbours are warped.
        planes = [plane.copy() for plane in clip.pixels.arrays(moving.frame)] if borrow else []
        return cls(moving, request.grey(moving.frame, side), planes)

    def connect(self, clip: Clip, following: _Copied, ratio: float) -> None:
        """Computes the flow to the next frame, unless they are not neighbours or show different scenes."""
        apart = clip.since(self.moving.frame, following.moving.frame)
        if apart is None or apart < ratio:
            return
        with suppress(UnshutterError):
            flow_to_next = link(self.copy, following.copy, apart, int(min(self.copy.shape) >= _MOST_ROWS))
            # No common motion means a cut, or very different depths: the latter keep nearly all of the picture in view.
            if not following.moving.cut or flow_to_next.flow.consistent >= _ALMOST_ALL:
                self.to_next = flow_to_next

    def with_neighbours(
        self, before: _Copied | None, after: _Copied | None, timing: Timing, readout: Readout
    ) -> LinkedFrame:
        beside = {-1: (before, before and before.to_next), 1: (after, self.to_next)}
        links = {side: to for side, (frame, to) in beside.items() if frame is not None and to is not None}
        planes = {side: frame.planes for side, (frame, _) in beside.items() if side in links and frame and frame.planes}
        return LinkedFrame(self.moving, links, planes, timing, readout)


_SIDE_DATA = {"A53_CC", "S12M_TIMECODE", "GOP_TIMECODE", "SEI_UNREGISTERED", "DYNAMIC_HDR_PLUS"}
_COARSE = 8  # px between points checked for a crop; its multiples are whole chroma pixels


@dataclass(frozen=True)
class NewFrame:
    """A frame ready for encoding."""

    source: MovingFrame  # the original frame and its motion
    picture: Frame  # its pixels, time and colours; the original frame itself if nothing moved


@dataclass(frozen=True)
class Warper:
    """Renders the rectified frames of a clip."""

    clip: Clip
    undo: ClipUndo  # how motion is undone
    window: Tile | None = None  # the part of each frame to keep; None for all of it
    _scratches: tuple[Scratch, ...] = field(default_factory=lambda: (Scratch(), Scratch(), Scratch()))

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the output frames [px]."""
        w = self.window
        return (self.clip.height, self.clip.width) if w is None else (w.bottom - w.top, w.right - w.left)

    def motion(self, moving: MovingFrame) -> Motion:
        """Returns the part of a frame's motion that is undone, at the reference row."""
        return undone_part(moving.motion, self.undo)

    def __call__(self, frame: MovingFrame | LinkedFrame) -> NewFrame:
        """Returns the frame to encode."""
        return self._by_flow(frame) if isinstance(frame, LinkedFrame) else self.rectified(frame)

    def rectified(self, moving: MovingFrame) -> NewFrame:
        """Rectifies a frame by the camera's motion."""
        motion, frame, view = self.motion(moving), moving.frame, moving.view
        if motion.is_zero and view is None:
            return NewFrame(moving, frame if self.window is None else self._dressed(frame, frame))
        picture = self._warped(frame, FrameMap.of(motion, frame.height, frame.width, view))
        return NewFrame(moving, self._dressed(picture, frame))

    def _by_flow(self, linked: LinkedFrame) -> NewFrame:
        """Rectifies a frame by the flow to its neighbours or, if they are inconclusive, by the camera's motion."""
        moving, frame = linked.moving, linked.moving.frame
        where, lenders = linked.maps(self.undo)
        if where is None:
            return self.rectified(moving)
        picture = self._warped(frame, where)
        if lenders:
            self._borrow(lenders, picture, where)
        return NewFrame(replace(moving, dense=True), self._dressed(picture, frame))

    def _warped(self, frame: Frame, frame_map: FrameMap) -> Frame:
        """Returns the rectified pixels of a frame."""
        pixels, limit = self.clip.pixels, (1 << self.clip.pixels.depth) - 1
        picture = pixels.blank(frame, self.clip.height, self.clip.width)
        full = pixels.is_full_range(frame)
        planes = list(zip(pixels.planes, pixels.arrays(frame), pixels.arrays(picture), strict=True))
        for across, down in dict.fromkeys((plane.across, plane.down) for plane in pixels.planes):
            alike = [each for each in planes if (each[0].across, each[0].down) == (across, down)]
            black = [each.black_full if full else each.black for each, _, _ in alike for _ in range(each.bands)]
            before, after = alike[0][1:]
            if len(alike) > 1:  # one with several bands is warped faster than several planes
                before = cv2.merge([old for _, old, _ in alike])
                after = np.empty_like(before)
            for rows, positions in frame_map.positions(across, down, self._scratches[0]):
                warp_plane(before, positions, after[rows], black if self.undo.edges == "keep" else None, limit)
            if len(alike) > 1:
                for k, (_, _, new) in enumerate(alike):
                    cv2.extractChannel(after, k, new)
        return picture

    def _borrow(self, lenders: list[Lender], picture: Frame, own: FrameMap) -> None:
        """Fills areas that a frame does not show from its neighbours, in the planes of the rectified frame."""
        pixels, limit = self.clip.pixels, (1 << self.clip.pixels.depth) - 1
        for across, down in dict.fromkeys((plane.across, plane.down) for plane in pixels.planes):
            alike = [k for k, plane in enumerate(pixels.planes) if (plane.across, plane.down) == (across, down)]
            out = pixels.arrays(picture)
            size = out[alike[0]].shape[:2]
            bands = [
                each.positions(across, down, scratch)
                for each, scratch in zip((own, *(lender.where for lender in lenders)), self._scratches, strict=False)
            ]
            for (rows, positions), *theirs in zip(*bands, strict=True):
                missing = ~on_plane(positions, *size)
                for lender, (_, there) in zip(lenders, theirs, strict=True):
                    if not missing.any():
                        break
                    has = missing & on_plane(there, *size)
                    for k in alike:
                        borrow_plane(lender.planes[k], there, out[k][rows], has, limit)
                    missing &= ~has

    def _dressed(self, picture: Frame, frame: Frame) -> Frame:
        """Returns the new pixels with the time, colours and side data of the original frame."""
        if self.window is None and _SIDE_DATA & self.clip.side_data.keys():
            of_file(frame).make_writable()
            for new, old in zip(self.clip.pixels.arrays(picture), self.clip.pixels.arrays(frame), strict=True):
                np.copyto(old, new)
            return frame
        return picture if self.window is None else self._cut(picture, self.window)

    def _cut(self, frame: Frame, window: Tile) -> Frame:
        pixels = self.clip.pixels
        picture = pixels.blank(frame, *self.size)
        for plane, old, new in zip(pixels.planes, pixels.arrays(frame), pixels.arrays(picture), strict=True):
            top, left = window.top // plane.down, window.left // plane.across
            np.copyto(new, old[top : top + new.shape[0], left : left + new.shape[1]])
        return picture


def common_window(warper: Warper, frames: Iterable[MovingFrame]) -> Tile | None:
    """Returns the largest rectangle of the clip's shape that all rectified frames cover; None for all of it."""
    clip = warper.clip
    mask = np.ones((clip.height // _COARSE, clip.width // _COARSE), bool)
    for moving in frames:
        motion = warper.motion(moving)
        if motion.is_zero and moving.view is None:
            continue
        frame_map = FrameMap.of(motion, clip.height, clip.width, moving.view)
        last = frame_map.width / _COARSE - 2, frame_map.height / _COARSE - 2  # a margin of one spacing
        for rows, (col, row) in frame_map.positions(_COARSE, _COARSE):
            part = mask[rows]
            inside = (col >= 1) & (col <= last[0]) & (row >= 1) & (row <= last[1])
            part &= inside[: part.shape[0], : part.shape[1]]
    if mask.all():
        return None
    window = EdgePolicy("crop").decide(mask.shape, lambda: valid_window(mask), "frame").window
    return Tile(*(_COARSE * side for side in window))


def side_by_side(warper: Warper, frames: Iterable[MovingFrame | LinkedFrame], threads: int) -> Generator[NewFrame]:
    """Yields the frames to encode, in order, several warped in parallel."""
    running: deque[Future[NewFrame]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        try:
            for frame in frames:
                running.append(pool.submit(warper, frame))
                if len(running) > threads:
                    yield running.popleft().result()
            while running:
                yield running.popleft().result()
        finally:
            for future in running:
                future.cancel()
