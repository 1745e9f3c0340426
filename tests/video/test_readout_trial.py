"""--try: one frame rectified with several readout times, on a sheet."""

import cv2
import numpy as np
import pytest

from support import clips
from support.hand_held import log_of
from unshutter.cli import main

# it stands still, but for a fast turn between 0.5 and 0.7 s
JERK = log_of(lambda t: np.where(abs(t - 0.6) < 0.1, 60.0, 0.0), lambda t: 0 * t, lambda t: 0 * t)


def test_the_frame_at_which_the_times_differ_most(tmp_path, capsys):
    greys = clips.moving(36, JERK)[1]
    clip = clips.write(tmp_path / "in.mkv", greys, "ffv1", "gray")
    sheet = tmp_path / "sheet.png"
    before = clip.read_bytes()
    assert main(["video", str(clip), "-o", str(sheet), "--try", "5,20,33"]) == 0
    assert "readout times 5,20,33 ms at the frame at 0." in capsys.readouterr().err
    time_s = 0.55  # the camera starts 0.05 s into its log
    assert clip.read_bytes() == before
    picture = cv2.imread(str(sheet))
    tiles = [picture[y + 28 : y + 508, x : x + 640, 0].astype(float) for y in (0, 508) for x in (0, 640)]
    assert picture.shape == (1016, 1280, 3)
    away = [np.abs(tile - tiles[0]).mean() for tile in tiles]
    assert away[0] == 0 < away[1] < away[2] < away[3]
    shown = [np.abs(cv2.resize(tiles[0], (clips.WIDTH, clips.HEIGHT)) - grey).mean() for grey in greys]
    assert abs(np.argmin(shown) / 30 - time_s) < 0.12


@pytest.mark.parametrize(
    ("times", "name", "complaint"),
    [
        ("8;12", "a.png", "such as 8,12,16,20"),
        ("8,-1", "a.png", "such as 8,12,16,20"),
        ("1,2,3,4,5,6,7,8,9", "a.png", "up to 8 readout times"),
        ("8,40", "a.png", "33.33 ms apart"),
        ("8,12", "a.mkv", "name a .jpg or .png file"),
        ("8,12", None, "name it with -o"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, capsys, times, name, complaint):
    clip = clips.write(tmp_path / "in.mkv", clips.standing(10), "ffv1", "gray")
    output = [] if name is None else ["-o", str(tmp_path / name)]
    assert main(["video", str(clip), "--try", times, *output]) == 2
    assert complaint in capsys.readouterr().err and [path.name for path in tmp_path.iterdir()] == ["in.mkv"]


def test_where_nothing_moves_there_is_no_sheet(tmp_path, capsys):
    clip = clips.write(tmp_path / "in.mkv", clips.standing(10), "ffv1", "gray")
    assert main(["video", str(clip), "-o", str(tmp_path / "a.png"), "--try", "8,12"]) == 1
    assert "shows no motion" in capsys.readouterr().err
