"""Renders the burst and the clip of this folder, and the sample of the page, from the photo of this folder.

    python examples/render.py

A camera in a hand turns before the photo, and is read out from top to bottom while it does. Needs unshutter-lab and the
extra `video`.
"""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from unshutter.motion import RowMotion
from unshutter.motion.warp import distort_pixels
from unshutter.photo import Photo
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import TurningCamera

HERE = Path(__file__).parent
SAMPLE = HERE.parent / "src" / "unshutter" / "page" / "web" / "sample.jpg"
FPS = 30
HEIGHT, WIDTH = 480, 640
BURST_RATIO, CLIP_RATIO = 0.7, 0.6  # readout time / time between frames; of the clip 20 ms


def hand(degrees_per_s: float, shares: dict[float, float]) -> RotationLog:
    """Three seconds of a hand that turns a camera: a sum of sines of some frequencies [Hz], each with its share."""
    rng = np.random.default_rng(7)
    times = np.arange(0, 3, 0.005)
    rates = np.zeros((3, len(times)))
    for hertz, share in shares.items():
        strength, phase = rng.uniform(0.5, 1, (3, 1)), rng.uniform(0, 2 * np.pi, (3, 1))
        rates += degrees_per_s * share * strength * np.sin(2 * np.pi * hertz * times + phase)
    rates[0] *= 0.3  # up and down: the photo ends soon above the roof
    return RotationLog(times, *np.radians(rates))


def extended(picture: np.ndarray, rows: int) -> np.ndarray:
    """Adds rows of sky above the photo and of street below it, [H, W, 3], for a camera that looks past its edges."""
    blur = np.hanning(203)[1:-1, None] / np.hanning(203).sum()
    parts = [picture]
    for edge in (picture[:6], picture[-6:]):
        colours = np.pad(edge.mean(axis=0), ((100, 100), (0, 0)), mode="edge")  # [W + 200, 3]
        smooth = np.stack([np.convolve(channel, blur[:, 0], mode="valid") for channel in colours.T], axis=-1)
        parts.append(np.repeat(smooth[None], rows, axis=0).round().astype(picture.dtype))
    return np.concatenate([parts[1], picture, parts[2]])


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
    swing = TurningCamera(hand(110, {0.6: 1.0, 1.3: 0.3, 2.9: 0.24}), 0.8, 3, FPS, BURST_RATIO, HEIGHT, WIDTH, 560.0)
    (HERE / "burst").mkdir(exist_ok=True)
    for name, frame in zip("abc", swing.rendered(picture, noise=2.0), strict=True):
        Photo.from_array(np.ascontiguousarray(frame)).save(HERE / "burst" / f"{name}.jpg", overwrite=True, quality=86)
    walk = TurningCamera(hand(70, {2.3: 1.0, 3.9: 0.6}), 0.2, 75, FPS, CLIP_RATIO, HEIGHT, WIDTH, 700.0)
    with av.open(str(HERE / "walk.mp4"), "w", options={"movflags": "faststart"}) as film:
        stream = film.add_stream("libx264", Fraction(FPS), options={"crf": "24", "preset": "slow"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for frame in walk.rendered(extended(picture, rows=200), noise=1.0):
            film.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), "rgb24")))
        film.mux(stream.encode(None))


if __name__ == "__main__":
    main()
