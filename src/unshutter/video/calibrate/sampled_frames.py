"""What parts of a clip show: tracks of corners from each frame to the next, decoded once, kept, and shared.

The lens, a gyro log's alignment, the readout time, and what undoing the motion gains are all found in these tracks. A
pair of frames takes some kilobytes, so that those of all parts are kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from unshutter.frames.self_calibration import GreyFrame
from unshutter.frames.tracks import Background, Tracks, background, follow
from unshutter.motion.lens import Lens
from unshutter.video.calibrate.readout_regression import PairMotion, Regression, Run, regression, runs_of
from unshutter.video.file.ahead import ahead
from unshutter.video.file.camera_clock import Changes
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.stages import Stage, Steps

COPY_SIDE = 270  # px, short side of the copies in which corners are tracked


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """A frame, and tracks of corners from the previous one."""

    time_s: float  # on the camera's clock
    since: float | None = None  # time since the previous frame [intervals of the camera]; None: that is no neighbour
    tracks: Tracks | None = None  # all tracks; None for the first frame of a part
    before: Background | None = None  # tracks between the two frames before that move with the camera, if known
    changed_px: float | None = None  # apparent displacement since the previous frame (:class:`Changes`)

    @cached_property
    def background(self) -> Background | None:
        """The tracks that move with the camera."""
        return None if self.tracks is None else background(self.tracks, before=self.before)


@dataclass(frozen=True, eq=False)
class SampledFrames:
    """The tracked frames of some parts of a clip, in order."""

    parts: Sequence[Sequence[TrackedFrame]] = ()  # not empty themselves
    is_whole: bool = False  # whether it is one part, of all frames that the user selected
    has_liveliest: bool = False  # whether the part in which most moves is among them (first_look.py)

    @property
    def frames(self) -> Iterator[TrackedFrame]:
        """All frames."""
        return (frame for part in self.parts for frame in part)

    @cached_property
    def by_time(self) -> dict[float, TrackedFrame]:
        """The frames with tracks from the one before, by their time [s]."""
        return {frame.time_s: frame for frame in self.frames if frame.tracks is not None}

    @cached_property
    def motions(self) -> list[list[PairMotion | None]]:
        """Motion of the picture to each frame of each part but its first, through a lens that keeps lines straight."""
        return self._motions(None)

    def _motions(self, focal: float | None) -> list[list[PairMotion | None]]:
        found = []
        for part in self.parts:
            planes = [frame.background for frame in part[1:]]
            tracks = [each.tracks for each in planes if each is not None and each.joined]
            motions = iter(PairMotion.through_lens(tracks, focal))
            found.append([next(motions) if each is not None and each.joined else None for each in planes])
        return found

    @cached_property
    def pair_runs(self) -> list[Run]:
        """The pairs of consecutive frames whose motion is known."""
        return self._pair_runs(self.motions)

    def _pair_runs(self, found: Sequence[Sequence[PairMotion | None]]) -> list[Run]:
        runs: list[Run] = []
        for part, motions in zip(self.parts, found, strict=True):
            tracks = next((frame.tracks for frame in part if frame.tracks is not None), None)
            if tracks is not None:
                pairs = zip(motions, (frame.since for frame in part[1:]), strict=True)
                runs += runs_of(pairs, tracks.height / tracks.width)
        return runs

    @cached_property
    def regression(self) -> Regression | None:
        """The readout ratio that the regression of all frames shows; None if they are too few.

        The focal length is taken for a very long one, which makes the ratio up to a sixth too large.
        """
        return regression(self.pair_runs)

    def regression_with_focal(self, focal: float) -> Regression | None:
        """Returns the same with a focal length [heights of the frame]."""
        return regression(self._pair_runs(self._motions(focal)))

    def px_of(self, rows: int) -> float | None:
        """Returns how many px of a clip with these rows a tracked copy's px is; None if nothing was tracked."""
        tracks = next((frame.tracks for frame in self.frames if frame.tracks is not None), None)
        return None if tracks is None else rows / tracks.height

    def through(self, lens: Lens | None) -> SampledFrames:
        """Returns the frames as seen through a lens that bends straight lines; unchanged without a lens."""
        if lens is None:
            return self
        seen = [
            [replace(each, tracks=each.tracks and replace(each.tracks, lens=lens)) for each in part]
            for part in self.parts
        ]
        return replace(self, parts=seen)

    def with_parts(self, other: SampledFrames) -> SampledFrames:
        """Returns these frames together with other parts of the clip."""
        return SampledFrames(sorted([*self.parts, *other.parts], key=lambda part: part[0].time_s))

    def runs(self, most: int, frames: int, skipped: int = 0) -> list[Sequence[TrackedFrame]]:
        """Returns series of consecutive frames that are spread evenly over the clip.

        Args:
            most: number of series; fewer if there are not as many frames, or parts.
            frames: length of each.
            skipped: number of frames at the beginning of the clip to be left out, if any.
        """
        if len(self.parts) == 1:
            (part,) = self.parts
            many = min(most, max(len(part) - skipped, 0) // frames)
            return [part[k : k + frames] for k in np.linspace(skipped, len(part) - frames, many).astype(int)]
        parts = self.parts[1 if skipped else 0 :]
        chosen = np.unique(np.linspace(0, len(parts) - 1, min(most, len(parts))).round().astype(int))
        return [parts[k][:frames] for k in chosen]


def sample_frames(
    request: ClipRequest,
    parts_s: Sequence[tuple[float | None, float | None]],
    steps: Steps | None = None,
    stage: Stage = Stage.SURVEY,
    is_followed: bool = True,
    known: Mapping[float, TrackedFrame] | None = None,
) -> SampledFrames:
    """Decodes parts of a clip, and tracks corners in them.

    Args:
        parts_s: begin and end of each part [s], in order and apart; None means no limit.
        steps: counts the frames.
        stage: as what they are counted.
        is_followed: whether corners are tracked.
        known: frames whose corners were tracked earlier, by their time [s].
    """
    known = known or {}
    parts = []
    for start, end in parts_s:
        part = []
        before = None
        grey_before = None
        plane_before = None
        changes = Changes(request.clip.clock)
        for frame in ahead(request.clip.frames_between(start, end), request.clip.most_ahead(3)):
            grey = request.grey(frame, COPY_SIDE)
            if changes.is_repeated(grey):
                continue
            tracked = TrackedFrame(request.clip.camera_time(frame))
            if grey_before is not None:
                since = request.clip.since(before, frame)
                earlier = known.get(tracked.time_s)
                tracks = follow(grey_before, grey) if earlier is None and is_followed else None
                tracked = earlier or TrackedFrame(tracked.time_s, since, tracks, plane_before, changes.px)
            part.append(tracked)
            request.work.advance(stage)
            before = frame
            grey_before = grey
            plane_before = tracked.background
            if steps is not None:
                steps.advance()
        parts.append(part)
    is_whole = list(parts_s) == [(request.options.start, request.options.end)]
    return SampledFrames([part for part in parts if part], is_whole)


def tracked_copies(request: ClipRequest, frames: Sequence[TrackedFrame]) -> Iterator[GreyFrame | None]:
    """Yields what the motion of consecutive frames is estimated from, and None where frames are missing."""
    nothing = np.zeros((0, 0), np.uint8)
    for number, frame in enumerate(frames):
        if number and frame.since is None:
            yield None
        after = 1.0 if frame.since is None else frame.since
        followed = (frame.tracks, frame.background) if number else (None, None)
        yield GreyFrame(*request.frame_size, nothing, after, 0.0, frame.time_s, *followed)
