"""Where a clip's result goes if nobody says."""

from pathlib import Path

import pytest

pytest.importorskip("av", reason="clips need the extra video")

from support import clips
from unshutter.cli import main
from unshutter.photo import Photo


@pytest.mark.parametrize("words", [["video"], []])
def test_a_film_gets_a_name_next_to_it(words: list[str], tmp_path: Path) -> None:
    clip = tmp_path / "walk.mp4"
    clips.write(clip, clips.moving(6)[1])
    assert main([*words, str(clip), "--readout-ratio", "0.5"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["walk.mp4", "walk.rectified.mp4"]


def test_pictures_get_a_folder_next_to_theirs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "frames").mkdir()
    for k, grey in enumerate(clips.moving(4)[1]):
        Photo.from_array(grey).save(tmp_path / "frames" / f"{k:03}.png")
    words = ["--readout-ratio", "0.5", "--fps", "25"]
    assert main(["video", str(tmp_path / "frames"), *words]) == 0
    assert len(list((tmp_path / "frames-rectified").iterdir())) == 4
    capsys.readouterr()
    assert main(["video", str(tmp_path / "frames" / "%03d.png"), *words]) == 2
    assert "need --output" in capsys.readouterr().err
