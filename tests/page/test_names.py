"""Names of files: safe, not too long, and none of them twice."""

from pathlib import Path

import httpx
import pytest

from support import clips
from support.page_server import sent, zipped
from unshutter.errors import UsageError
from unshutter.page.opened import OpenFile
from unshutter.page.saves import clip_result, free_name, photo_result
from unshutter.page.store import clean_name
from unshutter.run.inputs import fitting, motion_name


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("street.jpg", "street.jpg"),
        ("Straße in Trier.JPG", "Straße in Trier.JPG"),
        ("../../etc/passwd", "passwd"),
        ("..\\..\\windows\\win.ini", "win.ini"),
        ("/abs/olute.png", "olute.png"),
        ("..", "photo"),
        ("", "photo"),
        (".htaccess", "photo.htaccess"),
        ("street.", "street."),
        ("a\nb\x1b[31m.jpg", "ab[31m.jpg"),
        ("evil\u202egpj.exe", "evilgpj.exe"),
        ('a<b>:"|?*.jpg', "ab.jpg"),
        ("\udcff.jpg", "photo.jpg"),
        ("x" * 500 + ".jpg", "x" * 117 + ".jpg"),
    ],
)
def test_names(given: str, kept: str) -> None:
    assert clean_name(given) == kept


@pytest.mark.parametrize(
    ("stem", "kept"),
    [
        ("漢" * 82, "漢" * 80),  # 246 bytes, of which 241 find room
        ("漢" * 80, "漢" * 80),
        ("e\u0301" * 60 + "x" * 62, "e\u0301" * 60 + "x" * 61),
        ("x" + "e\u0301" * 85, "x" + "e\u0301" * 80),
        ("\U0001f469\u200d\U0001f52c" * 25, "\U0001f469\u200d\U0001f52c" * 21),  # a woman at a microscope, 11 bytes
        ("\u1112\u1161\u11ab" * 30, "\u1112\u1161\u11ab" * 26),  # a Korean syllable, 9 bytes
        ("x" * 239 + " . more", "x" * 239),
    ],
)
def test_names_are_cut_between_letters(stem: str, kept: str) -> None:
    name = fitting(f"{stem}.rectified.jpg")
    assert name == f"{kept}.rectified.jpg"
    assert len(name.encode()) <= 255


def _named(name: str) -> OpenFile:
    return OpenFile("x", "photo", name, Path(name), 1)


def test_numbers_and_endings_are_never_cut() -> None:
    name = fitting("漢" * 100 + ".heic.rectified.avif", "-12", 143)  # an encrypted home
    assert name == "漢" * 41 + ".rectified-12.avif" and len(name.encode()) <= 143
    assert photo_result(_named("漢" * 82 + ".jpg"), "png").endswith("漢.rectified.png")
    assert motion_name("漢" * 100) == "漢" * 83 + ".json"


def test_names_that_become_one_when_cut_stay_two(tmp_path: Path) -> None:
    names = [photo_result(_named("漢" * 90 + end + ".jpg"), None) for end in ("a", "b", "c")]
    assert len(set(names)) == 1
    taken: list[str] = []
    for name in names:
        taken.append(free_name(tmp_path, name, taken).name)
    assert taken == [
        "漢" * 80 + ".rectified.jpg",
        "漢" * 79 + ".rectified-2.jpg",
        "漢" * 79 + ".rectified-3.jpg",
    ]


def test_names_differ_where_capitals_do_not_count(tmp_path: Path) -> None:
    """A zip file that was made on Linux is unpacked on Windows."""
    name = free_name(tmp_path, "cafe\u0301.rectified.JPG", ["Caf\u00e9.rectified.jpg"]).name
    assert name == "cafe\u0301.rectified-2.JPG"


@pytest.mark.parametrize(
    ("name", "result"),
    [
        ("walk.mp4", "walk.rectified.mp4"),
        ("WALK.MOV", "WALK.rectified.MOV"),
        ("50%.mp4", "50%.rectified.mp4"),
        ("x%05d.mp4", "x%05d.rectified.mp4"),
        ("%d%d.mkv", "%d%d.rectified.mkv"),  # of none, as FFmpeg sees it,
    ],
)
def test_results_of_clips(name: str, result: str) -> None:
    assert clip_result(name) == result


@pytest.mark.parametrize("name", ["walk", "x%05d.png", "x%05d.jpg", "walk.tif", "list.m3u8", "list.mpd", "walk.txt"])
def test_names_of_no_video(name: str) -> None:
    """Of pictures FFmpeg would write one for each frame, and next to playlists the video in pieces."""
    with pytest.raises(UsageError, match=f"the name '{name}' has no extension: add one"):
        clip_result(name)


def test_a_long_name_does_not_spoil_the_others(client: httpx.Client, photo: Path) -> None:
    """Nor do two photos of one long name come out as one."""
    names = ["a.jpg", "漢" * 82 + ".jpg", "漢" * 82 + ".jpg", "b.jpg"]
    done, packed = zipped(client, [{"id": sent(client, name, photo.read_bytes())} for name in names])
    assert all(one["changed"] for one in done), done
    long = ["漢" * 80 + ".rectified.jpg", "漢" * 79 + ".rectified-2.jpg"]
    assert packed.namelist() == ["a.rectified.jpg", *long, "b.rectified.jpg"]


def test_a_video_named_like_pictures_is_one_file(client: httpx.Client, tmp_path: Path) -> None:
    video = clips.write(tmp_path / "walk.mp4", clips.moving(12)[1]).read_bytes()
    ids = [sent(client, name, video, "clips") for name in ("x%05d.png", "x%05d.mp4", "list.m3u8")]
    done, packed = zipped(client, [{"id": id, "options": {"readout-ratio": "0.6"}} for id in ids])
    assert [one.get("result") for one in done] == [None, "x%05d.rectified.mp4", None]
    assert all("has no extension" in told for told in (done[0]["error"], done[2]["error"]))
    assert packed.namelist() == ["x%05d.rectified.mp4"]
