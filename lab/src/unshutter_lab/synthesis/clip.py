"""``unshutter synthesize --video``: a photo seen by a camera rotating as recorded, as two films.

One is taken with a rolling shutter, the other with a global shutter at the times of the middle rows. Both have sound.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.photo import Photo
from unshutter.progress import Progress
from unshutter.storage.new_folders import new_folder, remove_left_folders
from unshutter.video.containers import av
from unshutter_lab.synthesis.options import Synthesize, SynthesizeClip
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import TurningCamera

if TYPE_CHECKING:
    from unshutter.geometry.shapes import UInt8

_SHAKE_S = 0.03  # motion-capture logs have more jitter between samples than a hand
_SOUND = 48_000  # samples per second
_TONE = 440  # Hz


class Instants(TurningCamera):
    """A camera that reads out instantaneously, at the times of the middle rows."""

    readout_before: float

    @classmethod
    def of(cls, camera: TurningCamera) -> Instants:
        """Derives it from a camera with a readout time."""
        size = (camera.height, camera.width, camera.focal_px)
        instants = cls.__new__(cls)
        object.__setattr__(instants, "readout_before", camera.readout_ratio)
        instants.__init__(camera.log, camera.start_s, camera.frames, camera.fps, 0.0, *size)
        return instants

    def rotations(self, times: np.ndarray) -> np.ndarray:
        """Returns R at times [frame intervals], delayed so that each frame is taken at its middle row's time."""
        return super().rotations(np.asarray(times) + self.readout_before / 2)


def synthesize_clip(photo: Path, output: Path, pictures: Synthesize, clip: SynthesizeClip) -> None:
    """Writes ``rs.mp4`` and ``gs.mp4`` to a new folder.

    Args:
        photo: undistorted; preferably at least as large as the frames.
        output: the folder.
        pictures: seed, trajectory, readout time, focal length.
        clip: size, length and frame rate.

    Raises:
        UsageError: no trajectory is given.
        UnshutterError: the photo or the trajectory cannot be used, or the folder is not writable.
    """
    if pictures.trajectory is None or pictures.readout_ms is None or pictures.focal_px is None:
        raise UsageError("--video needs --motion trajectory, with --trajectory, --readout-ms and --focal-px")
    ratio = pictures.readout_ms / 1000 * clip.fps
    if not 0 < ratio <= 1:
        raise UsageError(f"a readout of {pictures.readout_ms:g} ms is longer than a frame at {clip.fps:g} a second")
    log = RotationLog.load(pictures.trajectory)
    log = log.smoothed(_SHAKE_S) if log.from_poses else log
    width, height = clip.size
    camera = TurningCamera.drawn(
        np.random.default_rng(pictures.seed),
        log,
        max(2, round(clip.seconds * clip.fps)),
        fps=clip.fps,
        readout_ratio=ratio,
        height=height,
        width=width,
        focal_px=pictures.focal_px,
    )
    pixels = Photo.open(photo).to_array()
    if pixels.dtype != np.uint8 or pixels.ndim != 3:
        raise UnshutterError(f"{photo}: clips are made from colour photos of 8 bits")
    remove_left_folders(output)
    with new_folder(output) as folder, Progress(2 * camera.frames, "frames") as progress:
        for name, moments in (("rs.mp4", camera), ("gs.mp4", Instants.of(camera))):
            _write(folder / name, moments.rendered(pixels[..., :3]), camera, progress)


def _write(path: Path, frames: Iterable[UInt8[np.ndarray, "h w 3"]], camera: TurningCamera, bar: Progress) -> None:
    """Writes a film with sound."""
    rate = Fraction(camera.fps).limit_denominator(1001)
    with av().open(str(path), "w") as out:
        film = out.add_stream("libx264", rate=rate, options={"crf": "12", "preset": "veryfast"})
        film.width, film.height, film.pix_fmt = camera.width, camera.height, "yuv420p"
        heard = out.add_stream("aac", rate=_SOUND)
        for k, pixels in enumerate(frames):
            frame = av().VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
            out.mux(film.encode(frame.reformat(format="yuv420p")))
            out.mux(heard.encode(_tone(k, camera.fps)))
            bar.advance()
        out.mux(film.encode(None))
        out.mux(heard.encode(None))


def _tone(frame: int, fps: float) -> Any:
    """Returns the sound of one frame."""
    first, end = round(frame * _SOUND / fps), round((frame + 1) * _SOUND / fps)
    wave = 0.1 * np.sin(2 * np.pi * _TONE * np.arange(first, end) / _SOUND)
    sound = av().AudioFrame.from_ndarray(np.stack([wave, wave]).astype(np.float32), format="fltp", layout="stereo")
    sound.sample_rate, sound.pts, sound.time_base = _SOUND, first, Fraction(1, _SOUND)
    return sound
