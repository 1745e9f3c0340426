"""Numbers of hundreds of digits, and names that no file can have, are refused in one line by every way in."""

import inspect
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.covering import covering
from support.drawn_photos import drawn, encoded, one_line
from unshutter import Motion, Photo, RowMotion, UnshutterError, UsageError
from unshutter.cli import main
from unshutter.page import settings

HUGE = 10**400
MOTION = RowMotion.from_polynomials([0, 5], [0], 200, 300)


@pytest.fixture
def photo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "photo.jpg").write_bytes(encoded(drawn(200, 300), "JPEG"))
    (tmp_path / "clip.mp4").write_bytes(b"no clip")
    monkeypatch.chdir(tmp_path)
    return "photo.jpg"


KEYWORDS = [name for name in inspect.signature(unshutter.rectify).parameters if name not in ("photo", "no_film")]


@pytest.mark.parametrize(("name", "digits"), covering(KEYWORDS, [400, -400, 5000]))
def test_python(name: str, digits: int, photo: str) -> None:
    value = 10**digits if digits > 0 else -(10**-digits)
    with pytest.raises(UnshutterError) as error:
        unshutter.rectify(photo, **{name: value})
    assert len(one_line(error)) < 300


@pytest.mark.parametrize("method", ["grey", "screen_copy", "upright"])
def test_a_copy_is_never_enlarged(method: str, photo: str) -> None:
    assert getattr(Photo.open(photo), method)(HUGE).shape[:2] == (200, 300)


def test_a_strength_of_400_digits() -> None:
    with pytest.raises(UsageError, match="strength must lie between"):
        MOTION.scaled(HUGE)


FLAGS = ["quality", "jobs", "candidate", "max-pixels", "crf", "threads"]


@pytest.mark.parametrize(("flag", "command", "digits"), covering(FLAGS, ["rectify", "estimate", "video"], [400, 5000]))
def test_the_command_line(command: str, flag: str, digits: int, photo: str, capsys) -> None:
    assert main([command, photo, "-o", "out", f"--{flag}", "9" * digits]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not Path("out").exists()


@pytest.mark.parametrize("command", ["rectify", "estimate", "video"])
def test_at_least_one_pixel_is_allowed(command: str, photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    name = "clip.mp4" if command == "video" else photo
    assert main([command, name, "--max-pixels", "0"]) == 2
    assert "--max-pixels must be at least 1, got 0" in capsys.readouterr().err


def test_a_number_with_limits_says_them(photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rectify", photo, "-o", "out.jpg", "--quality", "9" * 400]) == 2
    assert "--quality must lie between 1 and 100" in capsys.readouterr().err


def test_no_more_processes_are_prepared_than_there_are_photos(photo: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A table with a place for each of so many ended in "File too large"."""
    Path("other.jpg").write_bytes(Path(photo).read_bytes())
    words = ["rectify", photo, "other.jpg", "-o", "out", "--estimator", "none", "--jobs", str(10**15)]
    assert main(words) == 0, capsys.readouterr().err
    assert len(list(Path("out").glob("*.jpg"))) == 2


@pytest.mark.parametrize("option", [each for each in settings.fields() if each.type in (int, float)], ids=str)
def test_the_page(option) -> None:
    for value in (str(HUGE), "9" * 5000):
        with pytest.raises(UsageError):
            settings.read({option.name: value}, Path)


def result() -> unshutter.Rectified:
    return unshutter.rectify("photo.jpg", estimator="none")


WAYS_IN: dict[str, Callable[[str], object]] = {
    "rectify": lambda name: unshutter.rectify(f"{name}.jpg"),
    "estimate": lambda name: unshutter.estimate(f"{name}.jpg"),
    "candidates": lambda name: unshutter.candidates(f"{name}.jpg"),
    "Photo.open": lambda name: Photo.open(f"{name}.jpg"),
    "save": lambda name: result().save(f"{name}.jpg"),
    "save over": lambda name: result().save(f"{name}.jpg", overwrite=True),
    "Photo.save": lambda name: result().photo.save(f"{name}.png"),
    "Motion.save": lambda name: MOTION.save(f"{name}.json"),
    "Motion.load": lambda name: Motion.load(f"{name}.json"),
    "motion": lambda name: unshutter.rectify("photo.jpg", motion=f"{name}.json"),
    "lines": lambda name: unshutter.estimate("photo.jpg", lines=f"{name}.json"),
    "load": lambda name: unshutter.load(name),
    "weights": lambda name: unshutter.load(f"segment-transformer@{name}"),
    "frames": lambda name: list(unshutter.rectify_frames([f"{name}.jpg"] * 2, readout_ratio=0.5)),
    "motions of frames": lambda name: list(unshutter.estimate_frames([f"{name}.jpg"] * 2, readout_ratio=0.5)),
    "clip": lambda name: unshutter.rectify_clip(f"{name}.mp4", "out.mp4"),
    "film": lambda name: unshutter.rectify_clip("clip.mp4", f"{name}.mp4"),
    "film's motion": lambda name: unshutter.rectify_clip("clip.mp4", "out.mp4", save_motion=f"{name}.json"),
    "log": lambda name: unshutter.rectify_clip("clip.mp4", "out.mp4", json_log=f"{name}.json"),
}


@pytest.mark.parametrize(("way", "name"), covering([*WAYS_IN], ["a\0b", "a\ud800b", "x" * 5000]))
def test_names_that_no_file_can_have(name: str, way: str, photo: str) -> None:
    before = sorted(os.listdir())
    with pytest.raises(UnshutterError) as error:
        WAYS_IN[way](name)
    one_line(error).encode()
    assert sorted(os.listdir()) == before


@pytest.mark.parametrize(("key", "value"), [("height", 200.5), ("width", 300.25), ("height", np.inf)])
def test_a_motion_has_whole_rows_and_columns(key: str, value: float) -> None:
    data = json.loads(MOTION.to_json())
    with pytest.raises(UnshutterError, match=r"whole number|not a usable motion"):
        Motion.from_json(json.dumps(data | {key: value}))
    assert Motion.from_json(json.dumps(data | {"height": 200.0})) == MOTION
