"""The camera's rotations within each picture of a model, and between pictures, from motion files."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from unshutter.errors import MissingFileError, UnshutterError, UsageError
from unshutter.frames.frame_motion import AT_REST
from unshutter.motion import RotationMotion
from unshutter.motion.finding import Finding
from unshutter.motion.rotations import rotation_matrix
from unshutter.motion.shapes import Float64
from unshutter.orientation import ScanDirection
from unshutter.reasons import Reason
from unshutter.run.inputs import motion_name
from unshutter.video.file.motion_file import load_clip_motion

_NUMBER = re.compile(r"(\d+)\D*$")
_REPEATING = 1.02  # ratio of the camera's interval to the file's from which frames are repeated
_LONGEST_S = 1.0  # between pictures from whose poses a speed is taken


@dataclass(frozen=True)
class Clock:
    """The timing of a video's frames."""

    interval_s: float  # time from one frame to the next [s]
    readout_s: float  # time from a frame's first line to the end of its last [s]


@dataclass(frozen=True)
class PictureCamera:
    """A picture's size and focal length, from the model."""

    height: int  # of the stored pictures [px]
    width: int
    focal_px: float


class FrameRotations(ABC):
    """The camera's rotations within and between the frames of a video, which are counted from 0."""

    readout_s: float
    note: str = ""  # what is to be said of the frames, in a line

    @abstractmethod
    def check(self, camera: PictureCamera) -> None:
        """Raises UnshutterError if pictures of this size are not the frames whose motion is known."""

    @abstractmethod
    def motion(self, name: str, number: int) -> Finding:
        """Returns the motion of a picture, a frame of the video; of any size of the same shape."""

    @abstractmethod
    def start_s(self, number: int) -> float:
        """Returns when the first line of a frame was read [s]."""

    @abstractmethod
    def rotation_between(self, first: int, last: int, camera: PictureCamera) -> Float64[np.ndarray, "3 3"] | None:
        """Returns the rotation from the middle line of a frame to that of a later one; None if it is unknown."""

    def steps(self, camera: PictureCamera) -> Float64[np.ndarray, "frames 3 3"] | None:
        """Returns the rotation from each frame's previous one, NaN where it is unknown; None if no frame has one."""
        return None

    @abstractmethod
    def joined(self, first: int, last: int) -> bool:
        """Whether two frames are near in time, without a cut between them."""


class ClipRotations(FrameRotations):
    """The motion file of a clip (``unshutter video --save-motion``)."""

    def __init__(self, file: Path):
        self._file = file
        self._clip = load_clip_motion(file)
        times = self._clip.times_s
        shown_s = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        interval_s = shown_s if self._clip.interval_s is None else self._clip.interval_s * self._clip.slowed
        self.readout_s = self._clip.ratio * interval_s
        if interval_s > _REPEATING * shown_s > 0:
            rates = f"{1 / interval_s:.4g} of {1 / shown_s:.4g} frames a second are the camera's"
            self.note = (
                f"{rates}: a picture that repeats another has a wrong pose (ffmpeg -vf mpdecimate leaves it out)"
            )
        self._steps: tuple[PictureCamera, np.ndarray] | None = None  # those for a camera

    def check(self, camera: PictureCamera) -> None:
        """See FrameRotations: bars round the picture are not part of it."""
        inside = self._clip.picture
        if inside is not None and (camera.height, camera.width) == (self._clip.height, self._clip.width):
            width, height = inside.right - inside.left, inside.bottom - inside.top
            crop = f"crop={width}:{height}:{inside.left}:{inside.top}"
            raise UnshutterError(
                f"the pictures of the model have bars, which {{file}} leaves out: cut them off (ffmpeg -vf {crop})",
                file=self._file,
            )

    def motion(self, name: str, number: int) -> Finding:
        """See FrameRotations."""
        if not 0 <= number < len(self._clip.motions):
            frames = f"{len(self._clip.motions)} frames, and {name} would be number {number}, counted from 0"
            raise UnshutterError(
                f"{{file}} has {frames}: extract every frame, and see {{--first-number}}", file=self._file
            )
        return self._clip.motions[number]

    def start_s(self, number: int) -> float:
        """See FrameRotations."""
        return float(self._clip.times_s[number])

    def rotation_between(self, first: int, last: int, camera: PictureCamera) -> Float64[np.ndarray, "3 3"] | None:
        """See FrameRotations."""
        rotated = np.eye(3)
        for step in self.steps(camera)[first + 1 : last + 1]:
            rotated = step @ rotated
        return None if np.isnan(rotated).any() else rotated

    def steps(self, camera: PictureCamera) -> Float64[np.ndarray, "frames 3 3"]:
        """See FrameRotations."""
        if self._steps is None or self._steps[0] != camera:
            scan_direction = self._clip.scan_direction
            rows, _ = scan_direction.frame_size(camera.height, camera.width)
            steps = np.full((len(self._clip.steps), 3, 3), np.nan)
            for number, step in enumerate(self._clip.steps):
                if step is not None:
                    moved = 1.0 if np.isnan(step.focal_heights) else step.focal_heights * rows / camera.focal_px
                    steps[number] = _in_picture(step.rotation, moved, scan_direction)
            self._steps = camera, steps
        return self._steps[1]

    def joined(self, first: int, last: int) -> bool:
        """See FrameRotations."""
        is_near = self.start_s(last) - self.start_s(first) <= _LONGEST_S
        return is_near and not any(self._clip.cuts[first + 1 : last + 1])


class PictureRotations(FrameRotations):
    """A folder with the motion file of each picture (``unshutter rectify --sequence --save-motion``)."""

    def __init__(self, folder: Path, clock: Clock):
        self._folder = folder
        self._clock = clock
        self.readout_s = clock.readout_s

    def check(self, camera: PictureCamera) -> None:
        """See FrameRotations: each picture has a motion of its own."""

    def motion(self, name: str, number: int) -> Finding:
        """See FrameRotations; pictures without a file have no motion."""
        path = PurePosixPath(name)
        for file in (motion_name(path.stem), motion_name(path.name)):
            target = self._folder / path.parent / file
            if target.is_file():
                return Finding.load(target)
        raise MissingFileError(f"no motion file {{file}} for {name}", file=self._folder / path.with_suffix(".json"))

    def start_s(self, number: int) -> float:
        """See FrameRotations."""
        return number * self._clock.interval_s

    def rotation_between(self, first: int, last: int, camera: PictureCamera) -> Float64[np.ndarray, "3 3"] | None:
        """See FrameRotations."""
        return None

    def joined(self, first: int, last: int) -> bool:
        """See FrameRotations."""
        return (last - first) * self._clock.interval_s <= _LONGEST_S


def rotations_from(source: Path, clock: Clock | None) -> FrameRotations:
    """Opens the motion file of a clip, or the motion files in a folder, whose pictures follow a clock.

    Raises:
        UnshutterError: there are none; UsageError: a clock is missing, or not needed.
    """
    if source.is_dir():
        if clock is None:
            raise UsageError("motion files of pictures do not say when: give {--readout-ratio} and {--fps}")
        if not any(source.rglob("*.json")):
            raise UnshutterError("{folder} has no motion files (.json)", folder=source)
        return PictureRotations(source, clock)
    if clock is not None:
        raise UsageError("the motion file of a clip says when: leave out {--readout-ratio} and {--fps}")
    return ClipRotations(source)


def series_and_number(name: str) -> tuple[str, int]:
    """Returns a picture's name without the last number in it, which pictures of one camera share, and that number.

    Raises:
        UnshutterError: there is none.

    Examples:
        >>> series_and_number("film/left_00012.png")
        ('film/left_#.png', 12)
    """
    path = PurePosixPath(name)
    found = _NUMBER.search(path.stem)
    if found is None:
        raise UnshutterError(f"{name} has no number in its name: name frames by their number, as FFmpeg's %05d does")
    name = f"{path.stem[: found.start()]}#{found[0][len(found[1]) :]}{path.suffix}"
    return str(path.parent / name), int(found[1])


def rotations_in_picture(found: Finding, camera: PictureCamera) -> Float64[np.ndarray, "lines 3 3"] | Reason:
    """Returns the camera's rotation from the first line to each line, in the order in which they were read.

    A direction d in the camera's axes at the first line is R d at another one, with the axes of the stored picture.

    Returns:
        The rotations, or why they are unknown.

    Raises:
        UnshutterError: the motion is that of a picture of another shape.
    """
    motion = found.motion
    lines, across = motion.scan_direction.frame_size(camera.height, camera.width)
    if isinstance(motion, RotationMotion):
        fitted = motion.resized(lines, across).rereferenced("first")
        return _in_picture(fitted.rotations, fitted.focal_px / camera.focal_px, motion.scan_direction)
    if motion.is_zero and (found.reason is None or found.reason.code in AT_REST):
        return np.tile(np.eye(3), (lines, 1, 1))
    return found.reason or Reason.stated("its motion is not a rotation about three axes")


def _in_picture(
    rotations: Float64[np.ndarray, "*at 3"], moved: float, scan_direction: ScanDirection
) -> Float64[np.ndarray, "*at 3 3"]:
    """Converts rotations from the axes of the readout frame to those of the stored picture.

    Args:
        moved: focal length that the turns were found with, as a share of the model's; where it was wrong, turns about x
            and y were, too, but not how far they move the picture.
    """
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    to_frame = np.linalg.matrix_power(quarter, scan_direction.quarter_turns)
    return to_frame.T @ rotation_matrix(rotations * np.array([moved, moved, 1.0])) @ to_frame
