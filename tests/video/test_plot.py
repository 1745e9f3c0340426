"""The plot of how fast a clip's camera turned."""

import sys

import numpy as np
import pytest

from support import clips
from unshutter import version
from unshutter.cli import main
from unshutter.photo import Photo
from unshutter.video import outcome

FRAMES = 16


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    greys = clips.moving(FRAMES)[1]
    return clips.write(tmp_path_factory.mktemp("clip") / "in.mkv", greys, "ffv1")


def run(clip, tmp_path, plot, *flags):
    out = str(tmp_path / "out.mkv")
    return main(["video", str(clip), "-o", out, *clips.KNOWN, "--plot", str(plot), *flags])


def test_a_plot_is_a_picture(clip, tmp_path, capsys):
    plot = tmp_path / "turns.png"
    assert run(clip, tmp_path, plot) == 0
    picture = Photo.open(plot)
    assert picture.width == 1500 and np.ptp(picture.pixels[..., 0]) > 200
    assert run(clip, tmp_path, plot, "--start", "0.1") == 1
    assert "exists" in capsys.readouterr().err


def test_it_shows_how_the_camera_turned(clip, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(outcome, "plot_rotation_rates", lambda *values: drawn.append(values))
    assert run(clip, tmp_path, tmp_path / "turns.svg") == 0
    ((times, rates, cuts, *_),) = drawn
    assert times == pytest.approx(np.arange(FRAMES) / 30, abs=1e-3) and cuts == []
    moment = 0.05 + times + clips.RATIO / 30 / 2  # the log's, of the middle row
    yaw, roll, pitch = 70 * np.sin(9 * moment + 0.5), 30 * np.sin(7 * moment + 1), 40 * np.sin(11 * moment + 2)
    true = np.stack([pitch, yaw, roll], axis=1)
    for axis in range(3):
        sign = np.sign(rates[:, axis] @ true[:, axis])
        assert np.abs(sign * rates[:, axis] - true[:, axis]).max() < 6, axis


@pytest.mark.parametrize(
    ("plot", "missing", "code", "complaint"),
    [("turns.docx", False, 2, "not turns.docx"), ("turns.png", True, 1, version.extra("plot"))],
)
def test_a_plot_that_cannot_be_written_is_refused_before_any_work(
    clip, tmp_path, monkeypatch, capsys, plot, missing, code, complaint
):
    if missing:
        monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert run(clip, tmp_path, tmp_path / plot) == code
    assert complaint in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
