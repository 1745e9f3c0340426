"""Scenes for tests of outputs: each command with files to read, and its options that name what it writes."""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import unshutter
from support import clips
from support.batches import make_motion, make_photos
from support.line_scenes import lines_as_text
from support.walking_camera import WalkingCamera
from unshutter.cli import main
from unshutter.single.drawn_lines import DrawnLine

WEIGHTS = Path(unshutter.__file__).parent / "weights" / "segment-transformer.npz"


PHOTO = {"--output": ".jpg .png", "--save-motion": ".json", "--masks": "", "--preview": ".png .jpg"}
PHOTOS = {"--output": "", "--save-motion": "", "--masks": "", "--preview": ".png .jpg", "--manifest": ""}
VIDEO = {"--output": ".mp4", "--save-motion": ".json", "--save-gyro": ".gcsv"} | {
    "--preview": ".png .mp4",
    "--plot": ".png",
}
LOG = {"--json-log": ".jsonl .json .png .jpg .mp4"}  # any name
GCSV = "GYROFLOW IMU LOG\nt,gx,gy,gz\n" + "".join(f"{k / 100},0.1,0.2,0.1\n" for k in range(99))


@dataclass
class Scene:
    """A command with files to read.

    Attributes:
        words: the command and its inputs.
        inputs: all files that it then reads.
        outputs: option -> endings of the files that it writes; empty: a folder.
        needed: options that cannot be left out -> where they may go.
        any_name: inputs that may have any ending.
    """

    words: list[object]
    inputs: list[Path]
    outputs: dict[str, str]
    needed: dict[str, Path] = field(default_factory=dict)
    overwrite: tuple[str, ...] = ("--overwrite",)
    any_name: list[Path] = field(default_factory=list)


def with_video(photo: Path) -> list[Path]:
    """A photo and a video next to it, which a phone may have taken with it."""
    photo.with_suffix(".MOV").write_bytes(b"film")
    return [photo, photo.with_suffix(".MOV")]


def photo(folder: Path) -> Scene:
    make_photos(folder, ["a.jpg"])
    motion = make_motion(folder / "m.json")
    words = ["rectify", folder / "a.jpg", "--motion", motion]
    return Scene(words, [*with_video(folder / "a.jpg"), motion], PHOTO | LOG)


def photos(folder: Path) -> Scene:
    """A folder, and weights of one's own."""
    make_photos(folder, ["in/a.jpg", "in/b.png"])
    with_video(folder / "in" / "a.jpg")
    weights = shutil.copyfile(WEIGHTS, folder / "w.npz")
    inputs = [*sorted((folder / "in").iterdir()), weights]
    words = ["rectify", folder / "in", "--estimator", f"segment-transformer@{weights}", "--keep-names"]
    return Scene(words, inputs, PHOTOS | LOG, {"--output": folder / "out"})


def sequence(folder: Path) -> Scene:
    make_photos(folder, ["in/1.jpg", "in/2.jpg"])
    words = ["rectify", folder / "in", "--sequence", "--readout-ratio", "0.5", "--keep-names"]
    return Scene(words, sorted((folder / "in").iterdir()), PHOTOS | LOG, {"--output": folder / "out"})


def neighbours(folder: Path) -> Scene:
    make_photos(folder, ["a.jpg", "b.jpg", "c.jpg"])
    words = ["rectify", folder / "b.jpg", "--before", folder / "a.jpg", "--after", folder / "c.jpg"]
    inputs = [*with_video(folder / "b.jpg"), folder / "a.jpg", folder / "c.jpg"]
    return Scene([*words, "--readout-ratio", "0.5"], inputs, PHOTO | LOG)


def estimate(folder: Path) -> Scene:
    make_photos(folder, ["a.jpg"])
    weights, lines = shutil.copyfile(WEIGHTS, folder / "w.npz"), folder / "lines.json"
    lines.write_text(lines_as_text([DrawnLine("upright", ((x, 9), (x, 60))) for x in (10, 80)]))
    words = ["estimate", folder / "a.jpg", "--estimator", f"segment-transformer@{weights}", "--lines", lines]
    inputs = [*with_video(folder / "a.jpg"), weights, lines]
    return Scene(words, inputs, {"--output": ".json", "--plot": ".png"}, any_name=[lines])


def estimates(folder: Path) -> Scene:
    make_photos(folder, ["in/a.jpg", "in/b.jpg"])
    return Scene(["estimate", folder / "in"], sorted((folder / "in").iterdir()), {"--output": ""})


def map_photo(folder: Path) -> Scene:
    make_photos(folder, ["a.tif"])
    weights = shutil.copyfile(WEIGHTS, folder / "w.npz")
    words = ["map", folder / "a.tif", "--estimator", f"segment-transformer@{weights}"]
    return Scene(words, [*with_video(folder / "a.tif"), weights], {"--output": ".tif"})


def points(folder: Path) -> Scene:
    motion, table = make_motion(folder / "m.json"), folder / "t.csv"
    table.write_text("x,y\n1,2\n")
    return Scene(["points", motion, table], [motion, table], {"--output": ".csv"}, any_name=[motion, table])


def poses(folder: Path) -> Scene:
    """A model and the motion file of its video."""
    camera = WalkingCamera()
    model = camera.write_model(folder / "sparse")
    motions = camera.write_clip_motion(folder / "m.json", 13)
    words = ["poses", "--colmap", model, "--motions", motions]
    return Scene(words, [*sorted(model.iterdir()), motions], {"--output": ""}, any_name=[motions])


def video(folder: Path) -> Scene:
    """A video, its gyro log next to it, and a file of its lens."""
    video, log = clips.write(folder / "a.mp4", clips.moving(6)[1]), folder / "a.gcsv"
    log.write_text(GCSV)
    lens = folder / "lens.json"
    matrix = {"camera_matrix": [[150, 0, 96], [0, 150, 72], [0, 0, 1]], "distortion_coeffs": [0.02, 0, 0, 0]}
    lens.write_text(json.dumps({"calib_dimension": {"w": 192, "h": 144}, "fisheye_params": matrix}))
    words = ["video", video, "--readout-ratio", "0.6", "--gyro", log, "--lens", lens]
    return Scene(words, [video, log, lens], VIDEO | LOG, {"--output": folder / "out.mp4"}, any_name=[log])


def video_by_motion(folder: Path) -> Scene:
    video, motion = clips.write(folder / "a.mp4", clips.moving(6)[1]), folder / "m.json"
    words = ["video", video, *clips.KNOWN, "-o", folder / "first.mp4", "--save-motion", motion]
    assert main(list(map(str, words))) == 0
    words = ["video", video, "--motion", motion]
    return Scene(words, [video, motion], VIDEO | LOG, {"--output": folder / "out.mp4"}, any_name=[motion])


def evaluate(folder: Path) -> Scene:
    make_photos(folder, ["in/a.jpg"])
    log = turns(folder / "log.npz")
    (folder / "answers").mkdir()
    answer = make_motion(folder / "answers" / "256_px_in_a.jpg_0.json")
    words = ["evaluate", "--data", folder / "in", "--estimators", "none", "--photos", 1, "--per-photo", 1]
    words = [*words, "--trajectory", log, "--answers", folder / "answers", "--jobs", 1]
    return Scene(words, [folder / "in" / "a.jpg", log, answer], {"--output": ""})


def turns(path: Path) -> Path:
    path.parent.mkdir(exist_ok=True)
    np.savez(path, t_s=np.arange(300) / 100, gyro_rad_s=np.zeros((300, 3)))
    return path


def synthesize(folder: Path) -> Scene:
    make_photos(folder, ["in/a.jpg"])
    log = turns(folder / "log.npz")
    words = ["synthesize", folder / "in", "--size", 64, "--canvas", 70, "--motion", "trajectory", "--trajectory", log]
    words = [*words, "--readout-ms", 20, "--focal-px", 60]
    return Scene(words, [folder / "in" / "a.jpg", log], {"--output": ""}, overwrite=())


TINY = """
model = "segment-transformer"
steps = 1
batch = 2
[network]
width = 16
layers = 1
heads = 2
[data]
tokens = 16
drawn = 4
"""


def train(folder: Path) -> Scene:
    (folder / "tiny.toml").write_text(TINY)
    (folder / "base.toml").write_text(TINY)
    make_photos(folder, ["in/a.jpg"])
    start = shutil.copyfile(WEIGHTS, folder / "w.npz")
    words = ["train", "--config", folder / "tiny.toml", "--base", folder / "base.toml", "--photos", folder / "in"]
    inputs = [folder / "tiny.toml", folder / "base.toml", folder / "in" / "a.jpg", start]
    return Scene([*words, "--start", start], inputs, {"--out": ""}, overwrite=())


def calibrate(folder: Path) -> Scene:
    make_photos(folder, [f"{name}/{name}.jpg" for name in ("val", "train", "ordinary")])
    log = turns(folder / "trajectories" / "log.npz")
    inputs = [*sorted(folder.rglob("*.jpg")), log]
    return Scene(["calibrate", folder, "--jobs", 1], inputs, {"--output": ""})


SCENES: dict[str, list[Callable[[Path], Scene]]] = {
    "rectify": [photo, photos, sequence, neighbours],
    "estimate": [estimate, estimates],
    "map": [map_photo],
    "points": [points],
    "poses": [poses],
    "video": [video, video_by_motion],
    "evaluate": [evaluate],
    "synthesize": [synthesize],
    "train": [train],
    "calibrate": [calibrate],
}
NEEDS = {video: "av", video_by_motion: "av", evaluate: "matplotlib", train: "torch"}
NEEDS |= {calibrate: "sklearn"}
