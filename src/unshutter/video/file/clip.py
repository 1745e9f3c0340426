"""A clip as all steps see it, a file or frames that the caller decodes; and the user's request."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from unshutter.motion.grid import Tile
from unshutter.motion.lens import Lens
from unshutter.options.clip_options import RectifyClip
from unshutter.orientation import ScanDirection
from unshutter.progress import SILENT, ClipObserver
from unshutter.video.file.camera_clock import CameraClock
from unshutter.video.file.camera_tags import CameraTags
from unshutter.video.file.packets import Packets
from unshutter.video.file.pixels import Frame, PixelFormat, small_grey
from unshutter.video.file.stages import Stage, Steps, Work

if TYPE_CHECKING:
    from unshutter.motion.shapes import UInt, UInt8


_WHOLE = 0.03  # of a frame interval: times this close to even ones are taken as even


@dataclass(frozen=True, kw_only=True)
class Clip(ABC):
    """The frames of a clip, and what is known before any is examined."""

    path: str  # path of the file; for messages only if the frames come from the caller
    pixels: PixelFormat
    height: int  # rows of the stored frames [px]
    width: int  # their columns [px]
    interval_s: float  # the usual time from one frame to the next, as the file shows them [s]
    frames: int  # number of frames, or of those that can be examined; 0 if unknown
    duration_s: float  # duration [s]; 0 if unknown
    begin_s: float = 0.0  # time of the frames' clock at which the clip begins [s]
    picture: Tile | None = None  # the part of the stored frames between bars, which the camera saw; None: all of it
    clock: CameraClock = field(default_factory=CameraClock)  # the camera's, as far as it differs from the file's
    # tags of the container and of the video stream; the latter take precedence
    tags: dict[str, str] = field(default_factory=dict)
    camera: CameraTags = field(default_factory=CameraTags)  # what the camera states in its own way
    # side data of the first frame, by FFmpeg's names; not read from later frames, since PyAV would then never free it
    side_data: dict[str, bytes] = field(default_factory=dict)
    data_tracks: tuple[str, ...] = ()  # names of its tracks of data
    may_have_log: bool = field(default=False, repr=False)  # whether there may be a gyro log in the file

    @abstractmethod
    def frames_between(self, start: float | None = None, end: float | None = None) -> Generator[Frame]:
        """Yields the frames between two times [s] in presentation order; None means no limit."""

    def packets(self) -> Packets | None:
        """Returns the packets of its frames; None if there are none, or to know them takes too long."""
        return None

    @property
    def picture_size(self) -> tuple[int, int]:
        """Height and width of what the camera saw of the stored frames [px]."""
        inside = self.picture
        return (self.height, self.width) if inside is None else (inside.bottom - inside.top, inside.right - inside.left)

    def planes(self, frame: Frame) -> list[UInt[np.ndarray, "rows columns *bands"]]:
        """Returns the planes of what the camera saw of a frame: views of its memory, valid as long as it exists."""
        planes = self.pixels.arrays(frame)
        inside = self.picture
        if inside is None:
            return planes
        return [
            plane[inside.top // kind.down : -(-inside.bottom // kind.down), inside.left // kind.across :][
                :, : -(-(inside.right - inside.left) // kind.across)
            ]
            for kind, plane in zip(self.pixels.planes, planes, strict=True)
        ]

    @property
    def frame_bytes(self) -> float:
        """Memory size of a decoded frame [bytes]."""
        size = sum(plane.bands / plane.across / plane.down for plane in self.pixels.planes)
        return size * self.height * self.width * (1 if self.pixels.depth == 8 else 2)

    def most_ahead(self, frames: int) -> int:
        """Returns how many frames may wait between two steps: the given number, or fewer if they are large."""
        return min(frames, max(1, int(25_000_000 / self.frame_bytes)))

    @property
    def camera_interval_s(self) -> float:
        """The usual time from one frame to the next on the camera's clock [s]."""
        return self.clock.interval_s(self.interval_s)

    @property
    def camera_step_s(self) -> float:
        """The file's usual time from one frame of the camera to the next that the file holds [s]."""
        return self.interval_s / min(float(self.clock.share), 1.0)

    def camera_time(self, frame: Frame) -> float:
        """Returns the time of a frame on the camera's clock [s]."""
        return (frame.time or 0.0) / self.clock.slowed

    def since(self, before: Frame | None, frame: Frame) -> float | None:
        """Returns the time from one frame to the next in intervals of the camera, or None if they are not neighbours.

        Times that hardly increase are wrong: such frames are taken as one interval apart.
        """
        if before is None or before.time is None or frame.time is None:
            return 1.0
        tick = float(frame.time_base or 0) / self.interval_s
        gap = (frame.time - before.time) / self.interval_s
        if abs(gap - round(gap)) <= max(_WHOLE, 1.01 * tick) and round(gap) > 0:
            gap = float(round(gap))
        if gap < 0.05:  # frame intervals: no camera takes frames so fast after one another
            return 1.0
        if self.clock.share != 1:
            gap = self.clock.since(gap, round((frame.time - self.begin_s) / self.interval_s))
        return gap if 0.2 < gap <= 4 else None  # intervals; frames farther apart are not neighbours


@dataclass(frozen=True)
class ClipRequest:
    """A clip, and what the user wants from it."""

    clip: Clip
    options: RectifyClip
    scan_direction: ScanDirection  # direction in which the stored pixels were read
    work: Work  # counts what is done
    lens: Lens | None = None  # the camera's lens, if it is known to bend straight lines

    @classmethod
    def of(cls, clip: Clip, options: RectifyClip, observer: ClipObserver = SILENT) -> ClipRequest:
        """Returns the request of a clip whose readout direction is that of the options.

        These say start and end in seconds of the clip; the request has them on the clock of the frames.
        """
        options = options.on_clock(clip.begin_s)
        return cls(
            clip, options, ScanDirection.parse(options.shutter.readout), Work(observer, clip.height * clip.width / 1e6)
        )

    @property
    def frame_size(self) -> tuple[int, int]:
        """Height and width of the readout frame [px]."""
        return self.scan_direction.frame_size(*self.clip.picture_size)

    @property
    def focal(self) -> float | None:
        """Focal length [heights of the readout frame], if it is known."""
        stated = self.options.shutter.focal_px
        return self.lens.focal if self.lens is not None else stated and stated / self.frame_size[0]

    @property
    def span(self) -> tuple[float, float]:
        """Begin and end of the selected part [s], on the clock of the frames."""
        return self.options.span(self.clip.begin_s, self.clip.duration_s)

    def grey(self, frame: Frame, side: int) -> UInt8[np.ndarray, "rows columns"]:
        """Returns a small grey copy of a frame, as it was read out, with a short side of about ``side`` px."""
        small = small_grey(self.clip.planes(frame)[0], side, self.clip.pixels.depth)
        return np.ascontiguousarray(self.scan_direction.to_scan_frame(small))

    @property
    def frames(self) -> int:
        """Number of frames of the selected part, as the file states it; at least 2."""
        begin, end = self.span
        selected = self.options.start is not None or self.options.end is not None
        if self.clip.frames and not selected:
            return max(self.clip.frames, 2)
        last = self.clip.begin_s + self.clip.duration_s if self.clip.duration_s else end
        return max(round((min(end, last) - begin) / self.clip.interval_s), 2)

    def steps(self, what: str, stage: Stage | None = None) -> Steps:
        """Returns a counter for the frames of the selected part, and for as many items of a stage."""
        return Steps(self.work, what, self.frames, stage)
