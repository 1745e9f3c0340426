"""Folders in, folders out: structure, resuming, what is done again and what is never touched."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

import unshutter
from support.batches import leftovers, make_motion, make_photos, rectify, results
from unshutter.cli import main
from unshutter.photo import Photo
from unshutter.storage.files import written_whole

MANIFEST = "unshutter-manifest.jsonl"


def stamps(folder: Path) -> dict[str, tuple[int, int]]:
    """What changes when a result is written anew."""
    found = [path for path in folder.rglob("*.rectified.*") if path.is_file()]
    return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in found}


def records(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / MANIFEST).read_text().splitlines()]


# ---- which files, and where to -------------------------------------------------------------------------------


def test_folders_are_gone_through_and_their_structure_is_kept(archive: Path, motion: Path, tmp_path: Path) -> None:
    (archive / ".thumbnails").mkdir()
    for passed_over in (".thumbnails/t.jpg", "._a.jpg", ".unshutter-0011223344556677.part.jpg", "a.rectified.jpg"):
        (archive / passed_over).write_bytes(b"not meant")
    (archive / "again").symlink_to(archive)  # a circle
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion) == 0
    expected = ["a.rectified.jpg", "b.rectified.png", "trip/a.rectified.jpg", "trip/day 2/c.rectified.webp"]
    assert list(results(tmp_path / "out")) == expected


def test_results_inside_the_archive_are_no_photos(archive: Path, motion: Path) -> None:
    out = archive / "straight"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    (out / "a.rectified.jpg").rename(out / "renamed.jpg")
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert sorted(results(out)) == sorted(
        ["a.rectified.jpg", "b.rectified.png", "renamed.jpg", "trip/a.rectified.jpg", "trip/day 2/c.rectified.webp"]
    )


def test_beside_the_photos_folders_are_gone_through_too(archive: Path, motion: Path) -> None:
    assert rectify(archive, "--motion", motion) == 0
    assert (archive / "trip/day 2/c.rectified.webp").exists()
    assert not (archive / MANIFEST).exists()


def test_motions_have_the_same_structure(archive: Path, motion: Path, tmp_path: Path) -> None:
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--save-motion", tmp_path / "motions") == 0
    found = sorted(p.relative_to(tmp_path / "motions").as_posix() for p in (tmp_path / "motions").rglob("*.json"))
    assert found == ["a.json", "b.json", "trip/a.json", "trip/day 2/c.json"]
    (tmp_path / "motions" / "b.json").unlink()  # a part of the result: without it, the photo is done again
    before = stamps(tmp_path / "out")
    assert rectify(archive, "-o", tmp_path / "out", "--motion", motion, "--save-motion", tmp_path / "motions") == 0
    after = stamps(tmp_path / "out")
    assert {name for name in after if after[name] != before[name]} == {"b.rectified.png"}
    assert (tmp_path / "motions" / "b.json").exists()


def test_estimate_goes_through_folders_too(archive: Path, tmp_path: Path) -> None:
    assert main(["estimate", str(archive), "-o", str(tmp_path / "out"), "--estimator", "none"]) == 0
    assert (tmp_path / "out/trip/day 2/c.json").exists()


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="the superuser can read everything")
def test_a_folder_that_cannot_be_read_counts_as_failed(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    (archive / "trip").chmod(0)
    try:
        assert rectify(archive, "-o", tmp_path / "out", "--motion", motion) == 1
    finally:
        (archive / "trip").chmod(0o755)
    assert "trip: Permission denied" in capsys.readouterr().err


# ---- going on ------------------------------------------------------------------------------------------------


def test_only_what_changed_is_done_again(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    first = stamps(out)
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert "4 finished already" in capsys.readouterr().err
    assert stamps(out) == first

    make_photos(archive, ["new.jpg"])
    Photo.from_array(np.full((72, 96, 3), 99, np.uint8)).save(archive / "b.png", overwrite=True)
    (out / "trip/a.rectified.jpg").unlink()
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    second = stamps(out)
    assert {n for n in second if second[n] != first.get(n)} >= {"new.rectified.jpg", "b.rectified.png"}
    assert (out / "trip/a.rectified.jpg").exists()
    assert second["c.rectified.webp"] == first["c.rectified.webp"]

    assert rectify(archive, "-o", out, "--motion", motion, "--edges", "fill") == 0
    third = stamps(out)
    assert all(third[name] != second[name] for name in second)


def test_other_weights_are_another_option(archive: Path, tmp_path: Path, capsys) -> None:
    shipped = Path(unshutter.__file__).parent / "weights" / "segment-transformer.npz"
    weights = tmp_path / "mine.npz"
    weights.write_bytes(shipped.read_bytes())
    for expected in ("4 of 4 photos done", "4 finished already", "4 of 4 photos done"):
        assert rectify(archive, "-o", tmp_path / "out", "--estimator", f"segment-transformer@{weights}") == 0
        assert expected in capsys.readouterr().err
        if "finished" in expected:
            os.utime(weights, (0, 0))


def test_overwrite_does_all_again(archive: Path, motion: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    first = stamps(out)
    assert rectify(archive, "-o", out, "--motion", motion, "--overwrite") == 0
    assert all(stamps(out)[name] != first[name] for name in first)


def test_what_others_left_in_the_folder_is_kept(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "a.rectified.jpg").write_bytes(b"somebody's")
    for _ in range(2):  # that it failed once is no permission
        assert rectify(archive, "-o", out, "--motion", motion) == 1
        errors = capsys.readouterr().err
        assert "--overwrite" in errors
        assert "1 of 4 photos failed" in errors
        assert (out / "a.rectified.jpg").read_bytes() == b"somebody's"
    # a result that somebody edited is theirs
    (out / "b.rectified.png").write_bytes(b"edited")
    assert rectify(archive, "-o", out, "--motion", motion) == 1
    assert "2 of 4 photos failed" in capsys.readouterr().err
    assert (out / "b.rectified.png").read_bytes() == b"edited"
    assert rectify(archive, "-o", out, "--motion", motion, "--overwrite") == 0
    assert Photo.open(out / "b.rectified.png").format == "png"


def test_another_archive_does_not_replace_the_first_ones_results(archive, motion, tmp_path, capsys) -> None:
    out, other = tmp_path / "out", tmp_path / "other"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    before = results(out)
    make_photos(other, ["x.jpg", "x2.jpg", "b.png"])  # b.png: another photo of the same name
    assert rectify(other, "-o", out, "--motion", motion) == 1
    assert "the result of another photo" in capsys.readouterr().err
    assert results(out)["b.rectified.png"] == before["b.rectified.png"]
    # the same archive in another place is still the same
    moved = archive.rename(tmp_path / "moved")
    assert rectify(moved, "-o", out, "--motion", motion) == 0
    assert "4 finished already" in capsys.readouterr().err


def test_a_result_that_was_begun_is_not_trusted(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    """As after a kill between the last byte and the last record: the file is there, the word is not.

    It is made once more, and stays if it is the same. If not, it is somebody's: that it was begun is no permission.
    """
    out = tmp_path / "out"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    whole = results(out)
    lines = (out / MANIFEST).read_text().splitlines(keepends=True)
    last = json.loads(lines[-1])["target"]
    (out / MANIFEST).write_text("".join(lines[:-1]) + lines[-1][:40])  # cut short, too
    cut = (out / MANIFEST).read_bytes()
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert "1 of 4 photos done" in capsys.readouterr().err
    assert results(out) == whole
    (out / MANIFEST).write_bytes(cut)
    (out / last).write_bytes(b"somebody's")
    assert rectify(archive, "-o", out, "--motion", motion) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert (out / last).read_bytes() == b"somebody's"
    (out / last).unlink()
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert results(out) == whole
    assert rectify(archive, "-o", out, "--motion", motion, "--dry-run") == 0


def test_a_damaged_manifest_costs_nothing_but_work(archive: Path, motion: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    whole = results(out)
    rubbish = ['{"target": 3}', "[]", "null", '{"target": "a.rectified.jpg", "outputs": 7}', "\x00\xff", '{"target"']
    text = (out / MANIFEST).read_text()
    (out / MANIFEST).write_text("\n".join(rubbish) + "\n" + text + "\n".join(rubbish))
    assert rectify(archive, "-o", out, "--motion", motion) == 0
    assert "4 finished already" in capsys.readouterr().err
    (out / MANIFEST).write_bytes(os.urandom(3000))
    assert rectify(archive, "-o", out, "--motion", motion) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert results(out) == whole


def test_leftovers_of_killed_runs_go_and_those_at_work_stay(archive: Path, motion: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "trip").mkdir(parents=True)
    (out / "trip" / ".unshutter-0123456789abcdef.part.jpg").write_bytes(b"half")
    (out / ".unshutter-mine.part.jpg").write_bytes(b"not ours")
    with written_whole(out / "trip" / "elsewhere.jpg") as part:
        assert rectify(archive, "-o", out, "--motion", motion) == 0
        assert sorted(leftovers(out)) == sorted([part.name, ".unshutter-mine.part.jpg"])
        part.write_bytes(b"whole")
    assert (out / "trip" / "elsewhere.jpg").read_bytes() == b"whole"
    (out / "trip" / ".unshutter-0123456789abcdef.part.jpg").write_bytes(b"half")
    assert rectify(archive, "-o", out, "--motion", motion) == 0  # everything is finished already
    assert leftovers(out) == [".unshutter-mine.part.jpg"]


def test_the_manifest_may_lie_elsewhere(tmp_path: Path) -> None:
    make_photos(tmp_path / "in", ["a.jpg", "b.jpg"])
    words = (tmp_path / "in", "--motion", make_motion(tmp_path / "m.json"), "--manifest", tmp_path / "state")
    for out in ("one", "two"):  # that share it, with results of the same names
        assert rectify(*words, "-o", tmp_path / out) == 0
        assert sorted(path.name for path in (tmp_path / out).iterdir()) == ["a.rectified.jpg", "b.rectified.jpg"]
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*/*.jpg")}
    for out in ("one", "two"):
        assert rectify(*words, "-o", tmp_path / out) == 0  # finished, by what is known there
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("*/*.jpg")} == before


def test_a_manifest_makes_results_next_to_their_photos_resumable(tmp_path: Path) -> None:
    make_photos(tmp_path / "in", ["a.jpg", "b.jpg"])
    words = (tmp_path / "in", "--motion", make_motion(tmp_path / "m.json"))
    assert rectify(*words, "--manifest", tmp_path / "state") == 0
    assert rectify(*words) == 1  # they exist
    assert rectify(*words, "--manifest", tmp_path / "state") == 0


def test_a_manifest_for_one_photo_or_in_a_file_is_refused(tmp_path: Path) -> None:
    make_photos(tmp_path / "in", ["a.jpg", "b.jpg"])
    assert rectify(tmp_path / "in" / "a.jpg", "--manifest", tmp_path / "state") == 2
    assert rectify(tmp_path / "in", "--manifest", tmp_path / "in" / "a.jpg", "-o", tmp_path / "out") == 2
