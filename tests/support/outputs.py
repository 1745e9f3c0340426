"""Scenes for tests of outputs: each command with files to read, and its options that name what it writes."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import unshutter
from support import clips
from support.batches import make_motion, make_photos
from unshutter.cli import main

WEIGHTS = Path(unshutter.__file__).parent / "weights" / "segment-transformer.npz"


@dataclass
class Scene:
    """A command with files to read.

    Attributes:
        words: the command and its inputs.
        inputs: all files that it then reads.
        outputs: option -> ending of the files that it writes.
        needed: options that cannot be left out -> where they may go.
        code: with which it ends where all goes well.
    """

    words: list[object]
    inputs: list[Path]
    outputs: dict[str, str]
    needed: dict[str, Path] = field(default_factory=dict)
    overwrite: tuple[str, ...] = ("--overwrite",)


def photo(folder: Path) -> Scene:
    make_photos(folder, ["a.jpg"])
    motion = make_motion(folder / "m.json")
    words = ["rectify", folder / "a.jpg", "--motion", motion]
    ends = {"--output": ".jpg", "--save-motion": ".json", "--masks": "", "--json-log": ".jsonl", "--preview": ".png"}
    return Scene(words, [folder / "a.jpg", motion], ends)


def photos(folder: Path) -> Scene:
    """A folder, and weights of one's own."""
    make_photos(folder, ["in/a.jpg", "in/b.png"])
    weights = shutil.copyfile(WEIGHTS, folder / "w.npz")
    inputs = [*sorted((folder / "in").iterdir()), weights]
    words = ["rectify", folder / "in", "--estimator", f"segment-transformer@{weights}", "--keep-names"]
    ends = {"--output": "", "--save-motion": "", "--masks": "", "--json-log": ".jsonl", "--preview": ".png"}
    return Scene(words, inputs, ends | {"--manifest": ""}, {"--output": folder / "out"})


def neighbours(folder: Path) -> Scene:
    make_photos(folder, ["a.jpg", "b.jpg", "c.jpg"])
    words = ["rectify", folder / "b.jpg", "--before", folder / "a.jpg", "--after", folder / "c.jpg"]
    ends = {"--output": ".jpg", "--save-motion": ".json", "--masks": "", "--json-log": ".jsonl", "--preview": ".png"}
    return Scene([*words, "--readout-ratio", "0.5"], sorted(folder.glob("*.jpg")), ends)


def estimate(folder: Path) -> Scene:
    make_photos(folder, ["a.jpg"])
    weights = shutil.copyfile(WEIGHTS, folder / "w.npz")
    words = ["estimate", folder / "a.jpg", "--estimator", f"segment-transformer@{weights}"]
    return Scene(words, [folder / "a.jpg", weights], {"--output": ".json", "--plot": ".png"})


def map_photo(folder: Path) -> Scene:
    make_photos(folder, ["a.tif"])
    weights = shutil.copyfile(WEIGHTS, folder / "w.npz")
    words = ["map", folder / "a.tif", "--estimator", f"segment-transformer@{weights}"]
    return Scene(words, [folder / "a.tif", weights], {"--output": ".tif"})


def points(folder: Path) -> Scene:
    motion, table = make_motion(folder / "m.json"), folder / "t.csv"
    table.write_text("x,y\n1,2\n")
    return Scene(["points", motion, table], [motion, table], {"--output": ".csv"})


VIDEO = {"--output": ".mp4", "--save-motion": ".json", "--preview": ".png", "--plot": ".png", "--json-log": ".jsonl"}


def film(folder: Path) -> Scene:
    film = clips.write(folder / "a.mp4", clips.moving(6)[1])
    words = ["video", film, "--readout-ratio", "0.6"]
    return Scene(words, [film], VIDEO, {"--output": folder / "out.mp4"})


def film_by_motion(folder: Path) -> Scene:
    scene = film(folder)
    motion = folder / "m.json"
    assert main([*map(str, scene.words), "-o", str(folder / "first.mp4"), "--save-motion", str(motion)]) == 0
    words = ["video", *scene.inputs, "--motion", motion]
    return Scene(words, [*scene.inputs, motion], VIDEO, scene.needed)


def frames(folder: Path, pattern: str = "") -> Scene:
    (folder / "in").mkdir()
    made = clips.write(folder / "a.mp4", clips.moving(6)[1])
    assert main(["video", str(made), "-o", str(folder / "in" / "%05d.png"), "--readout-ratio", "0.6"]) == 0
    words = ["video", folder / "in" / pattern, "--readout-ratio", "0.6"]
    ends = {**VIDEO, "--output": ".png"}
    return Scene(words, sorted((folder / "in").iterdir()), ends, {"--output": folder / "out"})


def pattern(folder: Path) -> Scene:
    return frames(folder, "%05d.png")


def evaluate(folder: Path) -> Scene:
    make_photos(folder, ["in/a.jpg"])
    words = ["evaluate", "--data", folder / "in", "--estimators", "none", "--photos", 1, "--per-photo", 1]
    return Scene([*words, "--jobs", 1], [folder / "in" / "a.jpg"], {"--output": ""})


def synthesize(folder: Path) -> Scene:
    make_photos(folder, ["in/a.jpg"])
    words = ["synthesize", folder / "in", "--size", 64, "--canvas", 70]
    return Scene(words, [folder / "in" / "a.jpg"], {"--output": ""}, overwrite=())


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
    return Scene(["train", "--config", folder / "tiny.toml"], [folder / "tiny.toml"], {"--out": ""}, overwrite=())


def calibrate(folder: Path) -> Scene:
    make_photos(folder, [f"{name}/{name}.jpg" for name in ("val", "train", "ordinary")])
    log = folder / "trajectories" / "log.npz"
    log.parent.mkdir()
    np.savez(log, t_s=np.arange(300) / 100, gyro_rad_s=np.zeros((300, 3)))
    inputs = [*sorted(folder.rglob("*.jpg")), log]
    return Scene(["calibrate", folder, "--jobs", 1], inputs, {"--output": ""})


SCENES: dict[str, list[Callable[[Path], Scene]]] = {
    "rectify": [photo, photos, neighbours],
    "estimate": [estimate],
    "map": [map_photo],
    "points": [points],
    "video": [film, film_by_motion, frames, pattern],
    "evaluate": [evaluate],
    "synthesize": [synthesize],
    "train": [train],
    "calibrate": [calibrate],
}
ELSEWHERE = {("serve", "--folder")}  # test_the_page_never_takes_a_name_that_is_there (tests/cli/test_outputs.py)
NEEDS = {film: "av", film_by_motion: "av", frames: "av", pattern: "av", evaluate: "matplotlib", train: "torch"}
NEEDS |= {calibrate: "sklearn"}
