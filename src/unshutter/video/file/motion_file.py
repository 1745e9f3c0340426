"""Motion files of clips: JSON, format ``unshutter-clip-motion/1`` (docs/reference), one frame per line."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.frames.frame_motion import Step
from unshutter.motion import RotationMotion, RowMotion
from unshutter.motion.finding import Finding
from unshutter.motion.grid import Tile
from unshutter.motion.lens import Lens
from unshutter.motion.motion_file import reason_of
from unshutter.orientation import ScanDirection
from unshutter.readout_time import ReadoutTime
from unshutter.reasons import JsonObject
from unshutter.storage.files import read_text
from unshutter.version import __version__
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.row_samples import GYRO_ROWS, ROWS, STRIDE, RowSamples

FORMAT = "unshutter-clip-motion/1"
_SAVED = tuple((rows - 1) // STRIDE + 1 for rows in (ROWS, GYRO_ROWS))  # numbers of rotations per frame in a file


@dataclass(frozen=True)
class ClipMotion:
    """The content of a motion file."""

    ratio: float  # readout time in frame intervals of the camera
    scan_direction: ScanDirection  # direction in which the stored pixels were read
    height: int  # of the stored frames [px]
    width: int
    times_s: np.ndarray  # [N] presentation time of each frame [s], increasing
    motions: list[Finding]  # [N] motions of small pictures (``ROWS``), first row as the reference
    cuts: list[bool]  # [N] whether a frame shows another scene than the previous one
    steps: list[Step | None]  # [N] rotation of the camera since the previous frame; None if unknown
    lens: Lens | None = None  # the camera's lens, if it bends straight lines
    interval_s: float | None = None  # that interval [s]; None if the file lacks it
    picture: Tile | None = None  # the part of the frames between bars; None: all of it
    slowed: float = 1.0  # how many times slower the file shows what the camera took

    def at(self, time_s: float) -> tuple[Finding, bool, Step | None]:
        """Returns the motion of the frame shown at a time, whether it follows a cut, and the rotation leading to it."""
        k = int(np.abs(self.times_s - time_s).argmin())
        if abs(self.times_s[k] - time_s) > 0.001:
            raise UnshutterError(f"the motion file has no frame at {time_s:.3f} s: it belongs to another clip")
        return self.motions[k], self.cuts[k], self.steps[k]


class MotionWriter:
    """Writes a motion file frame by frame."""

    def __init__(self, stream: TextIO, request: ClipRequest, time: ReadoutTime):
        self._stream = stream
        self._separator = ""
        clip = request.clip
        ratio = time.ratio(clip.camera_interval_s)
        head = {
            "format": FORMAT,
            "unshutter": __version__,
            "height": clip.height,
            "width": clip.width,
            "readout": str(request.scan_direction),
            "frame_interval_s": clip.camera_interval_s,
            "readout_ratio": ratio.value,
            "readout_ratio_sd": ratio.error or None,
            "found_by": ratio.source,
            **({} if clip.clock.slowed == 1 else {"slowed": clip.clock.slowed}),
            **({} if clip.picture is None else {"picture": clip.picture._asdict()}),
            **({} if request.lens is None else {"lens": request.lens.as_json()}),
        }
        stream.write(json.dumps(head)[:-1] + ', "frames": [\n')

    def add(self, time_s: float, found: Finding, cut: bool, step: Step | None) -> None:
        """Writes the next frame; for the arguments, see :class:`ClipMotion`."""
        motion = found.motion
        record: JsonObject = {"time_s": time_s, "cut": cut}
        if isinstance(motion, RotationMotion):
            kept = RowSamples.of(motion)
            record |= {"focal": kept.focal_heights, "rotations_rad": kept.rotations.tolist()}
            record |= {} if kept.parallax is None else {"parallax": kept.parallax.tolist()}
        else:
            reason = found.reason
            record |= {"rotations_rad": None, "reason": "" if reason is None else str(reason)}
            record |= {} if reason is None else {"declined": reason.as_json()}
        if step is not None:
            focal = step.focal_heights
            record["step"] = {"turn_rad": step.rotation.tolist(), "focal": focal if focal > 0 else None}
        self._stream.write(self._separator + json.dumps(record))
        self._separator = ",\n"

    def end(self) -> None:
        """Completes the file after the last frame."""
        self._stream.write("\n]}\n")


def load_clip_motion(path: Path) -> ClipMotion:
    """Reads a motion file.

    Raises:
        UnshutterError: the file cannot be read, or is not a motion file.
    """
    try:
        data = json.loads(read_text(path, 1 << 30))
    except OSError as error:
        raise UnshutterError(f"cannot read motion file {path}: {error.strerror}") from None
    except (ValueError, RecursionError):
        raise UnshutterError(f"{path}: not a motion file of a clip") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise UnshutterError(f'{path}: not a motion file of a clip: its "format" is not "{FORMAT}"')
    try:
        return _parsed(data)
    except (KeyError, TypeError, ValueError, OverflowError, UnshutterError) as error:
        raise UnshutterError(f"{path}: not a usable motion file: {error}") from None


def _parsed(data: JsonObject) -> ClipMotion:
    scan_direction = ScanDirection.parse(data["readout"])
    height = int(data["height"])
    width = int(data["width"])
    ratio = float(data["readout_ratio"])
    interval_s = data.get("frame_interval_s")
    if not 0 < ratio <= 1 or not 0 < height < 1 << 20 or not 0 < width < 1 << 20:
        raise ValueError("numbers out of range")
    picture = Tile(**{side: int(data["picture"][side]) for side in Tile._fields}) if "picture" in data else None
    inside = picture or Tile(0, height, 0, width)
    if not 0 <= inside.top < inside.bottom <= height or not 0 <= inside.left < inside.right <= width:
        raise ValueError("a picture that is not in its frame")
    size = inside.bottom - inside.top, inside.right - inside.left
    frame_height, frame_width = scan_direction.frame_size(*size)
    small = max(1, round(frame_width * ROWS / frame_height))
    lens = Lens.of_json(data["lens"]) if "lens" in data else None
    motions: list[Finding] = []
    for frame in data["frames"]:
        if frame["rotations_rad"] is None:
            motions.append(Finding(RowMotion.zero(ROWS, small, scan_direction=scan_direction), reason=reason_of(frame)))
            continue
        samples = np.array(frame["rotations_rad"], np.float64)
        if samples.shape not in [(saved, 3) for saved in _SAVED]:
            raise ValueError(f"rotations of shape {samples.shape}")
        rows = (len(samples) - 1) * STRIDE + 1
        columns = max(1, round(frame_width * rows / frame_height))
        parallax = np.array(frame["parallax"], np.float64) if "parallax" in frame else None
        kept = RowSamples(samples, float(frame["focal"]), columns, scan_direction, parallax)
        motions.append(Finding(kept.motion(lens)))
    times = np.array([float(frame["time_s"]) for frame in data["frames"]])
    if not len(times) or not np.isfinite(times).all():
        raise ValueError("no frames, or times that are not numbers")
    cuts = [bool(frame["cut"]) for frame in data["frames"]]
    steps = [_step(frame) for frame in data["frames"]]
    interval_s = None if interval_s is None else float(interval_s)
    slowed = float(data.get("slowed", 1.0))
    if not 0 < slowed < 1e4:
        raise ValueError("numbers out of range")
    clip = scan_direction, height, width, times, motions, cuts, steps, lens, interval_s, picture
    return ClipMotion(ratio, *clip, slowed=slowed)


def _step(frame: JsonObject) -> Step | None:
    """Returns the camera's rotation since the previous frame; files of earlier versions lack it."""
    record = frame.get("step")
    if record is None:
        return None
    rotation = np.array(record["turn_rad"], np.float64)
    focal = record["focal"]
    if rotation.shape != (3,) or not np.isfinite(rotation).all():
        raise ValueError("a turn that is not three numbers")
    return Step(rotation, np.nan if focal is None else float(focal))
