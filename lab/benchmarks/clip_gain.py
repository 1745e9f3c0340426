"""What ``unshutter video`` gains on clips with a known truth, and what the codec, resampling and motion cost.

    python lab/benchmarks/clip_gain.py PHOTO LOGS [--only hand drone car] [--keep FOLDER] [--ways found given truth]

LOGS is the folder of recorded trajectories. The clips are the photo seen by a camera that turns as recorded. *Plain*
ones are of a straight lens, with neither noise nor blur, 150 frames of 1920x1080 px (or --frame). The families hand,
drone (vibration above half the frame rate) and car are of 640x360 px, through a fisheye, exposed for half a frame
interval, with noise, two objects that move by themselves in front of a third of the picture, and as many bits per
pixel as 8 Mbit/s are at 1920x1080 px.

The truth has no noise and is not encoded. Told: PSNR of luma against it [dB, without a border of 6 %, and without the
objects], of the clip as taken and of the result in these ways, and the readout ratio. Of *found* also the frame that
gains least, and the gain of whole pictures, objects included.

* found: nothing given. given: readout ratio and lens given.
* truth: the true motion is undone (--motion), encoded like the others. lossless: the same, not encoded again.
* clean: the true motion is undone in frames that were never encoded. codec: the global-shutter frames, encoded once.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import av
import cv2
import numpy as np

from unshutter.motion.lens import Lens
from unshutter.motion.rotations import rotation_matrix, rotation_vector
from unshutter.photo import Photo
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import TurningCamera, seen

FPS, NOISE, EXPOSURE, MOMENTS = 30.0, 3.0, 0.5, 4  # of an exposure, as many moments are averaged
BITS = 8_000_000 / (30 * 1920 * 1080)  # per pixel
STRIDE, ROWS = 4, 257  # of motion files


@dataclass(frozen=True)
class Case:
    """A camera, its motion, and what stands in the way."""

    family: str
    log: str
    seed: int
    readout_ms: float
    vibration: tuple[tuple[float, float], ...] = ()  # frequencies [Hz] and amplitudes [degrees]
    k: tuple[float, float, float, float] | None = None  # of the fisheye; None: straight, without noise, blur, objects
    degrees: float = 0.0  # its field of view from corner to corner


WIDE, MEDIUM = (0.05, 0.012, -0.01, 0.003), (0.10, 0.02, 0.0, 0.0)
CASES = (
    Case("plain", "ios_gyro_100hz", 1, 20),
    Case("plain", "ios_gyro_100hz", 5, 20),
    Case("plain", "tumvi_room1_mocap_120hz", 1, 20),
    Case("plain", "phone_gyro_412hz", 1, 20),
    Case("hand", "ios_gyro_100hz", 2, 16, k=MEDIUM, degrees=95),
    Case("hand", "tumvi_room2_mocap_120hz", 3, 24, k=WIDE, degrees=122),
    Case("drone", "tumvi_room3_mocap_120hz", 4, 16, ((23, 0.08), (41, 0.03)), MEDIUM, 95),
    Case("drone", "tumvi_room1_mocap_120hz", 5, 28, ((19, 0.15), (27, 0.05)), WIDE, 122),
    Case("car", "phone_gyro_412hz", 6, 20, k=MEDIUM, degrees=95),
    Case("car", "phone_gyro_412hz", 7, 30, k=WIDE, degrees=122),
)


@dataclass(frozen=True)
class Shaken:
    """A log with vibration; its methods are those of :class:`RotationLog`."""

    log: RotationLog
    vibration: tuple[tuple[float, float], ...]
    t_s: np.ndarray

    def rotations(self, at_s: np.ndarray) -> np.ndarray:
        """Returns R at times."""
        turn = np.zeros((len(at_s), 3))
        for k, (hertz, degrees) in enumerate(self.vibration):
            phase = 2 * np.pi * hertz * at_s[:, None] + np.array([0.0, 2.0, 4.0]) + k
            turn += np.radians(degrees) * np.sin(phase) * [1.0, 0.7, 0.4]
        return rotation_matrix(turn) @ self.log.rotations(at_s)

    def draw_start(self, rng: np.random.Generator, duration_s: float) -> float:
        """Returns a random time in the log."""
        return self.log.draw_start(rng, duration_s)


@dataclass(frozen=True)
class Scene:
    """A photo, what turns in front of it, and how it is taken."""

    case: Case
    camera: TurningCamera
    photo: np.ndarray

    @classmethod
    def of(cls, case: Case, photo: np.ndarray, logs: Path, size: tuple[int, int], frames: int) -> Scene:
        """Returns a scene with frames of this width and height."""
        width, height = size
        log = RotationLog.load_steady(logs / f"{case.log}.npz")
        log = Shaken(log, case.vibration, log.t_s) if case.vibration else log
        focal, lens = 1600 * width / 1920, None
        if case.k is not None:
            shape = Lens(1.0, case.k)
            reach = float(np.hypot(1, width / height)) / 2
            lens = replace(shape, focal=reach / float(shape.distance(np.radians(case.degrees / 2))))
            focal = lens.focal * height
        about = {"height": height, "width": width, "focal_px": focal, "readout_ratio": case.readout_ms * FPS / 1000}
        camera = TurningCamera.drawn(np.random.default_rng(case.seed), log, frames, fps=FPS, **about)
        camera, scale = replace(camera, lens=lens), min(photo.shape[0] / height, photo.shape[1] / width)
        if scale > 1:
            sides = round(photo.shape[1] / scale), round(photo.shape[0] / scale)
            photo = cv2.resize(photo, sides, interpolation=cv2.INTER_AREA)
        return cls(case, camera, photo)

    def frames(self, is_global: bool) -> Iterator[np.ndarray]:
        """Yields the frames without noise, uint8 [height, width, 3]."""
        camera, scale = (
            self.camera,
            min(self.photo.shape[0] / self.camera.height, self.photo.shape[1] / self.camera.width),
        )
        about = camera.width, camera.focal_px, scale, 0.0, np.random.default_rng(0), camera.lens
        offsets = EXPOSURE * ((np.arange(MOMENTS) + 0.5) / MOMENTS - 0.5) if self.case.k else [0.0]
        for frame in range(camera.frames):
            times = self._times(frame, is_global)
            total = np.zeros((camera.height, camera.width, 3), np.float32)
            for offset in offsets:
                picture = seen(self.photo, camera.rotations(np.maximum(times + offset, 0)), *about)
                total += self._with_boards(picture, times + offset) if self.case.k else picture
            yield np.rint(total / len(offsets)).astype(np.uint8)

    def background(self, frame: int) -> np.ndarray:
        """Bool [height, width]: what the boards hide in neither shutter's frame, a few px apart from them."""
        hidden = np.zeros((self.camera.height, self.camera.width), np.uint8)
        for is_global in (False, True) if self.case.k else ():
            for _, inside in self._boards(self._times(frame, is_global)):
                hidden |= inside
        return cv2.dilate(hidden, np.ones((25, 25), np.uint8)) == 0

    def _times(self, frame: int, is_global: bool) -> np.ndarray:
        rows = self.camera.row_times(frame)
        return np.full_like(rows, frame + self.camera.readout_ratio / 2) if is_global else rows

    def _boards(self, times: np.ndarray) -> Iterator[tuple[list[np.ndarray], np.ndarray]]:
        """Yields two boards that move to and fro, a sixth of the picture each: places on them, and where they are."""
        height, width = self.camera.height, self.camera.width
        for middle, top, speed in ((0.3, 0.1, 0.011), (0.7, 0.45, -0.017)):
            swing = np.abs((times * speed + 10.25 + middle) % 1.0 - 0.5) * 2  # 0 to 1 and back
            left = (middle - 0.5 / 3 + 0.3 * (swing - 0.5)) * width  # [rows]
            col = np.arange(width)[None] - left[:, None]
            row = np.broadcast_to(np.arange(height)[:, None] - top * height, col.shape)
            inside = (col >= 0) & (col < width / 3) & (row >= 0) & (row < 0.5 * height)
            yield [np.ascontiguousarray(each, np.float32) for each in (col, row)], inside

    def _with_boards(self, picture: np.ndarray, times: np.ndarray) -> np.ndarray:
        for at, inside in self._boards(times):
            board = cv2.remap(self.photo[::-1, ::-1], *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
            picture = np.where(inside[..., None], board, picture)
        return picture

    def write(self, path: Path, frames: Iterator[av.VideoFrame], lossless: bool, noisy: bool) -> None:
        """Writes frames as a clip."""
        rng = np.random.default_rng(self.case.seed)
        options = {"preset": "medium"} if self.case.k else {"preset": "veryfast", "crf": "12"}
        with av.open(str(path), "w") as out:
            film = out.add_stream("ffv1" if lossless else "libx264", rate=30, options={} if lossless else options)
            film.width, film.height, film.pix_fmt = self.camera.width, self.camera.height, "yuv420p"
            if self.case.k and not lossless:
                film.bit_rate = round(BITS * FPS * film.width * film.height)
            for frame in frames:
                planes = frame.to_ndarray()
                if noisy and self.case.k:
                    luma = planes[: film.height]
                    luma[:] = np.clip(np.rint(luma + rng.normal(0, NOISE, luma.shape)), 0, 255)
                out.mux(film.encode(av.VideoFrame.from_ndarray(planes, format="yuv420p")))
            out.mux(film.encode(None))

    def rendered(self, is_global: bool) -> Iterator[av.VideoFrame]:
        """Yields the frames as they are encoded, without noise."""
        for pixels in self.frames(is_global):
            yield av.VideoFrame.from_ndarray(pixels, format="rgb24").reformat(format="yuv420p")

    def motion(self, path: Path) -> None:
        """Writes the true motion as a motion file."""
        camera = replace(self.camera, height=ROWS)
        records = []
        for frame in range(camera.frames):
            turned = camera.rotations(camera.row_times(frame))
            vectors = rotation_vector(turned @ turned[0].T)
            vectors[0] = 0.0
            record = {"time_s": frame / FPS, "cut": False, "focal": self.camera.focal_px / self.camera.height}
            records.append({**record, "rotations_rad": vectors[::STRIDE].tolist()})
        size = {"height": self.camera.height, "width": self.camera.width, "readout": "top-to-bottom"}
        head = {"format": "unshutter-clip-motion/1", **size, "readout_ratio": camera.readout_ratio}
        lens = {} if self.camera.lens is None else {"lens": self.camera.lens.as_json()}
        path.write_text(json.dumps({**head, **lens, "frames": records}))

    def lens(self, path: Path) -> None:
        """Writes the lens as a lens file."""
        size, focal = {"w": self.camera.width, "h": self.camera.height}, self.camera.focal_px
        matrix = [[focal, 0, (size["w"] - 1) / 2], [0, focal, (size["h"] - 1) / 2], [0, 0, 1]]
        known = {"camera_matrix": matrix, "distortion_coeffs": self.case.k}
        path.write_text(json.dumps({"calib_dimension": size, "fisheye_params": known}))


def luma(path: Path) -> Iterator[np.ndarray]:
    with av.open(str(path)) as clip:
        for frame in clip.decode(video=0):
            yield frame.to_ndarray(format="gray")


def decoded(path: Path) -> Iterator[av.VideoFrame]:
    with av.open(str(path)) as clip:
        yield from clip.decode(video=0)


def errors(path: Path, truth: Path, scene: Scene | None = None) -> np.ndarray:
    """[frames] PSNR of luma [dB], of the background if the scene is given."""
    found = []
    for k, (one, other) in enumerate(zip(luma(path), luma(truth), strict=True)):
        border = int(0.06 * one.shape[0])
        inner = slice(border, -border)
        squares = np.square(one[inner, inner].astype(float) - other[inner, inner])
        used = squares if scene is None else squares[scene.background(k)[inner, inner]]
        found.append(10 * np.log10(255**2 / used.mean()))
    return np.array(found)


def psnr(path: Path, truth: Path) -> float:
    return float(errors(path, truth).mean())


def unshutter(*words: object) -> tuple[bool, str]:
    """(whether it went well, what it said)."""
    command = [sys.executable, "-m", "unshutter", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True)
    return done.returncode == 0, done.stderr.splitlines()[0] if done.stderr else ""


def report(scene: Scene, folder: Path, ways: list[str]) -> None:
    case = scene.case
    name = f"{case.family}-{case.seed}-{case.log.split('_')[0]}"
    made = {kind: folder / f"{name}-{kind}.mkv" for kind in ("pure", "gs", "rs", "codec", "clean")}
    files = {kind: folder / f"{name}-{kind}.json" for kind in ("motion", "lens")}
    if not all(path.exists() for path in made.values()):
        for kind in ("pure", "gs"):
            scene.write(made[kind], scene.rendered(kind == "gs"), lossless=True, noisy=False)
        for kind, source in (("rs", "pure"), ("codec", "gs"), ("clean", "pure")):
            scene.write(made[kind], decoded(made[source]), lossless=kind == "clean", noisy=True)
    scene.motion(files["motion"])
    scene.lens(files["lens"])
    ratio = ("--readout-ratio", scene.camera.readout_ratio)
    lens = ("--lens", files["lens"]) if scene.camera.lens else ("--focal-px", scene.camera.focal_px)
    flags = {
        "found": (),
        "given": (*ratio, *lens),
        "truth": ("--motion", files["motion"]),
        "lossless": ("--motion", files["motion"], "--codec", "ffv1"),
        "clean": ("--motion", files["motion"], "--codec", "ffv1"),
    }
    before, row, said = errors(made["rs"], made["gs"], scene), [], "–"
    for way in ways:
        out, log = folder / f"{name}-{way}-out.mkv", folder / f"{name}.jsonl"
        if way == "codec":
            row.append(f"{errors(made['codec'], made['gs'], scene).mean():.1f}")
            continue
        log.unlink(missing_ok=True)
        source = made["clean" if way == "clean" else "rs"]
        well, words = unshutter("video", source, "-o", out, *flags[way], "--overwrite", "--json-log", log)
        if not well:
            sys.exit(words)
        after = errors(out, made["gs"], scene)
        row.append(f"{after.mean():.1f}")
        if way == "found":
            done = json.loads(log.read_text().splitlines()[-1])
            whole = psnr(out, made["gs"]) - psnr(made["rs"], made["gs"])
            row[-1] += f" (least {np.min(after - before):+.1f}, whole {whole:+.1f})"
            said = f"{done['readout_ratio']:.2f}, {done['found_by']}; {done['rectified']} of {done['frames']}"
    head = f"{name}, {scene.camera.readout_ratio:.2f}"
    print(f"| {head} | {before.mean():.1f} | {' | '.join(row)} | {said} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photo", type=Path)
    parser.add_argument("logs", type=Path)
    parser.add_argument("--only", nargs="+", default=["hand", "drone", "car"])
    parser.add_argument("--ways", nargs="+", default=["found", "given", "truth", "lossless", "clean", "codec"])
    parser.add_argument("--frame", default="1920x1080", help="of plain clips")
    parser.add_argument("--keep", type=Path, help="keep the clips in this folder, and use those that it has")
    given = parser.parse_args()
    pixels = Photo.open(given.photo).to_array()[..., :3]
    print(f"| clip, ratio | as taken | {' | '.join(given.ways)} | found |\n|{'---|' * (3 + len(given.ways))}")
    with tempfile.TemporaryDirectory() as name:
        for case in CASES:
            if case.family in given.only:
                width, height = (640, 360) if case.k else map(int, given.frame.split("x"))
                scene = Scene.of(case, pixels, given.logs, (width, height), 60 if case.k else 150)
                report(scene, given.keep or Path(name), given.ways)


if __name__ == "__main__":
    main()
