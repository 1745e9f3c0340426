"""Synthesises videos and motion photos with known motion: a photo seen by a camera that rotates as recorded.

``unshutter synthesize --video`` writes two: one is taken with a rolling shutter, the other with a global shutter at the
times of the middle rows. Both have sound.

A motion photo is a still and a video around it, with readout times and fields of view of their own. The video may be
stabilised as in phones: its frames then follow a smooth path instead of the camera's, with the rolling shutter
corrected or not.
"""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np

from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.pyav import av
from unshutter.motion import RotationMotion
from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.motion.shapes import Float64, UInt8
from unshutter.photo import Photo
from unshutter.progress import Progress
from unshutter_lab.synthesis.options import Synthesize, SynthesizeClip
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera, seen

_SOUND = 48_000  # samples per second
_TONE = 440  # Hz


def synthesize_clip(photo: Path, output: Path, pictures: Synthesize, clip: SynthesizeClip) -> None:
    """Writes ``rs.mp4`` and ``gs.mp4``, of an undistorted photo that is preferably no smaller, to a new folder.

    ``pictures`` gives the seed, the trajectory, the readout time and the focal length.
    """
    if pictures.trajectory is None or pictures.readout_ms is None or pictures.focal_px is None:
        raise UsageError("--video needs --motion trajectory, with --trajectory, --readout-ms and --focal-px")
    ratio = pictures.readout_ms / 1000 * clip.fps
    if not 0 < ratio <= 1:
        raise UsageError(f"a readout of {pictures.readout_ms:g} ms is longer than a frame at {clip.fps:g} a second")
    rng, log = np.random.default_rng(pictures.seed), RotationLog.load_steady(pictures.trajectory)
    frames, (width, height) = max(2, round(clip.seconds * clip.fps)), clip.size
    seen = {"fps": clip.fps, "height": height, "width": width, "focal_px": pictures.focal_px}
    camera = RotatingCamera.drawn(rng, log, frames, readout_ratio=ratio, **seen)
    pixels = Photo.open(photo).to_array()
    if pixels.dtype != np.uint8 or pixels.ndim != 3:
        raise UnshutterError(f"{photo}: clips are made from colour photos of 8 bits")
    with _new_folder(output) as folder, Progress(2 * camera.frames, "frames") as progress:
        for name, is_global in (("rs.mp4", False), ("gs.mp4", True)):
            frames = camera.rendered(pixels[..., :3], global_shutter=is_global)
            write_video(str(folder / name), frames, camera, bar=progress)


@contextmanager
def _new_folder(folder: Path) -> Iterator[Path]:
    """Creates a temporary folder that replaces ``folder`` if the block succeeds, and is removed otherwise."""
    if os.path.lexists(folder) and not (folder.is_dir() and not folder.is_symlink() and not os.listdir(folder)):
        raise UnshutterError(f"{folder} exists already: pictures go into a new folder")
    part = folder.with_name(f".unshutter-{os.urandom(8).hex()}.part")
    try:
        part.mkdir()
        yield part
        if folder.is_dir():
            folder.rmdir()
        part.rename(folder)
    except OSError as error:
        raise UnshutterError(f"cannot write {folder}: {error.strerror}") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)


def write_video(
    target: str | IO[bytes],
    frames: Iterable[UInt8[np.ndarray, "h w *bands"]],
    camera: RotatingCamera,
    crf: int = 12,
    sound: bool = True,
    bar: Progress | None = None,
) -> None:
    """Writes the frames of a camera, grey or in colour, as an MP4 video, with a tone as its sound."""
    rate = Fraction(camera.fps).limit_denominator(1001)
    with av().open(target, "w", format="mp4") as out:
        video = out.add_stream("libx264", rate=rate, options={"crf": str(crf), "preset": "veryfast"})
        video.width, video.height, video.pix_fmt = camera.width, camera.height, "yuv420p"
        heard = out.add_stream("aac", rate=_SOUND) if sound else None
        for k, pixels in enumerate(frames):
            kind = "gray" if pixels.ndim == 2 else "rgb24"
            frame = av().VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format=kind)
            out.mux(video.encode(frame.reformat(format="yuv420p")))
            if heard:
                out.mux(heard.encode(_tone(k, camera.fps)))
            if bar:
                bar.advance()
        for stream in filter(None, (video, heard)):
            out.mux(stream.encode(None))


def _tone(frame: int, fps: float) -> Any:
    """Returns the sound of one frame."""
    first, end = round(frame * _SOUND / fps), round((frame + 1) * _SOUND / fps)
    wave = 0.1 * np.sin(2 * np.pi * _TONE * np.arange(first, end) / _SOUND)
    sound = av().AudioFrame.from_ndarray(np.stack([wave, wave]).astype(np.float32), format="fltp", layout="stereo")
    sound.sample_rate, sound.pts, sound.time_base = _SOUND, first, Fraction(1, _SOUND)
    return sound


_NOISE = 2.0  # levels of 255
# of a stabilised path: standard deviation, reach in standard deviations, and samples of the average
_SMOOTHED_S, _REACH, _SAMPLES = 0.35, 3.0, 25
_XMP = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:GCamera="http://ns.google.com/photos/1.0/camera/" '
    'xmlns:Container="http://ns.google.com/photos/1.0/container/" '
    'xmlns:Item="http://ns.google.com/photos/1.0/container/item/" GCamera:MotionPhoto="1" '
    'GCamera:MotionPhotoVersion="1" GCamera:MotionPhotoPresentationTimestampUs="{moment}">'
    "<Container:Directory><rdf:Seq>"
    '<rdf:li rdf:parseType="Resource"><Container:Item Item:Mime="image/jpeg" Item:Semantic="Primary"/></rdf:li>'
    '<rdf:li rdf:parseType="Resource"><Container:Item Item:Mime="video/mp4" Item:Semantic="MotionPhoto" '
    'Item:Length="{length}"/></rdf:li></rdf:Seq></Container:Directory></rdf:Description></rdf:RDF></x:xmpmeta>'
)


class Stabilisation(StrEnum):
    """The stabilisation applied to the video."""

    NONE = "none"
    FRAMES = "frames"
    ROWS = "rows"


@dataclass(frozen=True)
class SyntheticMotionPhoto:
    """A still and its video."""

    camera: RotatingCamera  # camera of the video
    taken: float  # time at which the first row of the still was exposed [frame intervals since the video's first row]
    readout: float  # readout time of the still [frame intervals]. height, width: size of the still [px].
    height: int
    width: int
    focal_px: float  # focal length of the still [px]
    stabilisation: Stabilisation = Stabilisation.NONE  # stabilisation applied to the video
    moving: bool = True  # whether the camera moved at all

    def motion(self) -> RotationMotion:
        """Returns the true motion of the still."""
        rotations = self._rotations(self._still_times())
        vectors = rotation_vector(rotations @ rotations[0].T)
        vectors[0] = 0.0
        return RotationMotion(width=self.width, rotations=vectors, focal_px=self.focal_px)

    def still(self, scene: UInt8[np.ndarray, "rows columns"], seed: int = 0) -> UInt8[np.ndarray, "height width"]:
        """Returns the still."""
        rng, scale = np.random.default_rng(seed), self._scale(scene)
        rotated = self._rotations(self._still_times())
        return seen(_softened(scene, scale), rotated, self.width, self.focal_px, scale, _NOISE, rng)

    def video(self, scene: UInt8[np.ndarray, "rows columns"], seed: int = 1) -> Iterator[np.ndarray]:
        """Yields the frames of its video, uint8 [height, width]."""
        rng, camera = np.random.default_rng(seed), self.camera
        scale = self._scale(scene) * self.focal_px / camera.focal_px
        scene = _softened(scene, scale)
        for frame in range(camera.frames):
            rotations = self._stabilised(frame, camera.row_times(frame))
            yield seen(scene, rotations, camera.width, camera.focal_px, scale, _NOISE, rng)

    def motion_photo(self, scene: UInt8[np.ndarray, "rows columns"], quality: int = 92) -> bytes:
        """Returns a JPEG followed by the video, as written by Google's phones."""
        stream = io.BytesIO()
        write_video(stream, self.video(scene), self.camera, crf=20, sound=False)
        video = stream.getvalue()
        moment = round((self.taken + self.readout / 2) / self.camera.fps * 1e6)
        packet = b"http://ns.adobe.com/xap/1.0/\0" + _XMP.format(moment=moment, length=len(video)).encode()
        _, data = cv2.imencode(".jpg", self.still(scene), [cv2.IMWRITE_JPEG_QUALITY, quality])
        jpeg = data.tobytes()
        return jpeg[:2] + b"\xff\xe1" + (len(packet) + 2).to_bytes(2, "big") + packet + jpeg[2:] + video

    def _still_times(self) -> np.ndarray:
        return self.taken + self.readout * (np.arange(self.height) + 0.5) / self.height

    def _scale(self, scene: np.ndarray) -> float:
        """Pixels of the scene per pixel of the still."""
        return min(scene.shape[0] / self.height, scene.shape[1] / self.width)

    def _rotations(self, times: Float64[np.ndarray, "times"]) -> Float64[np.ndarray, "times 3 3"]:
        """Returns R at times [frame intervals], relative to the pose at which the still was taken."""
        if not self.moving:
            return np.repeat(np.eye(3)[None], len(times), axis=0)
        rotated = self.camera.rotations(np.append(times, self.taken + self.readout / 2))
        return rotated[:-1] @ rotated[-1].T

    def _stabilised(self, frame: int, rows: np.ndarray) -> np.ndarray:
        """[rows, 3, 3] rotations of a frame's rows after stabilisation."""
        rotations = self._rotations(rows)
        if self.stabilisation is Stabilisation.NONE or not self.moving:
            return rotations
        middle = frame + self.camera.readout_ratio / 2
        at = np.linspace(-_REACH, _REACH, _SAMPLES)
        weights = np.exp(-0.5 * at**2)
        times = np.clip(middle + at * _SMOOTHED_S * self.camera.fps, 0, self.camera.frames)
        smooth = rotation_matrix(weights @ rotation_vector(self._rotations(times)) / weights.sum())
        if self.stabilisation is Stabilisation.ROWS:
            return np.repeat(smooth[None], len(rows), axis=0)
        return rotations @ self._rotations(np.array([middle]))[0].T @ smooth


def _softened(scene: np.ndarray, scale: float) -> np.ndarray:
    """Avoids aliasing in pictures that are smaller than the scene by this factor."""
    return cv2.GaussianBlur(scene, (0, 0), 0.4 * scale) if scale > 1.3 else scene
