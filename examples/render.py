"""Renders the burst and the clip of this folder, and the sample of the page.

    python examples/render.py

A camera in a hand turns, and is read out from top to bottom while it does. The burst and the clip see a place all
around (a cube map that comes with unshutter-lab), so every row is exact and nothing is missing beyond a border; the
sample sees the photo of this folder. Needs unshutter-lab and the extra `video`.
"""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from unshutter.motion import RowMotion
from unshutter.motion.warp import distort_pixels
from unshutter.photo import Photo
from unshutter_lab.synthesis.panorama import Camera, Place, shipped_places
from unshutter_lab.synthesis.place_photos import with_noise
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera

HERE = Path(__file__).parent
SAMPLE = HERE.parent / "src" / "unshutter" / "page" / "web" / "sample.jpg"
PLACE = "san_giuseppe_bridge"
YAW, TILT = 52.0, 4.0  # degrees: where the camera looks
SHARES = np.array([[1.0], [0.3], [0.3]])  # how fast the hand turns to the side, about the line of sight, and up
FPS = 30
HEIGHT, WIDTH, FOCAL_PX = 360, 480, 440.0  # 57 degrees across: as fine as the cube map in the middle of the picture
FINER = 2  # times the size at which pictures are rendered, before they are averaged down
BURST_RATIO, CLIP_RATIO = 0.7, 0.6  # readout time / time between frames; of the clip 20 ms


def hand(degrees_per_s: float, shares: dict[float, float]) -> RotationLog:
    """Three seconds of a hand that turns a camera: a sum of sines of some frequencies [Hz], each with its share."""
    rng = np.random.default_rng(7)
    times = np.arange(0, 3, 0.005)
    rates = np.zeros((3, len(times)))
    for hertz, share in shares.items():
        strength, phase = rng.uniform(0.5, 1, (3, 1)), rng.uniform(0, 2 * np.pi, (3, 1))
        rates += degrees_per_s * share * strength * np.sin(2 * np.pi * hertz * times + phase)
    rates *= SHARES
    return RotationLog(times, *np.radians(rates))


def burst() -> RotatingCamera:
    """The camera of the burst: three frames."""
    shares = {0.6: 1.0, 1.3: 0.3, 2.9: 0.24}
    return RotatingCamera(hand(220, shares), 1.6, 3, FPS, BURST_RATIO, HEIGHT, WIDTH, FOCAL_PX)


def walk() -> RotatingCamera:
    """The camera of the clip: 2.5 seconds."""
    return RotatingCamera(hand(130, {2.3: 1.0, 3.9: 0.6}), 0.2, 75, FPS, CLIP_RATIO, HEIGHT, WIDTH, FOCAL_PX)


def seen(turning: RotatingCamera, noise: float, is_global: bool = False) -> Iterator[np.ndarray]:
    """Yields the frames [H, W, 3] in order; with a global shutter, all rows are taken at the time of the middle one."""
    place = Place.load(shipped_places()[PLACE])
    camera = Camera(HEIGHT * FINER, WIDTH * FINER, FOCAL_PX * FINER, YAW, TILT)
    share = np.full(camera.height, 0.5) if is_global else (np.arange(camera.height) + 0.5) / camera.height
    rng = np.random.default_rng(0)
    for frame in range(turning.frames):
        rotations = turning.rotations(frame + turning.readout_ratio * share)
        fine = place.seen(camera, rotations.transpose(0, 2, 1))
        yield with_noise(cv2.resize(fine, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), noise, rng)


def sample(picture: np.ndarray) -> np.ndarray:
    """The photo as a camera sees it that is swung sideways: [600, 860, 3], from within its borders."""
    rows, cols, top = 600, 860, 16
    u = (np.arange(picture.shape[0]) - top) / rows
    motion = RowMotion(picture.shape[1], -80 * u + 80 * u * (1 - u) + 40, np.zeros(len(u)))
    left = (picture.shape[1] - cols) // 2
    return distort_pixels(picture, motion)[top : top + rows, left : left + cols]


def main() -> None:
    """Writes burst/, walk.mp4 and the sample."""
    picture = Photo.open(HERE / "original" / "basilica.webp").to_array()
    Photo.from_array(np.ascontiguousarray(sample(picture))).save(SAMPLE, overwrite=True, quality=88)
    (HERE / "burst").mkdir(exist_ok=True)
    for name, frame in zip("abc", seen(burst(), noise=2.0), strict=True):
        Photo.from_array(frame).save(HERE / "burst" / f"{name}.jpg", overwrite=True, quality=90)
    with av.open(str(HERE / "walk.mp4"), "w", options={"movflags": "faststart"}) as video:
        stream = video.add_stream("libx264", Fraction(FPS), options={"crf": "21", "preset": "slow"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for frame in seen(walk(), noise=1.0):
            video.mux(stream.encode(av.VideoFrame.from_ndarray(frame, "rgb24")))
        video.mux(stream.encode(None))


if __name__ == "__main__":
    main()
