"""The lens of a clip: read from files, looked up, and found from tracks."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from support import clips
from support.gpmf import entry, with_settings
from unshutter.cli import main
from unshutter.errors import UnshutterError, UsageError
from unshutter.frames.tracks import Tracks
from unshutter.motion.lens import Lens
from unshutter.motion.rotations import rotation_matrix
from unshutter.options.clip_options import RectifyClip, Shutter, Steadiness
from unshutter.orientation import ScanDirection
from unshutter.progress import SILENT
from unshutter.video.calibrate import lenses
from unshutter.video.calibrate.lenses import (
    LensProfile,
    lens_of_clip,
    lens_of_file,
    lens_of_tracks,
    named_lenses,
    table,
)
from unshutter.video.calibrate.sampled_frames import SampledFrames
from unshutter.video.file.clip import ClipRequest
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.file.stages import Work
from unshutter.video.render.views import StraightView

K = [0.04, 0.01, -0.006, 0.002]


class _Size:
    """The size of a clip's frames: all that reading a lens file looks at."""

    picture_size = 360, 640


def request_of(readout=ScanDirection.TOP_TO_BOTTOM):
    return ClipRequest(_Size(), RectifyClip(), readout, Work(SILENT, 1.0))  # type: ignore[arg-type]


def tracks_through(lens, pairs=24, seed=0, turn=0.02):
    """Corners seen through a lens by a camera that turns by chance, with noise of 0.05 px."""
    rng, height, width = np.random.default_rng(seed), 360, 640
    found = []
    for _ in range(pairs):
        at = rng.uniform([0, 0], [width, height], (180, 2)) - [width / 2, height / 2]
        x, y = at.T / (lens.focal * height)
        turned = rotation_matrix(rng.normal(0, turn, 3))
        straight = not any(lens.k)
        rays = np.stack([x, y, np.ones_like(x)] if straight else lens.direction(x, y), axis=-1) @ turned.T
        seen = rays[:, :2] / rays[:, 2:] if straight else np.stack(lens.position(*rays.T), axis=-1)
        end = seen * lens.focal * height + rng.normal(0, 0.05, seen.shape)
        middle = np.array([width - 1, height - 1]) / 2
        found.append(Tracks(at + middle, end + middle, height, width, len(at)))
    return found


def test_lens_is_found_from_tracks():
    truth = Lens(0.9, tuple(K))
    lens = lens_of_tracks(tracks_through(truth))
    assert lens is not None and lens.error < 0.02
    corner = np.hypot(1, 640 / 360) / 2
    assert lens.distance(truth.angle(corner / truth.focal)) * lens.focal == pytest.approx(corner, rel=0.02)


def test_straight_lens_is_none():
    assert lens_of_tracks(tracks_through(Lens(0.9, (0.0, 0.0, 0.0, 0.0)))) is None


def test_calm_camera_shows_no_lens():
    assert lens_of_tracks(tracks_through(Lens(0.9, tuple(K)), turn=1e-4)) is None


GYROFLOW = {
    "calib_dimension": {"w": 1280, "h": 720},
    "fisheye_params": {"camera_matrix": [[600.0, 0, 650.0], [0, 600.0, 359.5], [0, 0, 1]], "distortion_coeffs": K},
}
OPENCV = """%YAML:1.0
---
image_width: 1280
image_height: 720
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 600., 0., 650., 0., 600., 359.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.2, 0.05, 0., 0., 0. ]
"""


def test_gyroflow_json(tmp_path):
    file = tmp_path / "lens.json"
    file.write_text(json.dumps(GYROFLOW))
    lens = lens_of_file(file, request_of())
    assert lens.focal == pytest.approx(300 / 360) and lens.k == pytest.approx(K)
    assert lens.shift[0] == pytest.approx((325.25 - 0.5 - 319.5 + 0.0) / 300, abs=1e-3)
    turned = lens_of_file(file, request_of(ScanDirection.LEFT_TO_RIGHT))
    assert turned.focal == pytest.approx(300 / 640)


def test_opencv_yaml_of_a_radial_lens(tmp_path):
    file = tmp_path / "lens.yml"
    file.write_text(OPENCV)
    lens, tan = lens_of_file(file, request_of()), np.tan(0.5)
    assert lens.distance(0.5) == pytest.approx(tan * (1 - 0.2 * tan**2 + 0.05 * tan**4), abs=1e-3)


@pytest.mark.parametrize("text", ["", "{}", "{", "camera_matrix: [1, 2, x]", json.dumps({**GYROFLOW, "w": 0})[:80]])
def test_other_files_are_refused_in_one_line(tmp_path, text):
    file = tmp_path / "lens.json"
    file.write_text(text)
    with pytest.raises(UnshutterError, match="not a lens file"):
        lens_of_file(file, request_of())
    with pytest.raises(UnshutterError, match="cannot read"):
        lens_of_file(tmp_path / "none.json", request_of())


def test_a_lens_of_other_frames_is_refused(tmp_path):
    file = tmp_path / "lens.json"
    file.write_text(json.dumps({**GYROFLOW, "calib_dimension": {"w": 1280, "h": 960}}))
    with pytest.raises(UsageError, match="same shape"):
        lens_of_file(file, request_of())


def test_lens_and_focal_length_contradict():
    with pytest.raises(UsageError, match="focal"):
        Shutter(lens="a.json", focal_px=500)


def test_table_holds_lenses():
    assert len(table()) > 1000
    wide = [each for each in named_lenses("gopro hero7 black wide") if each.width == 3840]
    assert wide and all(100 < each.degrees < 150 for each in wide)
    assert replace(wide[0], lens="").name == "GoPro HERO7 Black"


# ---- lines made straight -------------------------------------------------------------------------------------------

BENT = Lens(300 / 360, (0.05, 0.012, -0.01, 0.003))


def grid(lens, focal):
    """A wall of squares, seen by a camera that stands still: through a lens, or one of this focal length [heights]."""
    row, col = np.mgrid[:360, :640]
    x, y = (col - 319.5) / 360, (row - 179.5) / 360
    if lens is None:
        x, y = x / focal, y / focal
    else:
        x, y, z = lens.direction(x / lens.focal, y / lens.focal)
        x, y = x / z, y / z
    return (127.5 + 100 * np.tanh(4 * np.sin(16 * x) * np.sin(16 * y))).astype(np.uint8)


def calibration(folder):
    file = folder / "lens.json"
    fisheye = {"camera_matrix": [[300, 0, 319.5], [0, 300, 179.5], [0, 0, 1]], "distortion_coeffs": BENT.k}
    file.write_text(json.dumps({"calib_dimension": {"w": 640, "h": 360}, "fisheye_params": fisheye}))
    return str(file)


@pytest.mark.parametrize("flags", [(), ("--only-changed",), ("--model", "dense", "--readout-ms", "20")])
def test_lines_become_straight(tmp_path, capsys, flags):
    """Also where the camera stood still; nothing of the border shows."""
    clip = clips.write(tmp_path / "in.mkv", 12 * [grid(BENT, None)], "ffv1", "gray")
    words = ["video", str(clip), "-o", str(tmp_path / "out.mkv"), "--lens", calibration(tmp_path), "--straight-lines"]
    assert main([*words, "--edges", "keep" if not flags else "fill", *flags]) == 0
    view = StraightView.of(BENT, ScanDirection.TOP_TO_BOTTOM, 640 / 360)
    assert f"lens file; straight now, {view.degrees(640 / 360):.0f} degrees" in capsys.readouterr().err
    before, after, true = (clips.luma(clip)[6], clips.luma(tmp_path / "out.mkv")[6], grid(None, view.focal))
    assert clips.psnr(after, true) > 30 > 15 > clips.psnr(before, true)


def test_the_view_is_as_wide_as_the_border_allows():
    view = StraightView.of(BENT, ScanDirection.TOP_TO_BOTTOM, 640 / 360)
    col, row = (each.ravel() for each in np.meshgrid([0, 319.5, 639], [0, 179.5, 359]))
    seen = np.stack(view.to_source(col, row, 360, 640))
    assert (
        (seen >= -0.5).all() and (seen <= [[639.5], [359.5]]).all() and np.abs(seen[:, 4] - [319.5, 179.5]).max() < 1e-6
    )
    assert min(seen[0].min(), seen[1].min()) < 4  # and hardly less
    assert StraightView.of(Lens(0.5, (0.0,) * 4), ScanDirection.TOP_TO_BOTTOM, 16 / 9).degrees(16 / 9) < 120.1


def test_lines_are_not_straightened_without_a_lens(tmp_path, capsys):
    clip = clips.write(tmp_path / "in.mkv", clips.standing(12), "ffv1", "gray")
    assert main(["video", str(clip), "-o", str(tmp_path / "out.mkv"), "--straight-lines"]) == 1
    shown = capsys.readouterr().err.splitlines()
    assert len([line for line in shown if "name one with --lens" in line]) == 1 and not (tmp_path / "out.mkv").exists()
    with pytest.raises(UsageError, match="stabilise the straightened clip"):
        RectifyClip(straight_lines=True, steadiness=Steadiness(2.0))


@pytest.mark.parametrize(
    ("share", "said"), [(None, None), (1.02, "Wide"), (0.74, "Linear"), (0.5, None), (np.nan, None)]
)
def test_gopros_field_of_view_chooses_among_its_lenses(tmp_path, monkeypatch, share, said):
    """GPMF's ZFOV, as a share of the wide one's; without it, the profiles do not agree."""
    shapes = {"Wide": (0.5, (0.05, 0.012, -0.01, 0.003)), "Linear": (0.55, (0.33, 0.13, 0.05, 0.02))}
    size = clips.WIDTH, clips.HEIGHT
    listed = [LensProfile("GoPro", "HERO8 Black", name, *size, f, (0.5, 0.5), k, 2) for name, (f, k) in shapes.items()]
    monkeypatch.setattr(lenses, "table", lambda: tuple(listed))
    tags = {"tags": {"firmware": "HD8.01.02.50.00"}, "container": {"movflags": "use_metadata_tags"}}
    clip = clips.write(tmp_path / "in.mp4", clips.standing(30), **tags)
    if share is not None:
        with_settings(clip, entry(b"ZFOV", b"f", struct.pack(">f", share * listed[0].degrees), 4))
    lens = lens_of_clip(ClipRequest.of(read_clip_facts(str(clip)), RectifyClip()), SampledFrames())
    assert (lens and lens.source) == (said and f"table of lenses (GoPro HERO8 Black {said})")


def test_a_named_camera_is_not_one_with_a_longer_name(tmp_path, monkeypatch):
    """As for its readout time: the lens of an iPhone 13 Pro says nothing about an iPhone 13."""
    size, k = (clips.WIDTH, clips.HEIGHT), (0.05, 0.012, -0.01, 0.003)
    focals = {"iPhone 13": 0.7, "iPhone 13 Pro": 0.9}
    listed = [LensProfile("Apple", model, "", *size, focal, (0.5, 0.5), k, 1) for model, focal in focals.items()]
    monkeypatch.setattr(lenses, "table", lambda: tuple(listed))
    clip = read_clip_facts(str(clips.write(tmp_path / "in.mp4", clips.standing(30))))
    for name, source in (("iphone 13", "table of lenses (Apple iPhone 13)"), ("iphone", None)):
        lens = lens_of_clip(ClipRequest.of(clip, RectifyClip(shutter=Shutter(camera=name))), SampledFrames())
        assert (lens and lens.source) == source
