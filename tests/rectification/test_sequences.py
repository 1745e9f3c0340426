"""Photos with neighbours, from Python and from the command line."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import unshutter
from support.drawn_photos import one_line
from support.frame_pairs import Scene, off
from unshutter.cli import main
from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.usual_ratio import usual_ratio
from unshutter.photo import Photo

RATIO = 0.8
SCENE = Scene(speed=(20, 3))
FRAMES = [SCENE.frame(number, RATIO) for number in range(3)]


@pytest.fixture
def shot(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"shot_{number}.png" for number in range(3)]
    for path, frame in zip(paths, FRAMES, strict=True):
        Photo.from_array(frame).save(path)
    return paths


# ---- from Python --------------------------------------------------------------------------------------------


def test_every_frame_of_a_sequence() -> None:
    results = list(unshutter.rectify_frames(FRAMES, readout_ratio=RATIO, reference="middle", edges="fill"))
    assert len(results) == 3
    for number, picture in enumerate(results):
        truth = SCENE.at(number + RATIO / 2)
        inner = np.s_[10:-10, 25:-25]
        assert off(FRAMES[number][inner], truth[inner]) > 8
        assert off(picture.array[inner], truth[inner]) < 1.5


def test_frames_are_taken_as_they_are_needed() -> None:
    taken = []

    def camera():
        for number, frame in enumerate(FRAMES):
            taken.append(number)
            yield frame

    results = unshutter.rectify_frames(camera(), readout_ratio=RATIO)
    next(results)
    assert taken == [0, 1]
    next(results)
    assert taken == [0, 1, 2]


def test_readout_time_and_frame_rate_say_the_ratio() -> None:
    first = next(unshutter.rectify_frames(FRAMES, readout_ms=16, fps=50))
    np.testing.assert_array_equal(first.array, next(unshutter.rectify_frames(FRAMES, readout_ratio=RATIO)).array)


def test_slow_motion() -> None:
    for at in (0.25, 0.5, 0.75):
        first = next(unshutter.rectify_frames(FRAMES[:2], readout_ratio=RATIO, at=at, edges="fill"))
        assert off(first.array[10:-10, 25:-25], SCENE.at(at)[10:-10, 25:-25]) < 1.5


@pytest.mark.parametrize(("readout", "turns"), [("bottom-to-top", 2), ("left-to-right", 1), ("right-to-left", 3)])
def test_other_readout_directions_are_the_same_turned(readout, turns) -> None:
    turned = [np.ascontiguousarray(np.rot90(frame, turns)) for frame in FRAMES[:2]]
    results = next(unshutter.rectify_frames(turned, readout_ratio=RATIO, readout=readout, edges="fill"))
    upright = next(unshutter.rectify_frames(FRAMES[:2], readout_ratio=RATIO, edges="fill"))
    np.testing.assert_allclose(np.rot90(results.array, -turns), upright.array, atol=1)


def test_paths_give_what_can_be_saved(shot: list[Path], tmp_path: Path) -> None:
    results = next(unshutter.rectify_frames(shot, readout_ratio=RATIO))
    assert results.original.path == shot[0]
    assert results.valid.mean() > 0.8
    results.save(tmp_path / "out.png")
    np.testing.assert_array_equal(Photo.open(tmp_path / "out.png").pixels, results.pixels)


def test_grey_pixels_stay_grey() -> None:
    grey = [frame[..., 0] for frame in FRAMES[:2]]
    assert next(unshutter.rectify_frames(grey, readout_ratio=RATIO)).array.shape == grey[0].shape


@pytest.mark.parametrize(
    ("frames", "options", "message"),
    [
        (FRAMES, {"readout_ratio": 0.5, "model": "curved"}, "choose camera or dense"),
        (FRAMES, {"readout_ratio": 0.5, "model": "dense", "strength": 0.5}, "leave out strength"),
        (FRAMES, {"readout_ratio": 0.5, "model": "camera", "edges": "borrow"}, "leave out model camera"),
        (FRAMES, {"readout_ratio": 0.5, "at": 0.5, "strength": 0.5}, "leave out strength"),
        (FRAMES, {"readout_ratio": 1.5}, "above 0 and at most 1"),
        (FRAMES, {"readout_ratio": 0.5, "fps": 30}, "give readout_ratio, or"),
        (FRAMES, {"fps": 30}, "give both"),
        (FRAMES, {"readout_ratio": 0.5, "at": 2}, "between -1 and 1"),
        (FRAMES, {"readout_ratio": 0.5, "edges": "bend"}, "edges must be one of auto, keep, crop, fill"),
        (FRAMES[:1], {"readout_ratio": 0.5}, "at least two frames"),
    ],
)
def test_requests_that_cannot_be(frames, options, message) -> None:
    with pytest.raises(UsageError) as error:
        list(unshutter.rectify_frames(frames, **options))
    assert message in one_line(error)


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (FRAMES[1][:-2], "240x160 px but the photo has 240x158 px"),
        (FRAMES[1][..., 0], "3 bands but the photo has 1"),
        (FRAMES[1].astype(np.uint16) * 257, "8 bits but the photo has 16 bits"),
    ],
)
def test_frames_that_are_not_alike(second, message) -> None:
    with pytest.raises(UnshutterError) as error:
        list(unshutter.rectify_frames([FRAMES[0], second], readout_ratio=RATIO, model="dense"))
    assert message in one_line(error)


# ---- from the command line ----------------------------------------------------------------------------------


def test_a_photo_and_its_neighbours(shot: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "out.png"
    words = ["rectify", str(shot[1]), "--before", str(shot[0]), "--after", str(shot[2]), "-o", str(out)]
    assert main([*words, "--readout-ratio", str(RATIO), "--reference", "middle", "--edges", "borrow"]) == 0
    results, truth = Photo.open(out).pixels, SCENE.at(1 + RATIO / 2)
    assert off(results, truth) < off(FRAMES[1], truth) / 2
    # the same as from Python
    again = list(unshutter.rectify_frames(shot, readout_ratio=RATIO, reference="middle", edges="borrow"))[1]
    np.testing.assert_array_equal(again.pixels, results)


def test_a_photo_that_says_nothing_is_straightened_by_its_neighbour_as_advised(
    shot: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.png"
    words = ["rectify", str(shot[1]), "-o", str(out)]
    assert main(words) == 0
    alone = capsys.readouterr().err
    assert "left unchanged" in alone and "with a frame taken just before or after: --before or --after" in alone
    assert (
        main([*words, "--before", str(shot[0]), "--readout-ratio", str(RATIO), "--edges", "fill", "--overwrite"]) == 0
    )
    told = capsys.readouterr().err
    assert "left unchanged" not in told and "just before" not in told
    assert off(Photo.open(out).pixels, FRAMES[1]) > 5


@pytest.mark.parametrize("neighbours", [{"--before": 0}, {"--after": 2}, {"--before": 0, "--after": 2}])
def test_without_a_ratio_neighbours_do_what_a_sequence_does(
    shot: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], neighbours: dict[str, int]
) -> None:
    words = [word for side, number in neighbours.items() for word in (side, str(shot[number]))]
    alike = ["--edges", "keep"]
    assert main(["rectify", str(shot[1]), *words, *alike, "-o", str(tmp_path / "one.png")]) == 0
    assert "; readout ratio 0.500 +- 0.250 (from usual value)" in capsys.readouterr().err
    frames = [str(shot[k]) for k in sorted({1, *neighbours.values()})]
    assert main(["rectify", *frames, "--sequence", *alike, "-o", str(tmp_path / "all")]) == 0
    assert "unshutter: readout ratio 0.500 +- 0.250 (from usual value)" in capsys.readouterr().err
    of_sequence = tmp_path / "all" / f"{shot[1].stem}.rectified.png"
    assert (tmp_path / "one.png").read_bytes() == of_sequence.read_bytes()
    # from Python, too
    opened = [Photo.open(frame) for frame in frames]
    again = list(unshutter.rectify_frames(opened, edges="keep"))[frames.index(str(shot[1]))]
    np.testing.assert_array_equal(again.pixels, Photo.open(of_sequence).pixels)


def test_photos_with_times_take_what_is_usual_for_their_camera(tmp_path: Path) -> None:
    photos = []
    for number in range(2):
        exif = Image.Exif()
        exif.update({0x010F: "Apple", 0x0110: "iPhone 12"})
        exif.get_ifd(0x8769).update({0x9003: "2024:05:06 07:08:09", 0x9291: f"{100 + 100 * number}"})
        Image.fromarray(FRAMES[number]).save(tmp_path / f"{number}.png", exif=exif)
        photos.append(Photo.open(tmp_path / f"{number}.png"))
    assert usual_ratio(photos).value == pytest.approx(0.7 * 20 / 100)


def test_crop_leaves_nothing_black(shot: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "out.png"
    words = ["rectify", str(shot[0]), "--after", str(shot[1]), "--readout-ratio", str(RATIO), "-o", str(out)]
    assert main([*words, "--edges", "crop"]) == 0
    cropped = Photo.open(out)
    assert cropped.width < 240
    assert cropped.pixels.max(axis=-1).min() > 0


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--after", "{1}", "--readout-ratio", "0"], 2, "above 0 and at most 1"),
        (["--after", "{folder}/none.png", "--readout-ratio", "1"], 1, "No such file"),
        (["--after", "{1}", "--readout-ratio", "1", "--at", "0.5", "--reference", "first"], 2, "choose one"),
        (["--after", "{1}", "--readout-ratio", "1", "--model", "dense", "--strength", "0.5"], 2, "leave out"),
        (["--after", "{1}", "--readout-ratio", "1", "--at", "0.5", "--save-motion", "m.json"], 2, "needs a motion"),
        (["--after", "{1}", "--readout-ratio", "1", "--roll-deg", "5"], 2, "for single photos"),
        (["{2}", "--after", "{1}", "--readout-ratio", "1"], 2, "neighbours of one photo, but there are 2"),
        (["--readout-ratio", "1"], 2, "name one with --before or --after"),
        (["--at", "0.5"], 2, "name one with --before or --after"),
        (["--edges", "borrow"], 2, "needs a neighbour"),
    ],
)
def test_one_clear_line(shot: list[Path], capsys: pytest.CaptureFixture[str], words, code, message) -> None:
    flags = [word.format(*shot, folder=shot[0].parent) for word in words]
    before = sorted(path.name for path in shot[0].parent.iterdir())
    assert main(["rectify", str(shot[0]), *flags]) == code
    message_shown = capsys.readouterr().err.strip()
    assert message in message_shown
    assert "Traceback" not in message_shown
    assert message_shown.count("\n") == 0
    assert sorted(path.name for path in shot[0].parent.iterdir()) == before


@pytest.mark.parametrize("neighbour", [1, 2])
def test_neighbours_are_never_written_over(shot: list[Path], neighbour, capsys: pytest.CaptureFixture[str]) -> None:
    names = [path.read_bytes() for path in shot]
    words = ["--before", str(shot[1]), "--after", str(shot[2]), "--readout-ratio", "1", "--overwrite"]
    assert main(["rectify", str(shot[0]), *words, "-o", str(shot[neighbour])]) != 0
    assert [path.read_bytes() for path in shot] == names
    assert capsys.readouterr().err.strip().count("\n") == 0
