"""Clips in which near and far move differently."""

import json
import weakref

import av
import cv2
import numpy as np
import pytest

from support import clips, two_layers
from support.covering import thorough
from unshutter.cli import main
from unshutter.motion import RowMotion
from unshutter.motion.finding import Finding
from unshutter.options import MAX_PIXELS
from unshutter.options.clip_options import ClipUndo, RectifyClip
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.file.pixels import PixelFormat
from unshutter.video.render.clip_motion import MovingFrame
from unshutter.video.render.frame_links import linked

FRAMES = 12
GREYS = [two_layers.frame(k) for k in range(FRAMES)]
TRUTH = np.stack([two_layers.middle(k) for k in range(FRAMES)]).astype(float)


def straighten(path, *flags, out="out.mkv"):
    out = path.with_name(out)
    options = ["--readout-ratio", str(two_layers.RATIO), "--focal-px", "1000", "--edges", "fill", "--overwrite", *flags]
    assert main(["video", str(path), "-o", str(out), *options]) == 0
    return out


@pytest.fixture
def clip(tmp_path):
    return clips.write(tmp_path / "in.mkv", GREYS, "ffv1", "gray")


def test_near_and_far_each_come_out_straight(clip):
    camera = clips.luma(straighten(clip, "--model", "camera"))
    dense = clips.luma(straighten(clip, "--model", "dense"))
    taken = clips.psnr(clips.luma(clip), TRUTH)
    assert clips.psnr(dense, TRUTH) > taken + 5
    assert clips.psnr(dense, TRUTH) > clips.psnr(camera, TRUTH) + 2


def test_camera_is_the_default(clip):
    assert np.array_equal(clips.luma(straighten(clip)), clips.luma(straighten(clip, "--model", "camera")))


@pytest.mark.parametrize("pixel_format", [thorough("yuv420p"), "yuv422p10le", thorough("yuv444p16le"), "gbrp10le"])
def test_planes_of_many_kinds(tmp_path, pixel_format):
    before = clips.write(tmp_path / "in.mkv", GREYS, "ffv1", pixel_format)
    true = clips.write(tmp_path / "true.mkv", list(TRUTH.astype(np.uint8)), "ffv1", pixel_format)
    after = straighten(before, "--model", "dense", "--edges", "borrow")
    was, now, truth = (planes(path) for path in (before, after, true))
    assert [plane.dtype for plane in now] == [plane.dtype for plane in was]
    for before_it, after_it, true_plane in zip(was, now, truth, strict=True):
        inner = (..., slice(16, -16), slice(20, -20))
        off = [np.square(a[inner].astype(float) - true_plane[inner]).mean() for a in (before_it, after_it)]
        assert off[1] < off[0] / 4


def planes(path):
    """Each plane of a clip, all frames of it."""
    with av.open(str(path)) as video:
        frames = [[a.copy() for a in PixelFormat.of(f.format).arrays(f)] for f in video.decode(video=0)]
    return [np.stack(plane) for plane in zip(*frames, strict=True)]


def test_what_a_frame_did_not_see_is_borrowed(clip):
    pictures = {
        edges: clips.luma(straighten(clip, "--model", "dense", "--edges", edges))
        for edges in ("keep", "fill", "borrow")
    }
    unseen = pictures["keep"] <= 16  # black; the scene is nowhere so dark
    # farther from that, and from the border, than bicubic interpolation looks: the frame itself was seen
    around = np.stack(
        [cv2.dilate(np.pad(each, 1, constant_values=True).view(np.uint8), np.ones((9, 9))) for each in unseen]
    )
    whole = around[:, 1:-1, 1:-1] == 0
    unseen[9:] = False  # a board comes too close to the border there for the flow
    assert unseen.mean() > 0.001
    assert not (pictures["borrow"] < 16).any()
    off = {edges: np.abs(pictures[edges] - TRUTH)[unseen].mean() for edges in ("fill", "borrow")}
    assert off["borrow"] < off["fill"] / 2
    assert whole.mean() > 0.8
    assert np.array_equal(pictures["borrow"][whole], pictures["fill"][whole])


def test_half_the_strength_goes_half_the_way(clip):
    half = clips.luma(straighten(clip, "--model", "dense", "--strength", "0.5"))
    halfway = np.stack([two_layers.half_straight(k) for k in range(FRAMES)]).astype(float)
    assert clips.psnr(half, halfway) > clips.psnr(clips.luma(clip), halfway) + 4
    nothing = clips.luma(straighten(clip, "--model", "dense", "--strength", "0"))
    assert np.array_equal(nothing, clips.luma(clip))


@pytest.mark.parametrize("reference", [thorough("first"), "last"])
def test_another_reference_row(clip, reference):
    pictures = clips.luma(straighten(clip, "--model", "dense", "--reference", reference))
    share = {"first": 0.0, "last": two_layers.RATIO}[reference]
    truth = np.stack([two_layers.instant(k + share) for k in range(FRAMES)]).astype(float)
    assert clips.psnr(pictures, truth) > clips.psnr(clips.luma(clip), truth) + 4


def test_sensors_that_were_read_sideways(tmp_path):
    before = clips.write(tmp_path / "in.mkv", [np.rot90(grey) for grey in GREYS], "ffv1", "gray")
    flags = ["--model", "dense", "--edges", "borrow", "--readout", "left-to-right"]
    turned = np.rot90(clips.luma(straighten(before, *flags)), -1, axes=(1, 2))
    assert clips.psnr(turned, TRUTH) > clips.psnr(np.stack(GREYS).astype(float), TRUTH) + 5


def test_a_still_camera_leaves_its_frames_alone(tmp_path):
    before = clips.write(tmp_path / "in.mkv", GREYS[:1] * 8, "ffv1", "gray")
    after = straighten(before, "--model", "dense", "--edges", "borrow")
    assert np.array_equal(clips.luma(after), clips.luma(before))


def test_across_a_cut_nothing_is_looked_for(tmp_path, capsys):
    camera_only = clips.moving(10)[1]
    other = [255 - np.rot90(grey, 2) for grey in camera_only]
    before = clips.write(tmp_path / "in.mkv", camera_only + other, "ffv1", "gray")
    log = tmp_path / "log.jsonl"
    flags = [*clips.KNOWN, "--model", "dense", "--edges", "borrow", "--json-log", str(log)]
    assert main(["video", str(before), "-o", str(tmp_path / "out.mkv"), *flags]) == 0
    record = json.loads(log.read_text())
    assert (record["model"], record["rectified"], record["rectified_densely"]) == ("dense", 20, 20)
    one = clips.write(tmp_path / "one.mkv", camera_only, "ffv1", "gray")
    assert main(["video", str(one), "-o", str(tmp_path / "alone.mkv"), *flags]) == 0
    alone = clips.luma(tmp_path / "alone.mkv")
    assert np.array_equal(clips.luma(tmp_path / "out.mkv")[:10], alone)


def test_a_frame_without_neighbours_falls_back(tmp_path, capsys):
    greys = clips.moving(16)[1]
    times = np.arange(16) / 30 + np.where(np.arange(16) == 15, 10, 0)  # the last one comes ten seconds later
    before = clips.write(tmp_path / "in.mkv", greys, "ffv1", "gray", times=times)
    assert (
        main(["video", str(before), "-o", str(tmp_path / "o.mkv"), *clips.KNOWN, "--model", "dense", "--edges", "fill"])
        == 0
    )
    assert "15 of 16 frames straightened, 1 left unchanged" in capsys.readouterr().err
    assert np.array_equal(clips.luma(tmp_path / "o.mkv")[15], clips.luma(before)[15])


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--edges", "borrow"], "needs --model dense"),
        (["--model", "dense", "--edges", "crop"], "cannot crop"),
        (["--model", "dense", "--save-motion", "m.json"], "motion files contain the camera's motion"),
        (["--model", "both"], "both"),
    ],
)
def test_what_does_not_go_together_is_refused(tmp_path, clip, flags, said, capsys):
    out = tmp_path / "out.mkv"
    assert main(["video", str(clip), "-o", str(out), *flags]) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()


def test_three_frames_are_held_at_a_time(tmp_path):
    before = clips.write(tmp_path / "in.mkv", [two_layers.frame(k) for k in range(FRAMES)], "ffv1", "gray")
    clip = read_clip_facts(str(before), MAX_PIXELS)
    request = ClipRequest.of(clip, RectifyClip(undo=ClipUndo(model="dense", edges="borrow")))
    held = weakref.WeakSet()

    def moved():
        for frame in clip.frames_between():
            item = MovingFrame(frame, Finding(RowMotion.zero(65, 98)))
            held.add(item)
            yield item

    most = 0
    for _ in linked(request, moved(), two_layers.RATIO):
        most = max(most, len(held))
    assert most <= 5  # three, the one that is yielded, and the one that is read
