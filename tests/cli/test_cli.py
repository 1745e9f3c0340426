"""The commands as a user runs them, in this process; and the same from Python."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

import unshutter
from unshutter.cli import command_for_file, main
from unshutter.errors import UsageError
from unshutter.frames.pyav import VIDEO_FORMATS
from unshutter.options.picture_formats import SUFFIXES
from unshutter.page.settings import page_module
from unshutter.photo import Photo
from unshutter.run.inputs import find_photos


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    message = capsys.readouterr().err.strip()
    assert message.count("\n") == 0, message
    assert "Traceback" not in message
    assert message.startswith("unshutter: ")
    return message


# ---- rectify ------------------------------------------------------------------------------------------------


def test_the_result_lies_beside_the_original_which_is_untouched(photo: Path) -> None:
    before = digest(photo)
    assert main(["rectify", str(photo), "--edges", "keep"]) == 0
    assert digest(photo) == before
    assert sorted(p.name for p in photo.parent.iterdir()) == ["street.jpg", "street.rectified.jpg"]
    result = Photo.open(photo.parent / "street.rectified.jpg").to_array()
    assert result.shape == Photo.open(photo).to_array().shape
    assert np.abs(result.astype(int) - Photo.open(photo).to_array()).mean() > 1


def test_output_motion_and_edges(photo: Path) -> None:
    out, motion = photo.parent / "out.png", photo.parent / "m.json"
    assert main(["rectify", str(photo), "-o", str(out), "--save-motion", str(motion), "--edges", "crop"]) == 0
    saved = unshutter.Motion.load(motion)
    cropped = Photo.open(out)
    assert cropped.width < saved.width
    assert cropped.width / cropped.height == pytest.approx(saved.width / saved.height, rel=0.02)
    # the same motion, given, gives the same picture
    again = photo.parent / "again.png"
    assert main(["rectify", str(photo), "-o", str(again), "--motion", str(motion), "--edges", "crop"]) == 0
    np.testing.assert_allclose(Photo.open(again).to_array(), cropped.to_array(), atol=1)


def test_a_single_photo_into_a_new_folder(photo: Path) -> None:
    assert main(["rectify", str(photo), "-o", f"{photo.parent}/straight/"]) == 0
    assert [p.name for p in (photo.parent / "straight").iterdir()] == ["street.rectified.jpg"]


def test_strength_zero_changes_nothing(photo: Path) -> None:
    out = photo.parent / "same.png"
    assert main(["rectify", str(photo), "-o", str(out), "--strength", "0"]) == 0
    np.testing.assert_array_equal(Photo.open(out).to_array(), Photo.open(photo).to_array())


def test_reference_row_reaches_the_motion(photo: Path) -> None:
    motion = photo.parent / "m.json"
    arguments = ["-o", str(photo.parent / "o.png"), "--save-motion", str(motion), "--reference", "middle"]
    assert main(["rectify", str(photo), *arguments]) == 0
    saved = unshutter.Motion.load(motion)
    assert saved.reference == "middle"
    assert saved.tx_px[saved.reference_row] == 0


def test_existing_outputs_need_overwrite(photo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = photo.parent / "out.jpg"
    out.write_bytes(b"precious")
    assert main(["rectify", str(photo), "-o", str(out)]) == 1
    assert "--overwrite" in one_line(capsys)
    assert out.read_bytes() == b"precious"
    assert main(["rectify", str(photo), "-o", str(out), "--overwrite"]) == 0
    assert Photo.open(out).format == "jpeg"


def test_a_batch_goes_on_past_bad_files_and_counts_them(photo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = photo.parent
    (folder / "broken.jpg").write_bytes(photo.read_bytes()[:2000])
    (folder / "text.jpg").write_text("hello")
    (folder / "notes.txt").write_text("not a photo, not meant")
    (folder / "b.png").write_bytes(b"")
    Photo.open(photo).save(folder / "z.png")
    out = folder / "out"
    assert main(["rectify", str(folder), "-o", str(out)]) == 1
    errors = capsys.readouterr().err
    assert "3 of 5 photos failed" in errors
    assert "Traceback" not in errors
    assert sorted(p.name for p in out.glob("*.[jp]*g")) == ["street.rectified.jpg", "z.rectified.png"]


def test_two_photos_never_share_an_output(photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / photo.name).write_bytes(photo.read_bytes())
    assert main(["rectify", str(photo), str(other / photo.name), "-o", str(tmp_path / "out")]) == 2
    assert "could both be written" in one_line(capsys)


def bad_inputs(folder: Path) -> dict[str, Path]:
    good = folder / "good.jpg"
    Photo.from_array(np.random.default_rng(0).integers(0, 255, (80, 90, 3), np.uint8)).save(good)
    made = {name: folder / f"{name}.jpg" for name in ("missing", "text", "empty", "truncated")}
    made["text"].write_text("I am no photo\n" * 50)
    made["empty"].write_bytes(b"")
    made["truncated"].write_bytes(good.read_bytes()[: good.stat().st_size // 2])
    for name, shape in {"dot": (1, 1), "stripe": (5000, 1), "sliver": (63, 500)}.items():
        made[name] = folder / f"{name}.png"
        Photo.from_array(np.zeros((*shape, 3), np.uint8)).save(made[name])
    made["folder"] = folder / "empty_folder"
    made["folder"].mkdir()
    return made


@pytest.mark.parametrize("command", ["rectify", "estimate"])
@pytest.mark.parametrize("case", ["missing", "text", "empty", "truncated", "dot", "stripe", "sliver", "folder"])
def test_bad_input_gets_one_line_and_leaves_nothing(
    command: str, case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bad_inputs(tmp_path)[case]
    before = sorted(tmp_path.rglob("*"))
    assert main([command, str(path)]) in (1, 2)
    assert str(path) in one_line(capsys)
    assert sorted(tmp_path.rglob("*")) == before


def test_bad_motions_get_one_line(photo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = json.loads(unshutter.RowMotion.zero(420, 560).to_json())
    cases = {
        "nan": {**good, "tx_px": [float("nan")] * 420},
        "short": {**good, "tx_px": [0.0] * 10},
        "shape": json.loads(unshutter.RowMotion.zero(560, 420).to_json()),
    }
    for name, data in cases.items():
        path = photo.parent / f"{name}.json"
        path.write_text(json.dumps(data))
        assert main(["rectify", str(photo), "--motion", str(path)]) == 1
        one_line(capsys)
    assert not (photo.parent / "street.rectified.jpg").exists()


def test_unwritable_outputs(photo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for target in (photo.parent / "none" / "out.jpg", photo / "out.jpg", Path("/proc/out.jpg")):
        assert main(["rectify", str(photo), "-o", str(target)]) == 1
        assert "cannot write" in one_line(capsys)
    assert main(["rectify", str(photo), "-o", str(photo.parent / "out.docx")]) == 2
    assert ".docx" in one_line(capsys)
    assert [p.name for p in photo.parent.iterdir()] == ["street.jpg"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["rectify"],
        ["rectify", "x.jpg", "--strength", "3"],
        ["rectify", "x.jpg", "--strength", "much"],
        ["rectify", "x.jpg", "--edges", "round"],
        ["rectify", "x.jpg", "--estimator", "magic"],
        ["rectify", "x.jpg", "--readout", "inwards"],
        ["rectify", "x.jpg", "--quality", "0"],
        ["rectify", "x.jpg", "--frobnicate"],
        ["levitate", "x.jpg"],
        ["estimate", "a.jpg", "b.jpg", "--json"],
    ],
)
def test_wrong_usage_exits_with_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    one_line(capsys)


@pytest.mark.parametrize("ending", VIDEO_FORMATS)
def test_every_video_goes_to_video(ending: str) -> None:
    """All parts of the program name videos by one list."""
    assert command_for_file(f"clip{ending.upper()}") == "video" and ending not in SUFFIXES
    with pytest.raises(UsageError, match="is a video, not a photo"):
        find_photos([f"clip{ending}"])
    videos = page_module().rpartition("export const videos = ")[2]
    assert ending in json.loads(videos.removesuffix(";\n"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["rectify", "x.jpg", "--upright"], "--upright needs a value: level, full"),
        (["video", "a.mp4", "b.mp4"], "takes one CLIP: leave out b.mp4"),
        (["a.mp4", "b.mp4", "c.mp4"], "takes one CLIP: leave out b.mp4 c.mp4"),
        (["serve", "a.jpg"], "takes options only: leave out a.jpg"),
        (["rectify", "x.jpg", "-k"], "unknown option -k: leave it out"),
    ],
)
def test_usage_that_is_wrong_says_what_is_right(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert one_line(capsys).startswith(f"unshutter: {said} (see unshutter ")


# ---- estimate, models, synthesize ---------------------------------------------------------------------------


def test_estimate_prints_a_line_or_json(photo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["estimate", str(photo)]) == 0
    told = capsys.readouterr()
    sure = r"confidence 0\.\d\d: \w+, typically off by [\d.]+ px"
    line = rf"{re.escape(str(photo))}: [a-z ]+, points moved by up to \d+ px, {sure}.*\n"
    assert re.fullmatch(line, told.out) and not told.err
    assert main(["estimate", str(photo), "-o", str(photo.with_name("m.json"))]) == 0
    written = capsys.readouterr()
    assert written.err == told.out.replace(f"{photo}:", f"{photo} -> {photo.with_name('m.json')}:") and not written.out
    assert main(["estimate", str(photo), "--readout-ms", "30"]) == 0
    assert re.search(r"; turned by up to \d+ deg/s, moved by up to \d+ px/s\n", capsys.readouterr().out)
    assert main(["estimate", str(photo), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["format"], data["height"], data["width"]) == ("unshutter-motion/1", 420, 560)
    assert len(data["tx_px"]) == 420


def test_estimate_many_into_a_folder_and_a_plot(photo: Path) -> None:
    Photo.open(photo).save(photo.parent / "second.png")
    out = photo.parent / "motions"
    assert main(["estimate", str(photo), str(photo.parent / "second.png"), "-o", str(out)]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["second.json", "street.json"]
    plot = photo.parent / "plot.png"
    words = ["estimate", str(photo), "-o", str(photo.parent / "m.json"), "--plot", str(plot)]
    assert main(words) == 0
    assert Photo.open(plot).width > 500
    plot.write_bytes(b"an old plot")
    assert main([*words, "--overwrite"]) == 0
    assert Photo.open(plot).width > 500


def test_estimators_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["models"]) == 0
    assert "segment-manhattan (default): " in capsys.readouterr().out


def test_synthesize_then_rectify_with_the_true_motion(
    tmp_path: Path, facade: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    Photo.from_array(facade).save(tmp_path / "house.png")
    out = tmp_path / "set"
    assert main(["synthesize", str(tmp_path / "house.png"), "-o", str(out), "--per-photo", "2", "--seed", "3"]) == 0
    (first, _) = sorted((out / "rs").iterdir())
    motion = out / "motion" / f"{first.stem}.json"
    back = tmp_path / "back.png"
    assert main(["rectify", str(first), "--motion", str(motion), "-o", str(back), "--edges", "keep"]) == 0
    truth = unshutter.Motion.load(motion)
    gs, rectified = (Photo.open(p).to_array().astype(float) for p in (out / "gs" / first.name, back))
    from unshutter.motion.warp import validity_mask

    inside = validity_mask(truth)
    assert np.abs(gs - rectified)[inside].mean() < 0.4 * np.abs(gs - Photo.open(first).to_array())[inside].mean()
    capsys.readouterr()
    assert main(["synthesize", str(tmp_path / "house.png"), "-o", str(out)]) != 0
    one_line(capsys)


# ---- from Python --------------------------------------------------------------------------------------------


def test_python_takes_files_bytes_and_arrays(photo: Path, rolling_facade: np.ndarray) -> None:
    by_path = unshutter.rectify(photo)
    assert by_path.found.estimator == "segment-manhattan"
    assert by_path.valid.shape == by_path.original.pixels.shape[:2]  # before any crop
    by_path.save(photo.parent / "a.png")
    data = unshutter.rectify(photo.read_bytes()).bytes
    assert Photo.from_bytes(data).format == "jpeg"
    array = unshutter.rectify(rolling_facade, edges="keep").array
    assert array.dtype == np.uint8
    assert array.shape == rolling_facade.shape
    grey = unshutter.rectify(rolling_facade[..., 1].copy(), edges="keep").array
    assert grey.shape == rolling_facade.shape[:2]
    deep = unshutter.rectify(rolling_facade.astype(np.uint16) * 257, edges="keep").array
    assert deep.dtype == np.uint16
    np.testing.assert_allclose(deep / 257, array, atol=1.5)


def test_python_names_what_is_wrong() -> None:
    with pytest.raises(unshutter.UnshutterError, match="uint8"):
        unshutter.rectify(np.zeros((100, 100, 3), np.int64))
    with pytest.raises(unshutter.UsageError, match="edges"):
        unshutter.rectify(np.zeros((100, 100, 3), np.uint8), edges="wavy")
    with pytest.raises(AttributeError, match="no attribute 'rectifi'"):
        unshutter.rectifi  # noqa: B018


def test_a_focal_length_beside_a_motion_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motion = tmp_path / "motion.json"
    unshutter.RowMotion.zero(100, 100).save(motion)
    assert main(["rectify", str(tmp_path / "x.jpg"), "--motion", str(motion), "--focal-px", "500"]) == 2
    assert "leave them out" in capsys.readouterr().err
    with pytest.raises(unshutter.UsageError, match="leave them out"):
        unshutter.rectify(np.zeros((100, 100), np.uint8), motion=unshutter.RowMotion.zero(100, 100), focal_px=500.0)


# ---- a file instead of a command ----------------------------------------------------------------------------


def test_a_photo_alone_is_rectified(photo: Path) -> None:
    out = photo.parent / "out.png"
    assert main([str(photo), "-o", str(out)]) == 0
    assert Photo.open(out).format == "png"


def test_a_missing_photo_alone_is_reported_as_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "street.jpg")]) == 1
    assert "No such file" in one_line(capsys)


@pytest.mark.parametrize("command", ["rectify", "estimate"])
def test_a_video_is_pointed_to_the_command_for_videos(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "walk.MP4").touch()
    assert main([command, str(tmp_path / "walk.MP4")]) == 2
    assert one_line(capsys).endswith(f"unshutter video {tmp_path}/walk.MP4")


@pytest.mark.parametrize("name", ["one.png", "one.gif"])
def test_one_file_for_several_photos_is_refused(
    name: str, photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    second = photo.with_name("second.jpg")
    second.write_bytes(photo.read_bytes())
    assert main(["rectify", str(photo), str(second), "-o", str(tmp_path / name)]) == 2
    assert "need a folder" in one_line(capsys)
    assert not (tmp_path / name).exists()


def test_a_bad_file_of_lines_is_blamed_instead_of_the_photo(photo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = photo.with_name("bad.json")
    kind = '{"format": "unshutter-lines/1", "lines": [{"kind": "sloping", "points": [[1, 2], [3, 4]]}]}'
    for content in (b"{}", b"\xff", kind.encode()):
        bad.write_bytes(content)
        assert main(["estimate", str(photo), "--lines", str(bad)]) in (1, 2)
        told = capsys.readouterr().err
        assert str(bad) in told and str(photo) not in told, told


@pytest.mark.parametrize("words", ["--estimator", "--edges", "--roll-deg", "--jobs", "--reference", "--{}"])
def test_a_long_value_is_shortened(words: str, photo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in (["rectify", str(photo), words.format("x" * 9000), "x" * 9000], ["x" * 9000]):
        assert main(command) == 2
        assert "xxx...xxx" in (told := capsys.readouterr().err) and len(told) < 900
