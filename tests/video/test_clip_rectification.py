"""Clips of many kinds: their frames come out straight, and everything else as it went in."""

import itertools
import json
import re
from dataclasses import dataclass, field
from fractions import Fraction

import cv2
import numpy as np
import pytest

from support import clips
from support.covering import thorough
from support.hand_held import log_of, pan
from unshutter import Photo
from unshutter.cli import main
from unshutter.options.clip_options import Encode, RectifyClip, Shutter
from unshutter.progress import ClipObserver
from unshutter.reasons import Code, Reason
from unshutter.video.calibrate import cameras
from unshutter.video.calibrate.cameras import CameraMode
from unshutter.video.clip_rectification import rectify_clip_file
from unshutter.video.render.frame_warper import Warper

FRAMES = 16
CAMERA, GREYS = clips.moving(FRAMES)
HDR = (
    "log-level=error:hdr10=1:max-cll=1000,400:"
    "master-display=G(8500,39850)B(6550,2300)R(35400,14600)WP(15635,16450)L(10000000,1)"
)
SHUTTER = Shutter(readout_ratio=clips.RATIO, focal_px=clips.FOCAL)
UNEVEN = np.cumsum([0, *np.random.default_rng(0).choice([1, 1, 1, 2], FRAMES - 1)]) / 30


@dataclass
class Kind:
    ending: str
    codec: str = "libx264"
    pixel_format: str = "yuv420p"
    more: dict = field(default_factory=dict)
    flags: tuple = ("--crf", "16")


CHAPTERS = [
    {
        "id": k,
        "start": 200 * k,
        "end": 200 * k + 200,
        "time_base": Fraction(1, 1000),
        "metadata": {"title": f"part {k}"},
    }
    for k in range(2)
]
KINDS = {
    "h264-sound": Kind(".mp4", more={"sound": True, "tags": {"title": "by the sea"}}),
    "h264-turned": Kind(".mov", more={"turn": -90, "sound": True, "stream_tags": {"handler_name": "Core Media Video"}}),
    "h264-422-10": Kind(".mp4", pixel_format="yuv422p10le", more={"aspect": Fraction(4, 3)}),
    "h264-full-range": Kind(".mp4", pixel_format="yuvj420p", more={"colours": (2, 1, 1, 1)}),
    "h264-fragments": Kind(".mp4", more={"sound": True, "container": {"movflags": "frag_keyframe+empty_moov"}}),
    "h264-uneven": Kind(".mp4", more={"times": UNEVEN}),
    "hevc-hdr": Kind(
        ".mp4", "libx265", "yuv420p10le",
        {"options": {"x265-params": HDR}, "colours": (1, 9, 16, 9), "tag": "hvc1"}, ("--crf", "10"),
    ),
    "av1": Kind(".mp4", "libsvtav1", "yuv420p10le", {"options": {"preset": "12"}}, ("--crf", "12", "--preset", "12")),
    "prores": Kind(".mov", "prores_ks", "yuv422p10le", {"options": {"profile": "2"}, "sound": "pcm_s16le"}, ()),
    "mjpeg-avi": Kind(".avi", "mjpeg", "yuvj422p", {"sound": "pcm_s16le", "options": {"qmin": "1", "qmax": "2"}}, ()),
    "mkv-chapters": Kind(
        ".mkv", more={"sound": "flac", "chapters": CHAPTERS, "tags": {"title": "two parts"}, "subtitles": "subrip"}
    ),
    "webm": Kind(".webm", "libvpx-vp9", more={"sound": "libopus", "options": {"cpu-used": "8"}}, flags=("--crf", "10")),
    "ts": Kind(".ts", more={"sound": True, "data": "klv"}),
    "mp4-everything": Kind(
        ".mp4",
        more={
            "sound": True, "chapters": CHAPTERS, "subtitles": "mov_text", "turn": 180,
            "tags": {"creation_time": "2024-05-06T07:08:09.000000Z", "location": "+48.8577+002.295/", "make": "Nemo"},
            "container": {"movflags": "use_metadata_tags"},
        },
    ),
}  # fmt: skip


def make(folder, kind, fine=False):
    more = dict(kind.more)
    if fine and kind.codec in ("libx264", "libx265", "libsvtav1"):
        more["options"] = {**more.get("options", {}), "crf": "2"}
    if kind.codec == "libx264":
        more["options"] = {"preset": "veryfast", "crf": "12", **more.get("options", {})}
    if kind.codec == "libx265" and "options" not in more:
        more["options"] = {"x265-params": "log-level=error"}
    return clips.write(folder / f"in{kind.ending}", GREYS, kind.codec, kind.pixel_format, **more)


def straighten(path, *flags):
    out = path.with_name(f"out{path.suffix}")
    assert main(["video", str(path), "-o", str(out), *clips.KNOWN, "--edges", "fill", *flags]) == 0
    return out


@pytest.mark.parametrize("name", KINDS)
def test_all_but_the_frames_stays_as_it_was(tmp_path, name):
    kind = KINDS[name]
    before = make(tmp_path, kind)
    after = straighten(before, *kind.flags)
    assert clips.times(after) == pytest.approx(clips.times(before), abs=1e-6)
    was, now = clips.facts(before), clips.facts(after)
    for one, other in zip(was["streams"], now["streams"], strict=True):
        one["tags"].pop("encoder", None), other["tags"].pop("encoder", None)
        one["tags"].pop("DURATION", None), other["tags"].pop("DURATION", None)
    assert now["streams"] == was["streams"]
    remade = {"encoder", "software", *(["compatible_brands"] if name == "h264-fragments" else [])}
    assert {k: v for k, v in now["tags"].items() if k.lower() not in remade} == {
        k: v for k, v in was["tags"].items() if k.lower() not in remade
    }
    assert now["chapters"] == was["chapters"]
    assert sorted(clips.packets(after)) == sorted(clips.packets(before))
    beside = {k: v for k, v in clips.beside(before).items() if k != "SEI_UNREGISTERED"}
    for key, value in beside.items():
        assert clips.beside(after)[key] == value, key


@pytest.mark.parametrize(
    "name",
    [
        "h264-sound",
        thorough("h264-turned"),
        thorough("h264-422-10"),
        "hevc-hdr",
        thorough("av1"),
        "prores",
        "h264-full-range",
    ],
)
def test_frames_come_closer_to_what_a_global_shutter_saw(tmp_path, name):
    kind = KINDS[name]
    before = make(tmp_path, kind, fine=True)
    after = straighten(before, *(["--crf", "2"] if kind.flags else []), *kind.flags[2:])
    true = clips.write(tmp_path / "true.mkv", clips.truth(CAMERA), "ffv1", kind.pixel_format.replace("yuvj", "yuv"))
    truth, was, now = (clips.luma(path) for path in (true, before, after))
    if name == "h264-full-range":
        was, now = ((a * 219 / 255 + 16) for a in (was, now))
    assert clips.psnr(now, truth) > clips.psnr(was, truth) + 5


ALPHA = Kind(".mov", "prores_ks", "yuva444p10le", {"options": {"profile": "4444"}}, ())


@pytest.mark.parametrize(
    "kind",
    [
        KINDS["h264-turned"],
        KINDS["prores"],
        thorough(ALPHA),
        *(thorough(KINDS[name]) for name in ("h264-422-10", "h264-uneven", "hevc-hdr", "av1", "mjpeg-avi", "webm")),
    ],
)
def test_by_default_no_pixel_lies_outside_what_its_frame_saw(tmp_path, monkeypatch, capsys, kind):
    outside = []

    def noted(warper, frame, grid, warped=Warper._warped):
        for _, at in grid.bands(1, 1):
            sides = ((-each.min(), each.max() - size + 1) for each, size in zip(at, (width, height), strict=True))
            outside.append(max(map(max, sides)))
        return warped(warper, frame, grid)

    monkeypatch.setattr(Warper, "_warped", noted)
    height, width = clips.HEIGHT, clips.WIDTH
    straighten(make(tmp_path, kind), "--edges", "auto", *kind.flags)
    assert outside and max(outside) <= 1.05
    assert re.search(r"all frames enlarged by \d\.\d %", capsys.readouterr().err)


def test_a_camera_that_stood_still_leaves_its_frames_alone(tmp_path):
    before = clips.write(tmp_path / "in.mkv", clips.standing(), "ffv1")
    after = straighten(before)
    assert np.array_equal(clips.luma(after), clips.luma(before))


def test_strength_0_changes_nothing(tmp_path):
    before = clips.write(tmp_path / "in.mkv", GREYS, "ffv1")
    after = straighten(before, "--strength", "0")
    assert np.array_equal(clips.luma(after), clips.luma(before))


def test_the_motion_can_be_kept_and_given_back(tmp_path):
    before = clips.write(tmp_path / "in.mkv", GREYS, "ffv1")
    saved = tmp_path / "motion.json"
    after = straighten(before, "--save-motion", str(saved))
    again = tmp_path / "again.mkv"
    assert main(["video", str(before), "-o", str(again), "--motion", str(saved), "--edges", "fill"]) == 0
    assert np.array_equal(clips.luma(again), clips.luma(after))
    record = json.loads(saved.read_text())
    assert record["format"] == "unshutter-clip-motion/1"
    assert (
        record["readout_ratio"] == clips.RATIO and record["readout_ratio_sd"] is None and record["found_by"] == "given"
    )
    assert [frame["time_s"] for frame in record["frames"]] == pytest.approx(clips.times(before))


def test_readout_ms_is_the_ratio_in_another_unit(tmp_path):
    before = clips.write(tmp_path / "in.mkv", GREYS, "ffv1")
    one = straighten(before)
    other = tmp_path / "other.mkv"
    assert (
        main(["video", str(before), "-o", str(other), *clips.KNOWN[2:], "--readout-ms", "20", "--edges", "fill"]) == 0
    )
    assert np.array_equal(clips.luma(one), clips.luma(other))


def test_cropped_frames_have_no_edges(tmp_path):
    before = clips.write(tmp_path / "in.mkv", [np.maximum(grey, 60) for grey in GREYS], "ffv1", "gray")
    edges_kept = clips.luma(straighten(before, "--edges", "keep"))
    assert (edges_kept < 30).any()
    (tmp_path / "out.mkv").unlink()
    cropped = clips.luma(straighten(before, "--edges", "crop"))
    assert cropped.shape[1] < clips.HEIGHT and cropped.shape[2] < clips.WIDTH
    assert not (cropped < 45).any()


@pytest.mark.parametrize(("colour_range", "black"), [(1, 16), (2, 0)])
def test_what_a_frame_does_not_see_is_as_black_as_its_range_allows(tmp_path, colour_range, black):
    bright = [np.maximum(grey, 60) for grey in GREYS]
    before = clips.write(tmp_path / "in.mkv", bright, "ffv1", colours=(colour_range,))
    kept = clips.luma(straighten(before, "--edges", "keep", "--codec", "ffv1"))
    values, counts = np.unique(kept[kept < 30], return_counts=True)
    assert values[counts.argmax()] == black


def test_a_part_of_a_clip_begins_at_0(tmp_path):
    before = clips.write(tmp_path / "in.mp4", GREYS, sound=True)
    after = straighten(before, "--start", "0.2", "--end", "0.4")
    assert clips.times(after) == pytest.approx(np.arange(6) / 30, abs=1e-3)
    sound = [time for _, time, _ in clips.packets(after)]
    assert sound and min(sound) >= -0.03 and max(sound) < 0.21


@pytest.mark.parametrize("name", ["in.ts", "in.mkv"])
def test_a_part_is_in_seconds_of_the_clip_whatever_its_clock_shows(tmp_path, name):
    times = 500 + np.arange(FRAMES) / 30
    before = clips.write(tmp_path / name, GREYS, times=times)
    for flags, count in ((("--start", "0.2", "--end", "0.4"), 6), (("--start", "0.2"), FRAMES - 6)):
        after = straighten(before, *flags, "--overwrite")
        assert clips.times(after) == pytest.approx(clips.times(after)[0] + np.arange(count) / 30, abs=2e-3)


def test_a_cut_is_told_and_parts_the_motion(tmp_path):
    other = [255 - np.rot90(grey, 2) for grey in GREYS]
    before = clips.write(tmp_path / "in.mkv", GREYS + other, "ffv1")
    log = tmp_path / "log.jsonl"
    straighten(before, "--json-log", str(log))
    record = json.loads(log.read_text())
    assert record["cuts_s"] == [pytest.approx(FRAMES / 30, abs=1e-3)]
    assert record["frames"] == record["rectified"] == 2 * FRAMES


@pytest.mark.parametrize("name", ["moments.jpg", "video.mp4"])
def test_a_preview_shows_both(tmp_path, name):
    before = clips.write(tmp_path / "in.mkv", GREYS, "ffv1")
    shown = tmp_path / name
    straighten(before, "--preview", str(shown))
    picture = cv2.imread(str(shown), 0)[None] if name.endswith("jpg") else clips.luma(shown)
    half = picture.shape[2] // 2
    assert half == 640
    assert picture.shape[:2] == ((1, 5 * 480) if name.endswith("jpg") else (FRAMES, 480))
    difference = np.abs(picture[..., :half].astype(float) - picture[..., half:])
    assert 1 < difference.mean() < 30
    assert name.endswith("mp4") or Photo.open(shown).software == "unshutter --preview"  # no run takes it for a photo


def test_the_library_is_silent_and_returns_what_it_did(tmp_path, capfd):
    """Neither a readout time that is found nor the result is printed; the caller is record of both."""
    still, calls, steps = clips.write(tmp_path / "in.mkv", clips.standing(30), "ffv1"), [], []
    listed, observer = RectifyClip(Shutter(camera="nemo"), encode=Encode(codec="ffv1")), ClipObserver()
    observer.note_progress = lambda *step: steps.append(step)
    observer.note_readout = lambda *each: calls.append(each)
    with pytest.MonkeyPatch.context() as patch:
        one = CameraMode("Nemo", "One", "", clips.WIDTH, clips.HEIGHT, 30.0, 20.0, 20.0, 20.0)
        patch.setattr(cameras, "table", lambda: (one,))
        outcome = rectify_clip_file(
            str(still),
            str(tmp_path / "out.mkv"),
            listed,
            observer=observer,
        )
    assert capfd.readouterr() == ("", "")
    assert calls == [(outcome.readout_time, outcome.interval_s)]
    assert outcome.ratio.value == pytest.approx(0.6) and outcome.readout_time.camera == "nemo"
    assert [reason.code for reason in outcome.reasons] == [Code.STOOD_STILL]
    assert steps[-1][:2] == ("frames", 30) and {what for what, _, _ in steps} == {"looking", "judging", "frames"}


def test_a_shot_of_a_few_frames_is_left_alone(tmp_path):
    other = [255 - np.rot90(grey, 2) for grey in GREYS[:4]]
    before = clips.write(tmp_path / "in.mkv", GREYS + other, "ffv1")
    after = straighten(before)
    assert np.array_equal(clips.luma(after)[FRAMES:], clips.luma(before)[FRAMES:])
    assert not np.array_equal(clips.luma(after)[:FRAMES], clips.luma(before)[:FRAMES])


def test_frames_that_show_no_motion_do_not_jump_back_to_their_distortion(tmp_path):
    """Two frames out of focus, in which nothing can be followed: they are straightened as their neighbours are."""
    turning = log_of(lambda t: 60 + 20 * np.sin(3 * t), lambda t: 0 * t, lambda t: 0 * t)
    camera, greys = clips.moving(30, turning)
    for k in (14, 15):
        greys[k] = cv2.GaussianBlur(greys[k], (0, 0), 14)
    clip = clips.write(tmp_path / "in.mkv", greys, "ffv1", "gray")
    outcome = rectify_clip_file(str(clip), str(tmp_path / "out.mkv"), RectifyClip(SHUTTER))
    assert outcome.frames == outcome.rectified == 30
    true = [each[-1] - each[0] for each in (camera.motion(k).rotations for k in range(30))]
    left = np.abs([turn - each for (_, turn), each in zip(outcome.rotations, true, strict=True)]).max(axis=1)
    assert left[14:16].max() < 0.15 * np.abs(true[14]).max()


def test_the_correction_fades_in_where_motion_was_unknown_for_longer(tmp_path):
    """Four parts of the picture move apart for a while: no motion of a camera explains that."""
    camera, greys = clips.moving(44, pan(60.0))
    halves = [(slice(0, 72), slice(72, 144)), (slice(0, 96), slice(96, 192))]
    for k in range(16, 28):
        for part, speed in zip(itertools.product(*halves), (7, -8, -5, 9), strict=True):
            greys[k][part] = np.roll(greys[k][part], (speed * (k - 15), -speed * (k - 15)), (0, 1))
    clip = clips.write(tmp_path / "in.mkv", greys, "ffv1", "gray")
    outcome = rectify_clip_file(str(clip), str(tmp_path / "out.mkv"), RectifyClip(SHUTTER))
    assert Reason(Code.NO_COMMON_MOTION) in outcome.reasons
    undone = (
        np.nan_to_num([np.abs(turn).max() for _, turn in outcome.rotations]) / np.abs(camera.motion(5).rotations).max()
    )
    first = 28 - undone[:28][::-1].argmin()  # after the last frame that is left
    assert 23 <= first < 26 and undone[28] > 0.7 and np.diff(undone[first - 1 : 29]).min() > 0
    assert np.diff(undone[first - 1 : 29]).max() < 0.3
