"""Sequences of rolling-shutter frames with known motion: a photo seen by a camera rotating as recorded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import RotationMotion
from unshutter.motion.lens import Lens
from unshutter.motion.rotations import rotation_vector
from unshutter.motion.shapes import Float64, UInt8
from unshutter.options import Reference
from unshutter_lab.synthesis.rotation_log import RotationLog

_FARTHEST = np.radians(50)  # from the centre of the photo's plane; beyond this, too little of it is in a frame


@dataclass(frozen=True)
class RotatingCamera:
    """A camera that rotates in place as recorded in a log, which must be long enough and not rotate too far."""

    log: RotationLog  # recorded rotation
    start_s: float  # time of the log at which the first row of frame 0 is exposed [s]
    frames: int  # number of frames
    fps: float  # frames per second
    readout_ratio: float  # time from the first row to that after the last, in frame intervals, 0 ... 1
    height: int  # of the frames [px]
    width: int
    focal_px: float  # focal length [px]
    # the lens, if it bends straight lines; the scene is then all around the camera, and the photo taken by this lens
    lens: Lens | None = None

    def __post_init__(self) -> None:
        if self.frames < 1 or not (self.fps > 0 and self.focal_px > 0 and 0 <= self.readout_ratio <= 1):
            raise UsageError("needs at least one frame, and a readout ratio between 0 and 1")
        if self.start_s < self.log.t_s[0] or self.start_s + self.duration_s(self.frames, self.fps) > self.log.t_s[-1]:
            raise UnshutterError(f"the log ends before {self.frames} frames from {self.start_s:.3g} s on are taken")
        if (self.rotations(np.arange(self.frames))[:, 2, 2] < np.cos(_FARTHEST)).any():
            raise UnshutterError("the recorded camera turns away from the photo: choose another start or fewer frames")

    @staticmethod
    def duration_s(frames: int, fps: float) -> float:
        """Returns an upper bound on the time taken by a number of frames [s]."""
        return (frames + 1) / fps

    @classmethod
    def drawn(
        cls, rng: np.random.Generator, log: RotationLog, frames: int, tries: int = 200, fps: float = 30.0, **camera
    ) -> RotatingCamera:
        """Returns a camera with a random start in the log from which it does not rotate too far."""
        for _ in range(tries):
            start = log.draw_start(rng, cls.duration_s(frames, fps))
            try:
                return cls(log, start, frames, fps, **camera)
            except UnshutterError:
                continue
        raise UnshutterError("the recorded camera turns too far everywhere: choose fewer frames")

    def motion(self, frame: int, reference: Reference = "first") -> RotationMotion:
        """Returns the true motion of a frame."""
        rotations = self.rotations(self.row_times(frame))
        vectors = rotation_vector(rotations @ rotations[0].T)
        vectors[0] = 0.0
        camera = {"width": self.width, "focal_px": self.focal_px, "lens": self.lens}
        motion = RotationMotion(rotations=vectors, **camera)
        return motion.rereferenced(reference)

    def rendered(
        self,
        photo: UInt8[np.ndarray, "rows columns *bands"],
        noise: float = 0.0,
        seed: int = 0,
        global_shutter: bool = False,
    ) -> Iterator[UInt8[np.ndarray, "height width *bands"]]:
        """Yields the frames in order.

        Args:
            photo: undistorted; it fills the frame, and is mirrored where the camera looks beyond it.
            noise: standard deviation of noise added to every pixel [levels of 255].
            seed: seed of the noise.
            global_shutter: all rows are taken at the time of the middle one.
        """
        rng = np.random.default_rng(seed)
        scale = min(photo.shape[0] / self.height, photo.shape[1] / self.width)  # px of the photo per px of the frame
        if scale > 1:  # avoids aliasing
            size = (round(photo.shape[1] / scale), round(photo.shape[0] / scale))
            photo, scale = cv2.resize(photo, size, interpolation=cv2.INTER_AREA), 1.0
        for frame in range(self.frames):
            times = self.row_times(frame)
            if global_shutter:
                times = np.full(self.height, frame + self.readout_ratio / 2)
            yield seen(photo, self.rotations(times), self.width, self.focal_px, scale, noise, rng, self.lens)

    def row_times(self, frame: int) -> np.ndarray:
        """Returns the times [H] of a frame's rows [frame intervals]."""
        return frame + self.readout_ratio * (np.arange(self.height) + 0.5) / self.height

    def rotations(self, times: Float64[np.ndarray, "times"]) -> Float64[np.ndarray, "times 3 3"]:
        """Returns R at times [frame intervals], relative to the pose in the middle of the sequence."""
        at = np.append(times, self.frames / 2) / self.fps + self.start_s
        rotations = self.log.rotations(at)
        return rotations[:-1] @ rotations[-1].T


def seen(
    scene: UInt8[np.ndarray, "rows columns *bands"],
    rotations: Float64[np.ndarray, "height 3 3"],
    width: int,
    focal_px: float,
    scale: float,
    noise: float,
    rng: np.random.Generator,
    lens: Lens | None = None,
) -> UInt8[np.ndarray, "height width *bands"]:
    """Returns a picture whose rows see a scene at these rotations; ``scale`` is px of the scene per picture px."""
    height, back = len(rotations), rotations.transpose(0, 2, 1)
    x, y = np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2
    fixed = back[:, :, 1] * y[:, None] + back[:, :, 2] * focal_px  # [H, 3]
    direction = back[:, None, :, 0] * x[:, None] + fixed[:, None]  # [H, W, 3]
    at = direction[..., :2] / direction[..., 2:]
    if lens is not None:
        straight = np.stack(lens.direction(*np.meshgrid(x / focal_px, y / focal_px)), axis=-1)
        at = np.stack(lens.position(*np.einsum("hij,hwj->ihw", back, straight)), axis=-1)
    at = at * focal_px * scale + (np.array(scene.shape[1::-1]) - 1) / 2
    col, row = np.moveaxis(at.astype(np.float32), -1, 0)
    picture = cv2.remap(scene, col, row, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    if noise:
        picture = np.clip(np.rint(picture + rng.normal(0, noise, picture.shape)), 0, 255).astype(np.uint8)
    return picture
