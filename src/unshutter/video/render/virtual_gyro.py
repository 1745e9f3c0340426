"""A virtual gyro log: the camera's rotation rate as the frames of a clip show it, in Gyroflow's text format (.gcsv).

Rates are about the camera's axes in the stored pixels: right, down and forward. Gyroflow's are up, left and backward,
as the log states by its ``orientation``. At the time at which the clip shows a frame, its middle row was exposed.

The log begins with the clip and has no gaps: telemetry-parser calls the time of the first sample 0, and Gyroflow takes
samples as even. Within frames, rates are those by which they are straightened; between them, the camera turned as its
path says. Where the path is unknown, the rate is 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from unshutter.frames.frame_motion import AT_REST
from unshutter.motion import RotationMotion
from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.motion.shapes import Float64
from unshutter.orientation import ScanDirection
from unshutter.readout_time import ReadoutTime
from unshutter.reasons import Code, JsonObject, Reason
from unshutter.storage.files import written_whole
from unshutter.version import __version__
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.row_samples import STRIDE
from unshutter.video.render.stabilisation import CameraPath

_HZ = 1000  # samples per second
_BETWEEN_S = 0.002  # s, between frames, in which the camera may turn otherwise than in them
_UNIT = 1e-6  # rad/s: rates are written as whole numbers of it
_DIRECTIONS = (  # in the order of Gyroflow's numbers
    ScanDirection.TOP_TO_BOTTOM,
    ScanDirection.BOTTOM_TO_TOP,
    ScanDirection.LEFT_TO_RIGHT,
    ScanDirection.RIGHT_TO_LEFT,
)
_QUARTER_TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])  # of a vector, clockwise as it is seen in the picture


@dataclass(frozen=True)
class VirtualGyro:
    """What became of a virtual gyro log.

    Attributes:
        unknown: number of frames before which the camera's rotation is unknown, and its rate taken as 0.
        reason: why no log was written; None if one was.
    """

    unknown: int = 0
    reason: Reason | None = None

    def as_json(self) -> JsonObject:
        """Returns the record for a log of runs."""
        if self.reason is not None:
            return {"written": False, "declined": self.reason.as_json()}
        return {"written": True, "frames_unknown": self.unknown}


def write_virtual_gyro(
    file: Path, path: CameraPath, request: ClipRequest, time: ReadoutTime, overwrite: bool
) -> VirtualGyro:
    """Writes the rotation rate of a camera along its path, unless its frames do not show it.

    Args:
        time: readout time of a frame.

    Raises:
        UnshutterError: the file cannot be written.
    """
    clip = request.clip
    if clip.clock.repeats:
        return VirtualGyro(reason=Reason(Code.FRAMES_REPEAT))
    if not any(step is not None for step in path.middle_steps):
        return VirtualGyro(reason=Reason(Code.FRAMES_DISAGREE))
    interval_s = clip.camera_interval_s
    readout_s = time.ratio(interval_s).value * interval_s
    taken_s = (np.array(path.times_s) - clip.begin_s) / clip.clock.slowed
    number, rates = _sampled(path, taken_s, readout_s, interval_s)
    back = np.linalg.matrix_power(_QUARTER_TURN, request.scan_direction.quarter_turns)
    whole = np.rint(rates @ back.T / _UNIT).astype(np.int64)
    focals = [each for each in path.focals if each > 0]
    head = {
        "version": 1.3,
        "id": "rates_from_frames",
        "orientation": "yxz",
        "vendor": "unshutter",
        "fwversion": __version__,
        "frame_readout_time": f"{1000 * readout_s:.3f}",
        "frame_readout_direction": _DIRECTIONS.index(request.scan_direction),
        **({"lens_info": f"focal length {np.median(focals) * request.frame_size[0]:.0f} px"} if focals else {}),
        "tscale": 1 / _HZ,
        "gscale": f"{_UNIT:f}",
    }
    lines = ["GYROFLOW IMU LOG", *(f"{key},{value}" for key, value in head.items()), "t,gx,gy,gz"]
    with written_whole(file, overwrite) as part, part.open("w", encoding="ascii", newline="\n") as stream:
        stream.writelines(f"{line}\n" for line in lines)
        np.savetxt(stream, np.column_stack([number, whole]), "%d", delimiter=",")
    return VirtualGyro(sum(step is None for step in path.middle_steps[1:]))


def _sampled(
    path: CameraPath, taken_s: Float64[np.ndarray, "frames"], readout_s: float, interval_s: float
) -> tuple[np.ndarray, Float64[np.ndarray, "samples 3"]]:
    """Returns numbers of samples, and the camera's rates about the axes of the readout frame [rad/s]."""
    times, rates = _within_frames(path, taken_s, readout_s)
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum((rates[1:] + rates[:-1]) / 2 * np.diff(times)[:, None], 0)])
    missing = np.zeros((len(path), 3))  # of the rotation since the previous frame
    for k, ((begin_s, end_s), step) in enumerate(zip(pairwise(taken_s), path.middle_steps[1:], strict=True), 1):
        if step is not None and end_s > begin_s:
            missing[k] = -step.rotation - (_at(end_s, times, turned) - _at(begin_s, times, turned))
    number = np.arange(np.ceil((taken_s[-1] + interval_s) * _HZ) + 1)
    ends = np.append(number - 0.5, number[-1] + 0.5) / _HZ
    edge_s = min(readout_s, max(interval_s - _BETWEEN_S, interval_s / 2)) / 2
    edges = np.maximum.accumulate((taken_s[:, None] + [-edge_s, edge_s]).ravel())
    between = np.diff(_at(ends, edges, np.repeat(np.cumsum(missing, axis=0), 2, axis=0)), axis=0) * _HZ
    known = number / _HZ > taken_s[0] - interval_s / 2  # the part before --start is unknown
    return number, (_at(number / _HZ, times, rates) + between) * known[:, None]


def _within_frames(
    path: CameraPath, taken_s: Float64[np.ndarray, "frames"], readout_s: float
) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n 3"]]:
    """Returns times, increasing, and the rates by which frames are straightened; 0 wherever the path is unknown."""
    edges = readout_s * np.array([-0.5, 0.5])
    times = [taken_s[:1] + edges[0]]
    rates = [np.zeros((1, 3))]
    for k, at_s in enumerate(taken_s):
        if k and path.middle_steps[k] is None:
            times.append(np.array([taken_s[k - 1] + edges[1], at_s + edges[0]]))
            rates.append(np.zeros((2, 3)))
        found = path.finding(k)
        motion = found.motion
        if isinstance(motion, RotationMotion):
            rotations = rotation_matrix(motion.rotations[::STRIDE])
            share = STRIDE / motion.height
            middles = (0.5 + STRIDE / 2) / motion.height + share * np.arange(len(rotations) - 1) - 0.5
            times.append(at_s + readout_s * middles)
            rates.append(-rotation_vector(rotations[1:] @ rotations[:-1].swapaxes(-1, -2)) / (share * readout_s))
        elif found.reason is not None and found.reason.code in AT_REST:
            times.append(at_s + edges)
            rates.append(np.zeros((2, 3)))
    every = np.concatenate(times)
    is_later = np.diff(np.maximum.accumulate(every), prepend=-np.inf) > 0  # times of damaged clips may go back
    return every[is_later], np.concatenate(rates)[is_later]


def _at(at_s: np.ndarray, times_s: np.ndarray, values: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "*at 3"]:
    return np.stack([np.interp(at_s, times_s, axis) for axis in values.T], axis=-1)
