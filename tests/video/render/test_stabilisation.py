"""Clips whose camera's path is smoothed: less shake, no borders, level horizons, and clear words where that fails."""

import json
from itertools import pairwise

import cv2
import numpy as np
import pytest

import unshutter
from support import clips, hand_held
from support.covering import thorough
from support.gyro_logs import AXES, gyro_log, write_gcsv
from unshutter.cli import main
from unshutter.cli.arguments import parse
from unshutter.cli.clip_command import VIDEO
from unshutter.options.clip_options import RectifyClip, Steadiness
from unshutter.video.gyro.gyro_log import GRAVITY, GyroLog

FRAMES, DARKEST = 45, 60


@pytest.fixture(scope="module")
def kept(shaken, tmp_path_factory):
    """Luma of that clip, straightened alone."""
    return straighten(shaken, tmp_path_factory.mktemp("kept"))[0]


@pytest.fixture(scope="module")
def shaken(tmp_path_factory):
    """A clip that a hand shakes, of pictures without anything dark."""
    greys = clips.moving(FRAMES, hand_held.hand(seed=1))[1]
    bright = [np.maximum(grey, DARKEST) for grey in greys]
    return clips.write(tmp_path_factory.mktemp("steady") / "in.mkv", bright, "ffv1", "gray")


def straighten(clip, folder, *flags, expected=0):
    """(luma of the result, its record)."""
    out, log = folder / "out.mkv", folder / "log.jsonl"
    words = ["video", str(clip), "-o", str(out), "--overwrite", "--json-log", str(log), *flags]
    if "--motion" not in flags:
        words += clips.KNOWN
    assert main(words) == expected
    return clips.luma(out), json.loads(log.read_text().splitlines()[-1])


def shake(luma):
    """By how much the picture's middle moves from frame to frame other than over nine of them, RMS [px]."""
    moves = []
    for before, after in pairwise(luma):
        one, other = (np.clip(each, 0, 255).astype(np.uint8) for each in (before, after))
        start = cv2.goodFeaturesToTrack(one, 150, 0.01, 6)
        end, status, _ = cv2.calcOpticalFlowPyrLK(one, other, start, None)
        moves.append(np.median((end - start)[status[:, 0] > 0, 0], axis=0))
    even = np.stack([np.convolve(axis, np.ones(9) / 9, "valid") for axis in np.array(moves).T], axis=-1)
    return float(np.sqrt(((np.array(moves)[4:-4] - even) ** 2).sum(axis=1).mean()))


def test_shake_goes_and_no_border_shows(tmp_path, shaken, kept, capsys):
    steady, record = straighten(shaken, tmp_path, "--stabilize", "--edges", "keep")
    assert steady.shape == kept.shape and shake(steady) < 0.1 * shake(kept)
    assert steady.min() > DARKEST - 20  # a cubic may shoot beyond
    said = record["stabilised"]
    assert 1 < said["zoom"] <= 1 / 0.85 and said["frames_unknown"] == 0 and not said["level"]
    assert f"path smoothed, {100 * said['cut_share']:.1f} % of width and height cut off" in capsys.readouterr().err
    usual, two = (parse("video", VIDEO, ["in.mkv", "--stabilize", *value]).options for value in ((), ("2",)))
    assert usual == two


def test_the_zoom_limit_is_kept_and_the_smoothing_is_weaker_instead(tmp_path, shaken, kept, capsys):
    free, record = straighten(shaken, tmp_path, "--stabilize", "4", "--zoom-limit", "30")
    assert "--zoom-limit" not in capsys.readouterr().err
    limit = 50 * record["stabilised"]["cut_share"]
    tight, record = straighten(shaken, tmp_path, "--stabilize", "4", "--edges", "keep", "--zoom-limit", str(limit))
    said = record["stabilised"]
    assert said["cut_share"] == pytest.approx(limit / 100, abs=1.5e-3) and 0 < said["frames_limited"] < FRAMES
    assert tight.min() > DARKEST - 20
    assert shake(free) < shake(tight) < 0.5 * shake(kept)
    assert "--zoom-limit allows more" in capsys.readouterr().err


def test_nothing_may_be_cut_off(tmp_path, shaken):
    _, record = straighten(shaken, tmp_path, "--stabilize", "--zoom-limit", "0")
    assert record["stabilised"]["zoom"] == 1.0


def test_a_camera_that_stood_still_keeps_its_frames(tmp_path):
    before = clips.write(tmp_path / "in.mkv", clips.standing(), "ffv1")
    steady, record = straighten(before, tmp_path, "--stabilize")
    assert np.array_equal(steady, clips.luma(before)) and record["stabilised"]["zoom"] == 1.0


def test_scenes_are_smoothed_one_by_one(tmp_path, shaken, kept):
    frames = [each.astype(np.uint8) for each in clips.luma(shaken)]
    both = clips.write(tmp_path / "two.mkv", [*frames[:24], *(255 - np.rot90(each, 2) for each in frames[20:])], "ffv1")
    steady, record = straighten(both, tmp_path, "--stabilize")
    assert record["cuts_s"] == [pytest.approx(0.8, abs=1e-3)]
    assert shake(steady[:24]) < 0.2 * shake(kept[:24]) and shake(steady[24:]) < 0.2 * shake(kept[20:])


def test_frames_that_show_nothing_do_not_break_the_path(tmp_path, shaken, kept):
    frames = [each.astype(np.uint8) for each in clips.luma(shaken)]
    frames[22:24] = [np.full_like(frames[0], 128)] * 2
    dim = clips.write(tmp_path / "dim.mkv", frames, "ffv1", "gray")
    steady, record = straighten(dim, tmp_path, "--stabilize", "--edges", "keep")
    assert record["stabilised"]["frames_unknown"] > 0
    assert shake(steady[:21]) < 0.3 * shake(kept[:21]) and shake(steady[25:]) < 0.3 * shake(kept[25:])


@pytest.mark.parametrize(
    "flags", [thorough(("--edges", "crop")), ("--model", "dense"), thorough(("--strength", "0.5"))]
)
def test_it_goes_with_other_options(tmp_path, shaken, kept, flags):
    steady, _ = straighten(shaken, tmp_path, "--stabilize", *flags)
    assert shake(steady) < 0.2 * shake(kept)


def test_the_motion_file_holds_the_path(tmp_path, shaken, capsys):
    saved = tmp_path / "motion.json"
    direct, _ = straighten(shaken, tmp_path, "--stabilize", "--save-motion", str(saved))
    again, _ = straighten(shaken, tmp_path, "--stabilize", "--motion", str(saved))
    assert np.abs(again - direct).mean() < 0.2
    older = json.loads(saved.read_text())
    for frame in older["frames"]:
        frame.pop("step", None)
    saved.write_text(json.dumps(older))
    capsys.readouterr()
    words = ["video", str(shaken), "-o", str(tmp_path / "new.mkv"), "--stabilize", "--motion", str(saved)]
    assert main(words) == 1
    assert "save it again with --save-motion" in capsys.readouterr().err and not (tmp_path / "new.mkv").exists()


def test_frames_of_another_decoder(shaken, kept):
    frames = [each.astype(np.uint8) for each in clips.luma(shaken)]
    options = {"readout_ratio": clips.RATIO, "focal_px": clips.FOCAL, "stabilize": 2.0, "edges": "keep"}
    steady = np.stack(list(unshutter.rectify_clip_frames(frames, **options))).astype(float)
    assert shake(steady) < 0.1 * shake(kept) and steady.min() > DARKEST - 20
    slower = np.stack(list(unshutter.rectify_clip_frames(frames, fps=60, **options))).astype(float)
    assert not np.array_equal(slower, steady)
    assert list(unshutter.rectify_clip_frames([], **options)) == []
    with pytest.raises(unshutter.UsageError, match="twice"):
        unshutter.rectify_clip_frames(iter(frames), **options)


# ---- level ----------------------------------------------------------------------------------------------------


def tilted(folder):
    """(clip, log) of a camera that is held askew by 4 degrees and rolls to and fro by another 3."""

    def roll_rate(t):
        return 3 * 2 * np.pi * 0.4 * np.cos(2 * np.pi * 0.4 * t)

    log = hand_held.log_of(lambda t: 14 * np.sin(8 * t), roll_rate, lambda t: 11 * np.sin(9.5 * t + 1))
    camera, greys = clips.moving(FRAMES, log)
    gyro = gyro_log(camera)
    middle_s = (FRAMES / 2) / clips.FPS  # when the camera looks at the middle of the wall
    turns = AXES @ gyro.rotations(gyro.t_s) @ gyro.rotations(np.array([middle_s])).swapaxes(-1, -2) @ AXES.T
    askew = np.radians(4)
    up = np.einsum("nij,j->ni", turns, [np.sin(askew), -np.cos(askew), 0.0]) @ AXES
    force = np.concatenate([gyro.t_s[:, None], GRAVITY * up], axis=1)
    path = write_gcsv(folder / "in.gcsv", GyroLog(gyro.t_s, gyro.rates, "a test", force))
    return clips.write(folder / "in.mkv", greys, "ffv1", "gray"), path


def slant(luma, reference):
    """Angle by which each picture is turned clockwise against one [degrees]."""
    angles = []
    for picture in luma:
        one, other = (np.clip(each, 0, 255).astype(np.uint8) for each in (reference, picture))
        start = cv2.goodFeaturesToTrack(one, 150, 0.01, 6)
        end, status, _ = cv2.calcOpticalFlowPyrLK(one, other, start, None, maxLevel=5)
        matrix, _ = cv2.estimateAffinePartial2D(start[status[:, 0] > 0], end[status[:, 0] > 0])
        angles.append(np.degrees(np.arctan2(matrix[1, 0], matrix[0, 0])))
    return np.array(angles)


def test_horizons_are_level(tmp_path):
    clip, log = tilted(tmp_path)
    level, record = straighten(clip, tmp_path, "--level", "--stabilize", "--gyro", str(log), "--zoom-limit", "40")
    askew = clips.luma(clip)
    assert record["stabilised"]["level"]
    assert np.ptp(slant(level, level[0])) < 0.15 < 2 < np.ptp(slant(askew, askew[0]))
    size, zoom = (clips.WIDTH, clips.HEIGHT), record["stabilised"]["zoom"]
    upright = cv2.getRotationMatrix2D((clips.WIDTH / 2, clips.HEIGHT / 2), 4, zoom)  # anticlockwise
    assert np.abs(slant(level, cv2.warpAffine(cv2.resize(clips.wall(), size), upright, size))).max() < 1


@pytest.mark.parametrize(
    ("gravity", "gyro", "complaint"),
    [(True, "off", "leave out --gyro off"), (True, "", "name one with --gyro"), (False, None, "does not have")],
)
def test_a_level_horizon_needs_gravity(tmp_path, capsys, monkeypatch, gravity, gyro, complaint):
    """Which is known before any frame is looked at."""
    monkeypatch.setattr("unshutter.video.calibrate.questions.sample_frames", None)
    clip, log = tilted(tmp_path)
    if not gravity:
        lines = log.read_text().splitlines()
        head = lines.index("t,gx,gy,gz,ax,ay,az")
        log.write_text("\n".join(lines[:head] + [line.rsplit(",", 3)[0] for line in lines[head:]]) + "\n")
    words = ["video", str(clip), "-o", str(tmp_path / "out.mkv"), "--stabilize", "--level", *clips.KNOWN]
    assert main([*words, *([] if gyro == "" else ["--gyro", gyro or str(log)])]) == 2
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1 and "--level needs" in printed and complaint in printed
    assert not (tmp_path / "out.mkv").exists()


# ---- options --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"level": True}, "--level needs --stabilize"),
        ({"zoom_limit": 5.0}, "--zoom-limit needs --stabilize"),
        ({"stabilize": 0.0}, "must be above 0"),
        ({"stabilize": float("nan")}, "must be above 0"),
        ({"stabilize": 1e300}, "at most 1e\\+09 s"),
        ({"stabilize": 1.0, "zoom_limit": 60.0}, "between 0 and 50"),
    ],
)
def test_what_cannot_be_is_refused(options, complaint):
    with pytest.raises(unshutter.UsageError, match=complaint):
        Steadiness(**options)


def test_a_motion_file_does_not_say_which_way_is_up(tmp_path):
    with pytest.raises(unshutter.UsageError, match="leave out --motion"):
        RectifyClip(steadiness=Steadiness(1.0, level=True), motion=tmp_path / "motion.json")


def test_the_flag_stands_alone_before_a_name(tmp_path, shaken):
    words = ["video", "--stabilize", str(shaken), "-o", str(tmp_path / "out.mkv"), *clips.KNOWN]
    assert main([*words, "--end", "0.5"]) == 0
