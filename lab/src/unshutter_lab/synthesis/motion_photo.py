"""Motion photos with known motion: a still and the film around it, taken by a camera rotating as recorded.

The still and the film have their own readout times and fields of view. The film may be stabilised as in phones: its
frames then follow a smooth path instead of the camera's, with the rolling shutter corrected or not.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from unshutter.geometry.rotations import rotation_matrix, rotation_vector
from unshutter.motion import RotationMotion
from unshutter_lab.synthesis.sequences import TurningCamera

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float64, UInt8

_NOISE = 2.0  # levels of 255
_SMOOTHED_S, _REACH, _SAMPLES = (
    0.35,
    3.0,
    25,
)  # of a stabilised path: standard deviation, reach in standard deviations, and samples of the average
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
    """The stabilisation applied to the film."""

    NONE = "none"
    FRAMES = "frames"
    ROWS = "rows"


@dataclass(frozen=True)
class FilmedStill:
    """A still and its film.

    Attributes:
        camera: camera of the film.
        taken: time at which the first row of the still was exposed [frame intervals since the film's first row].
        readout: readout time of the still [frame intervals].
        height, width: size of the still [px].
        focal_px: focal length of the still [px].
        stabilisation: stabilisation applied to the film.
        moving: whether the camera moved at all.
    """

    camera: TurningCamera
    taken: float
    readout: float
    height: int
    width: int
    focal_px: float
    stabilisation: Stabilisation = Stabilisation.NONE
    moving: bool = True

    def motion(self) -> RotationMotion:
        """Returns the true motion of the still."""
        rotations = self._rotations(self._still_times())
        vectors = rotation_vector(rotations @ rotations[0].T)
        vectors[0] = 0.0
        return RotationMotion(width=self.width, rotations=vectors, focal_px=self.focal_px, estimator="drawn")

    def still(self, scene: UInt8[np.ndarray, "rows columns"], seed: int = 0) -> UInt8[np.ndarray, "height width"]:
        """Returns the still.

        Args:
            scene: undistorted; it fills the still, and is mirrored where the camera looks beyond it.
            seed: seed of the noise.
        """
        rng = np.random.default_rng(seed)
        return _taken(scene, self._rotations(self._still_times()), self.width, self.focal_px, self._scale(scene), rng)

    def film(self, scene: UInt8[np.ndarray, "rows columns"], seed: int = 1) -> Iterator[np.ndarray]:
        """Yields the frames of its film, uint8 [height, width]."""
        rng, camera = np.random.default_rng(seed), self.camera
        scale = self._scale(scene) * self.focal_px / camera.focal_px
        for frame in range(camera.frames):
            rows = frame + camera.readout_ratio * (np.arange(camera.height) + 0.5) / camera.height
            yield _taken(scene, self._stabilised(frame, rows), camera.width, camera.focal_px, scale, rng)

    def motion_photo(self, scene: UInt8[np.ndarray, "rows columns"], quality: int = 92) -> bytes:
        """Returns a JPEG followed by the film, as written by Google's phones."""
        import cv2

        film = _mp4(self.film(scene), self.camera.fps)
        moment = round((self.taken + self.readout / 2) / self.camera.fps * 1e6)
        packet = b"http://ns.adobe.com/xap/1.0/\0" + _XMP.format(moment=moment, length=len(film)).encode()
        _, data = cv2.imencode(".jpg", self.still(scene), [cv2.IMWRITE_JPEG_QUALITY, quality])
        jpeg = data.tobytes()
        return jpeg[:2] + b"\xff\xe1" + (len(packet) + 2).to_bytes(2, "big") + packet + jpeg[2:] + film

    def _still_times(self) -> np.ndarray:
        return self.taken + self.readout * (np.arange(self.height) + 0.5) / self.height

    def _scale(self, scene: np.ndarray) -> float:
        """Pixels of the scene per pixel of the still."""
        return min(scene.shape[0] / self.height, scene.shape[1] / self.width)

    def _rotations(self, times: Float64[np.ndarray, "times"]) -> Float64[np.ndarray, "times 3 3"]:
        """Returns R at times [frame intervals], relative to the pose at which the still was taken."""
        if not self.moving:
            return np.repeat(np.eye(3)[None], len(times), axis=0)
        turned = self.camera.rotations(np.append(times, self.taken + self.readout / 2))
        return turned[:-1] @ turned[-1].T

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


def _taken(
    scene: np.ndarray, rotations: np.ndarray, width: int, focal_px: float, scale: float, rng: np.random.Generator
) -> np.ndarray:
    """Returns a picture whose rows see a scene at these rotations; ``scale`` is px of the scene per picture px."""
    import cv2

    height, back = len(rotations), rotations.transpose(0, 2, 1)
    x, y = np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2
    fixed = back[:, :, 1] * y[:, None] + back[:, :, 2] * focal_px
    direction = back[:, None, :, 0] * x[:, None] + fixed[:, None]
    at = direction[..., :2] / direction[..., 2:] * focal_px * scale + (np.array(scene.shape[1::-1]) - 1) / 2
    if scale > 1.3:  # avoids aliasing
        scene = cv2.GaussianBlur(scene, (0, 0), 0.4 * scale)
    at = at.astype(np.float32)
    picture = cv2.remap(scene, at[..., 0], at[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return np.clip(np.rint(picture + rng.normal(0, _NOISE, picture.shape)), 0, 255).astype(np.uint8)


def _mp4(frames: Iterator[np.ndarray], fps: float) -> bytes:
    import av

    data = io.BytesIO()
    with av.open(data, "w", format="mp4") as out:
        film: Any = out.add_stream("libx264", rate=round(fps), options={"crf": "20", "preset": "veryfast"})
        film.pix_fmt = "yuv420p"
        for k, frame in enumerate(frames):
            if k == 0:
                film.height, film.width = frame.shape
            out.mux(film.encode(av.VideoFrame.from_ndarray(frame, format="gray")))
        out.mux(film.encode(None))
    return data.getvalue()
