"""One policy of edges: photos, frames with neighbours, clips and the page's preview decide alike."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import unshutter
from support.frame_pairs import Scene
from support.shaken_scenes import drawn_scene, shake
from unshutter.errors import UnshutterError
from unshutter.motion import edges as edges_module
from unshutter.motion.edges import EdgePolicy
from unshutter.motion.grid import Tile
from unshutter.motion.warp import straighten
from unshutter.options import Neighbours, Undo
from unshutter.options.clip_options import ClipUndo
from unshutter.options.photo_options import Clock
from unshutter.page import photo_jobs as screen
from unshutter.page.opened import OpenFile
from unshutter.page.settings import PhotoOptions
from unshutter.photo import Photo
from unshutter.video.file.array_clip import ArrayClip
from unshutter.video.render.frame_warper import Warper, common_window

SIZE = (100, 200)


def leaving(share: float) -> Callable[[], Tile]:
    return lambda: Tile(0, 100, 0, round(200 * share))


@pytest.mark.parametrize(
    ("asked", "share", "decision"),
    [("auto", 0.81, "crop"), ("auto", 0.11, "crop"), ("auto", 0.0, "keep"), ("crop", 0.11, "crop")],
)
def test_a_crop_is_decided_by_what_it_leaves(asked: Any, share: float, decision: str) -> None:
    made = EdgePolicy(asked).decide(SIZE, leaving(share))
    assert (made.edges, made.area_left) == (decision, pytest.approx(share, abs=0.01))
    assert made.window == (leaving(share)() if decision == "crop" else Tile(0, 100, 0, 200))


@pytest.mark.parametrize("asked", ["keep", "fill", "borrow"])
def test_other_edges_look_for_no_crop(asked: Any) -> None:
    def never() -> Tile:
        raise AssertionError

    assert EdgePolicy(asked).decide(SIZE, never) == (asked, Tile(0, 100, 0, 200), None)


def test_the_error_says_how_much_would_be_left() -> None:
    with pytest.raises(UnshutterError, match="leave 5 % of the frame"):
        EdgePolicy("crop").decide(SIZE, leaving(0.05), "frame")


def test_automatic_edges_of_sequences_keep_coordinates_and_invent_nothing() -> None:
    frames = [Photo.from_array(Scene(speed=(20, 1)).frame(number, 0.8)) for number in range(2)]
    for model in ("dense", "camera"):
        (first, _) = unshutter.rectify_frames(frames, readout_ratio=0.8, model=model)
        assert first.edges == "keep" and first.array.shape == frames[0].pixels.shape
        outside = cv2.erode((~first.valid).astype(np.uint8), np.ones((5, 5))) > 0
        assert outside.sum() > 100 and not first.array[outside].any()


def _straightened(folder: Path) -> None:
    straighten(drawn_scene(90, 120), shake(90, 120), "crop")


def _with_neighbours(folder: Path) -> None:
    frames = [Scene(speed=(20, 3)).frame(number, 0.8) for number in range(2)]
    next(unshutter.rectify_frames(frames, readout_ratio=0.8, model="dense", edges="crop"))


def _as_a_clip(folder: Path) -> None:
    clip = ArrayClip.of(np.zeros((2, 90, 120), np.uint8), 1 / 30)
    assert clip is not None
    common_window(Warper(clip, ClipUndo(edges="crop")), [(shake(90, 120), None)])


def _on_the_page(folder: Path) -> None:
    paths = [folder / name / "photo.png" for name in ("a", "b")]
    for number, path in enumerate(paths):
        path.parent.mkdir()
        Photo.from_array(Scene(speed=(20, 3)).frame(number, 0.8)).save(path)
    neighbours = Neighbours(after=paths[1], clock=Clock(0.8), model="dense")
    screen.after(
        OpenFile("a", "photo", "a.png", paths[0], 10**9),
        PhotoOptions(undo=Undo(edges="crop"), neighbours=neighbours),
        320,
    )


@pytest.mark.parametrize("surface", [_straightened, _with_neighbours, _as_a_clip, _on_the_page])
def test_every_surface_asks_the_policy(
    surface: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders = [tmp_path / name for name in ("allowed", "refused")]
    for folder in folders:
        folder.mkdir()
    surface(folders[0])
    monkeypatch.setattr(edges_module, "LEAST_CROP", 0.9999)
    with pytest.raises(UnshutterError, match="cropping would leave"):
        surface(folders[1])
