"""Where a clip's result goes if nobody says."""

from pathlib import Path

import pytest

pytest.importorskip("av", reason="clips need the extra video")

from support import clips
from unshutter.cli import main


@pytest.mark.parametrize("words", [["video"], []])
def test_a_video_gets_a_name_next_to_it(words: list[str], tmp_path: Path) -> None:
    clip = tmp_path / "walk.mp4"
    clips.write(clip, clips.moving(12)[1])
    assert main([*words, str(clip), *clips.KNOWN]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["walk.mp4", "walk.rectified.mp4"]
    (tmp_path / "out").mkdir()
    assert main([*words, str(clip), *clips.KNOWN, "-o", str(tmp_path / "out")]) == 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["walk.rectified.mp4"]
