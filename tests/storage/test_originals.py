"""No original is written through Python, whatever it was called when it was read, and wherever it is now."""

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import unshutter
from support.covering import covering
from support.drawn_photos import drawn, encoded, one_line
from unshutter import Photo, RowMotion, UnshutterError

MOTION = RowMotion.from_polynomials([0, 20], [0], 200, 300)
NAMES = ("n0.jpg", "n1.jpg", "n2.jpg")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with photos, another folder, and nothing else."""
    for k, name in enumerate(NAMES):
        (tmp_path / name).write_bytes(encoded(np.roll(drawn(200, 300), 3 * k, axis=1), "JPEG"))
    (tmp_path / "sub").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder: Path) -> set[bytes]:
    return {path.read_bytes() for path in folder.rglob("*.jpg")}


def stays() -> str:
    return "n1.jpg"


def other_folder() -> str:
    os.chdir("sub")
    return "../n1.jpg"


def renamed() -> str:
    os.rename("n1.jpg", "later.jpg")
    return "later.jpg"


def linked() -> str:
    os.symlink("n1.jpg", "link.jpg")
    return "link.jpg"


def second_name() -> str:
    os.link("n1.jpg", "second.jpg")
    return "second.jpg"


def in_renamed_folder() -> str:
    os.rename("n1.jpg", "sub/n1.jpg")
    os.rename("sub", "moved")
    return "moved/n1.jpg"


def with_name() -> io.BytesIO:
    stream = io.BytesIO(Path("n1.jpg").read_bytes())
    stream.name = "n1.jpg"  # as uploads and archives have
    return stream


def mapped() -> np.ndarray:
    return np.memmap("n1.jpg", np.uint8, "r", shape=(64, 64))


GIVEN: dict[str, Callable[[], Any]] = {
    "name": lambda: "n1.jpg",
    "path": lambda: Path("n1.jpg").resolve(),
    "stream": lambda: open("n1.jpg", "rb"),  # noqa: SIM115
    "descriptor": lambda: os.fdopen(os.open("n1.jpg", os.O_RDONLY), "rb"),
    "named bytes": with_name,
    "Photo": lambda: Photo.open("n1.jpg"),
    "Pillow": lambda: Image.open("n1.jpg"),
    "memory map": mapped,
}
RESULTS: dict[str, Callable[[Any], Any]] = {
    "changed": lambda given: unshutter.rectify(given, motion=MOTION, edges="keep"),
    "unchanged": lambda given: unshutter.rectify(given, estimator="none"),
    "its photo": lambda given: unshutter.rectify(given, motion=MOTION, edges="keep").photo,
    "its original": lambda given: unshutter.rectify(given, estimator="none").original,
    "first of frames": lambda given: next(iter(frames("n0.jpg", given))),
    "frame from an iterator": lambda given: next(frames(*iter([given, "n2.jpg"]))),
}


def frames(*given: Any) -> Any:
    return unshutter.rectify_frames([*given], readout_ratio=0.7, model="camera")


@pytest.mark.skipif(os.name == "nt", reason="needs links")
@pytest.mark.parametrize(
    ("given", "move"),
    covering(list(GIVEN), [stays, other_folder, renamed, linked, second_name, in_renamed_folder]),
)
def test_what_a_result_was_made_from(given: str, move: Callable[[], str], here: Path) -> None:
    before = contents(here)
    argument = GIVEN[given]()
    if given == "memory map":
        results = {"changed": unshutter.rectify(argument, estimator="none")}
    else:
        results = {}
        for name, make in RESULTS.items():
            results[name] = make(argument)
            if given in ("stream", "descriptor", "named bytes"):
                argument.seek(0)
    target = move()
    for result in results.values():
        with pytest.raises(UnshutterError, match="never overwritten") as error:
            result.save(target, overwrite=True)
        one_line(error)
        if move not in (renamed, in_renamed_folder):
            result.save(here / "free.jpg")
            (here / "free.jpg").unlink()
    if hasattr(argument, "close"):
        argument.close()
    assert contents(here) == before


@pytest.mark.parametrize("listed", [True, False], ids=["list", "iterator"])
def test_no_frame_of_a_call_is_replaced_by_the_result_of_another(listed: bool, here: Path) -> None:
    before = contents(here)
    given = [here / name for name in NAMES]
    for result in unshutter.rectify_frames(given if listed else iter(given), readout_ratio=0.7, model="camera"):
        for name in NAMES if listed else NAMES[:2]:  # an iterator does not tell what is still to come
            with pytest.raises(UnshutterError, match="never overwritten"):
                result.save(name, overwrite=True)
    assert contents(here) == before


def test_a_motion_replaces_a_motion_and_nothing_else(here: Path) -> None:
    os.rename("n1.jpg", "n1.json")
    photo = Path("n1.json").read_bytes()
    motion = unshutter.estimate("n1.json", estimator="none")
    with pytest.raises(UnshutterError, match="another file, not a motion") as error:
        motion.save("n1.json")
    one_line(error)
    assert Path("n1.json").read_bytes() == photo
    motion.save("motion.json")
    MOTION.save("motion.json")
    assert unshutter.Motion.load("motion.json") == MOTION


def test_the_motion_file_of_a_result(here: Path) -> None:
    MOTION.save("motion.json")
    os.rename("motion.json", "motion.png")
    result = unshutter.rectify("n1.jpg", motion="motion.png")
    with pytest.raises(UnshutterError, match="never overwritten"):
        result.save("motion.png", overwrite=True)


def test_a_new_file_with_the_inode_of_a_removed_original_can_be_replaced(here: Path) -> None:
    result = unshutter.rectify("n1.jpg", motion=MOTION, edges="keep")
    _ = result.pixels
    os.remove("n1.jpg")
    for _ in range(3):
        result.save("result.jpg", overwrite=True)
        result.save("n1.jpg", overwrite=True)  # which nothing has lost
        os.remove("n1.jpg")
