"""Where results go: names that cannot clash, and no name for two things."""

import itertools
import os
import sys
from pathlib import Path

import pytest

from support.batches import make_photos, rectify, results
from unshutter import RowMotion, UsageError
from unshutter.cli import main
from unshutter.run.inputs import find_photos, video_name
from unshutter.run.plan import Goal, motion_targets


def names(*photos: str) -> dict[str, str]:
    given = [Path(photo) for photo in photos]
    inputs = find_photos(given)
    return {str(photo): target.name for photo, target in motion_targets(inputs, Goal("motions")).items()}


def test_motion_files_are_named_after_their_photos() -> None:
    assert names("a.jpg", "b.png", "c.heic", "d.dng") == {
        "a.jpg": "a.json", "b.png": "b.json", "c.heic": "c.heic.json", "d.dng": "d.dng.json",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("photos", "expected"),
    [
        (("a.jpg", "a.png"), {"a.jpg.json", "a.png.json"}),
        (("a.jpg", "A.png"), {"a.jpg.json", "A.png.json"}),  # one name to some file systems
        (("a.jpg", "a.png", "a.jpg.png"), {"a.jpg.json", "a.png.json", "a.jpg.png.json"}),
        (("a.jpg", "a.jpg.png"), {"a.json", "a.jpg.png.json"}),
        (("a.jpg", "a.heic"), {"a.json", "a.heic.json"}),
        (("a.heic", "a.heic.jpg"), {"a.heic.json", "a.heic.jpg.json"}),
    ],
)
def test_motion_files_never_clash_whatever_the_order(photos: tuple[str, ...], expected: set[str]) -> None:
    found = [names(*order) for order in itertools.permutations(photos)]
    assert set(found[0].values()) == expected
    assert all(other == found[0] for other in found)


def test_photos_of_two_formats_in_one_folder(motion: Path, tmp_path: Path) -> None:
    make_photos(tmp_path / "in", ["a.jpg", "a.png", "b.jpg", "trip/a.jpg"])
    out = tmp_path / "out"
    assert rectify(tmp_path / "in", "-o", out, "--motion", motion, "--save-motion", out) == 0
    found = sorted(path.relative_to(out).as_posix() for path in out.rglob("*.json"))
    assert found == ["a.jpg.json", "a.png.json", "b.json", "trip/a.json"]
    assert main(["estimate", str(tmp_path / "in"), "-o", str(tmp_path / "found"), "--estimator", "none"]) == 0
    assert (
        sorted(path.relative_to(tmp_path / "found").as_posix() for path in (tmp_path / "found").rglob("*.json"))
        == found
    )


@pytest.mark.parametrize("stem", ["漢" * 83 + "ab", "x" * 250 + "\udcff"], ids=["text", "no text"])
@pytest.mark.skipif(sys.platform != "linux", reason="names of files are limited otherwise")
def test_a_name_without_room_for_an_ending_is_cut(stem: str, motion: Path, tmp_path: Path) -> None:
    make_photos(tmp_path, ["a.jpg"])
    photo = (tmp_path / "a.jpg").rename(tmp_path / f"{stem}.jpg")
    assert rectify(photo, "--motion", motion) == 0
    assert main(["estimate", str(photo), "--estimator", "none", "-o", f"{tmp_path}/motions"]) == 0
    (result,) = set(tmp_path.glob("*.jpg")) - {photo}
    (found,) = (tmp_path / "motions").glob("*.json")
    assert result.name == video_name(photo) and result.name.endswith(".rectified.jpg")
    assert all(250 < len(os.fsencode(each.name)) <= 255 for each in (result, found))


@pytest.mark.parametrize(
    "words",
    [
        ["-o", "{}/out.png", "--json-log", "{}/out.png"],
        ["-o", "{}/out.png", "--preview", "{}/out.png"],
        ["-o", "{}/out.png", "--save-motion", "{}/log.json", "--json-log", "{}/log.json"],
        ["-o", "{}/out", "--json-log", "{}/out/unshutter-manifest.jsonl", "{}/b.jpg"],
        ["--preview", "{}/a.rectified.jpg"],
    ],
)
def test_one_name_for_two_things_is_refused(words: list[str], motion: Path, tmp_path: Path, capsys) -> None:
    make_photos(tmp_path, ["a.jpg", "b.jpg"])
    before = results(tmp_path)
    arguments = [word.format(tmp_path) for word in words]
    assert rectify(tmp_path / "a.jpg", "--motion", motion, "--overwrite", *arguments) == 2
    errors = capsys.readouterr().err
    assert "would be both" in errors and errors.count("\n") == 1
    assert results(tmp_path) == before


@pytest.mark.parametrize("words", [["rectify", "--save-motion"], ["estimate", "-o"]])
@pytest.mark.parametrize("name", ["a.MOV", "m.png", "{}.JPG"])
def test_a_motion_is_a_json_file(words: list[str], name: str, tmp_path: Path, capsys) -> None:
    make_photos(tmp_path, ["a.jpg"])
    command, option = words
    assert main([command, str(tmp_path / "a.jpg"), option, str(tmp_path / name), "--estimator", "none"]) == 2
    assert f"a motion is a .json file, not {name}" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["a.jpg"]
    with pytest.raises(UsageError, match=r"a motion is a \.json file"):
        RowMotion.zero(10, 10).save(tmp_path / name)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["rectify", "-o", "one.png"], "one.png"),
        (["rectify", "-o", "out", "--save-motion", "m.json"], "m.json"),
        (["rectify", "-o", "out", "--masks", "m.PNG"], "m.PNG"),
        (["estimate", "-o", "one.json"], "one.json"),
    ],
)
def test_several_photos_do_not_go_into_a_folder_with_the_name_of_a_file(
    words: list[str], name: str, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_photos(tmp_path, ["a.png", "b.png"])
    monkeypatch.chdir(tmp_path)
    assert main([*words, "a.png", "b.png", "--estimator", "none"]) == 2
    told = capsys.readouterr().err
    assert f"need a folder, but {name} is the name of a file" in told and told.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.png"]
    (tmp_path / name).mkdir()  # unless there is such a folder
    assert main([*words, "a.png", "b.png", "--estimator", "none"]) == 0


def test_a_slash_says_that_a_folder_is_meant(tmp_path: Path) -> None:
    make_photos(tmp_path, ["a.png", "b.png"])
    assert rectify(tmp_path / "a.png", tmp_path / "b.png", "-o", f"{tmp_path}/one.png/", "--estimator", "none") == 0
    assert sorted(results(tmp_path / "one.png")) == ["a.png", "b.png"]


@pytest.mark.parametrize("more", [[], ["--overwrite"], ["--dry-run"], ["--masks", "masks"], ["--jobs", "1"]], ids=str)
@pytest.mark.parametrize("other", ["y/demo.rectified.jpg", "x/demo.rectified.jpg"])
def test_a_copy_never_replaces_a_result(other: str, more: list[str], tmp_path: Path, monkeypatch, capsys) -> None:
    """A photo that may stay unchanged is copied under its own name, which is that of another photo's result."""
    monkeypatch.chdir(tmp_path)
    make_photos(tmp_path, ["x/demo.jpg", other])
    for photos in (["x/demo.jpg", other], [other, "x/demo.jpg"]):
        assert rectify(*photos, "-o", "out", "--estimator", "none", *more) == 2
        error = capsys.readouterr().err
        assert "could both be written to out" in error
        assert "leave out one of them, or give it a run and a folder of its own" in error
        assert not (tmp_path / "out").exists()
    assert rectify("x/demo.jpg", "-o", "out/", "--estimator", "none") == 0
    assert rectify(other, "-o", "other/", "--estimator", "none") == 0
    assert len(list(tmp_path.glob("o*/*.jpg"))) == 2
