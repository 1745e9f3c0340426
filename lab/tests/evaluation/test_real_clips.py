"""Real clips before and after: figures of clips whose motion is known, and what the page says of them."""

from pathlib import Path

import numpy as np
import pytest

from support.clips import FOCAL, FPS, HEIGHT, RATIO, WIDTH, shaken, wall, write
from support.evaluations import rows_of, run
from unshutter import UnshutterError
from unshutter_lab.evaluation.case import Record
from unshutter_lab.evaluation.clip_tables import real_clip_tables
from unshutter_lab.evaluation.clip_wobble import ClipWobble
from unshutter_lab.evaluation.protocols import Request
from unshutter_lab.evaluation.results import Results
from unshutter_lab.evaluation.tables import tables
from unshutter_lab.synthesis.sequences import RotatingCamera

FRAMES = 32


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a clip of a rolling shutter, the same of a global one, and a list that knows one of them."""
    folder = tmp_path_factory.mktemp("videos")
    camera = RotatingCamera(shaken(), 0.05, FRAMES, FPS, RATIO, 2 * HEIGHT, 2 * WIDTH, 2 * FOCAL)
    scene = np.repeat(np.repeat(wall(), 2, axis=0), 2, axis=1)
    for name, is_global in (("a_rolling", False), ("b_global", True)):
        write(folder / f"{name}.mp4", list(camera.rendered(scene, global_shutter=is_global)), options={"crf": "16"})
    (folder / "clips.csv").write_text("clip,note,source\na_rolling.mp4,drawn,github.com/someone/films : a.mp4\n")
    return folder


def test_a_rolling_shutter_is_told_from_a_global_one(clips: Path) -> None:
    rolling, at_once = (ClipWobble.of(clips / f"{name}.mp4", 5.0) for name in ("a_rolling", "b_global"))
    assert rolling.regression and at_once.regression
    assert rolling.regression.rows.ratio == pytest.approx(RATIO, rel=0.1) and rolling.regression.rows.t > 20
    assert abs(at_once.regression.rows.ratio) < 0.05
    assert rolling.rms > 5 * at_once.rms and rolling.largest > rolling.usual > at_once.largest
    assert rolling.explained == pytest.approx(rolling.rms, rel=0.1)


def test_a_time_ends_the_measurement(clips: Path) -> None:
    whole, part = (ClipWobble.of(clips / "a_rolling.mp4", end_s) for end_s in (5.0, 0.8))
    assert whole.regression and part.regression
    assert whole.regression.pairs == FRAMES - 1 - 4 and part.regression.pairs == 24 - 1 - 4  # a run's ends are left out


def test_a_run_lists_each_clip_before_and_after(clips: Path, tmp_path: Path) -> None:
    words = ("--protocol", "real-clips", "--photos", "1")
    assert run(clips, tmp_path, *words, estimators="none,unshutter") == 0
    before, straight = rows_of(tmp_path)
    assert [before["estimator"], straight["estimator"]] == ["none", "unshutter"]
    assert float(straight["rms"]) < 0.5 * float(straight["rms_input"]) and float(straight["worse"]) == 0
    assert straight["rms_input"] == before["rms"] == before["rms_input"]
    assert float(straight["straightened"]) == 1 and float(straight["readout_ms"]) == pytest.approx(20, rel=0.1)
    assert straight["source"] == "github.com/someone/films : a.mp4" and straight["note"] == "drawn"
    page = (tmp_path / "results.md").read_text()
    assert (
        "--protocol real-clips" in page
        and "--estimators none,unshutter" in page
        and "| a_rolling | unshutter |" in page
    )


def record(clip: str, name: str, rms: float, **more: object) -> Record:
    steps = {
        "rms": rms,
        "usual": 2 * rms,
        "largest": 3 * rms,
        "rms_input": 1.0,
        "usual_input": 2.0,
        "largest_input": 3.0,
    }
    place = {"suite": "first 5 s", "group": "videos", "photo": clip, "draw": 0, "estimator": name}
    figures = {"sharpness": 0.9, "worse": float(rms > 1.05), "ratio": 0.5, "ratio_t": 12.0, "explained": 0.8}
    return place | steps | figures | more


def test_the_page_says_what_got_worse_and_what_was_copied() -> None:
    found = {"frames": 40, "straightened": 0.5, "readout_ms": 16.0, "readout_error_ms": 0.5, "left": ""}
    none = found | {"straightened": 0.0, "readout_ms": None, "readout_error_ms": None, "left": "it hardly moved"}
    records = [record("a", "none", 1.0), record("a", "unshutter", 2.0, **found), record("a", "deshake", 1.5)]
    records += [record("b", "none", 1.0), record("b", "unshutter", 0.25, **none), record("b", "deshake", 0.5)]
    results = Results(Request("real-clips", (Path("videos"),)), ["none", "unshutter", "deshake"], [], records)
    page = real_clip_tables(results)
    own = "| 1.00, 2.00 | 2.00, 4.00 | 3.00, 6.00 | 0.90 |"
    assert f"| a | 0.500 (12) | 16.0 ± 0.5 {own} **worse**, 20 of 40 frames straightened |" in page
    assert "| b | 0.500 (12) | not found |" in page and "| copied: it hardly moved |" in page
    assert "| a | 1.00, 3.00 | **2.00, 6.00**; 0.90 | **1.50, 4.50**; 0.90 |" in page
    assert "| b | 1.00, 3.00 | 0.25, 0.75; 0.90 | 0.50, 1.50; 0.90 |" in page
    assert "| b | unshutter | **0.25 px** |" in tables(results)


@pytest.mark.parametrize(
    ("folder", "estimators", "says"),
    [
        ("missing", "none", "there is no folder missing"),
        ("empty", "none", "no clips in folder empty"),
        ("videos", "segment-manhattan", "'segment-manhattan' is not compared by this protocol: choose from none,"),
        ("videos", "none,vid.stab", "vid.stab needs FFmpeg's program ffmpeg"),
        ("videos", "none", "videos/a.mp4: cannot be read as a clip"),
    ],
)
def test_mistakes_get_one_line(
    folder: str,
    estimators: str,
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))  # without FFmpeg
    Path("empty").mkdir()
    Path("videos").mkdir()
    Path("videos/a.mp4").write_bytes(b"no video")
    assert run(Path(folder), tmp_path / "out", "--protocol", "real-clips", estimators=estimators) in (1, 2)
    assert says in capsys.readouterr().err


def test_frames_without_detail_cannot_be_followed(tmp_path: Path) -> None:
    write(tmp_path / "grey.mp4", [np.full((HEIGHT, WIDTH), 90 + k, np.uint8) for k in range(20)])
    with pytest.raises(UnshutterError, match="cannot be followed"):
        ClipWobble.of(tmp_path / "grey.mp4", 5.0)
