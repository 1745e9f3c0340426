"""The motion of a photo by the video inside it, from motion photos that the tests render."""

import shutil
import struct
import subprocess
from dataclasses import replace

import numpy as np
import pytest

import unshutter
from support import clips
from support.camera_files import heic
from support.covering import thorough
from support.drawn_photos import encoded, textured
from support.hand_held import hand, log_of
from support.maker_notes import directory, exif_with_note
from support.motion_photos import VIDEO, item, motion_photo, packet
from unshutter.cli import main
from unshutter.frames import motion_photo as video_module
from unshutter.frames.motion_photo import DecodedVideo, motion_by, motion_by_embedded_video
from unshutter.motion.finding import Finding
from unshutter.options import Camera
from unshutter.orientation import ScanDirection
from unshutter.photo import Photo
from unshutter.photo.embedded_video import EmbeddedVideo
from unshutter.reasons import Cause, Code, MotionSource, Reason
from unshutter.single.estimator import View
from unshutter_lab.evaluation.metrics import motion_error
from unshutter_lab.synthesis.clip import Stabilisation, SyntheticMotionPhoto
from unshutter_lab.synthesis.sequences import RotatingCamera

HEIGHT, WIDTH, FOCAL = 360, 480, 380.0


def shaken(seed=3):
    """A hand that is in a hurry."""
    calm = hand(seed)
    return replace(calm, **{name: 4 * getattr(calm, name) for name in ("yaw_rad_s", "roll_rad_s", "pitch_rad_s")})


def filmed(log=None, **more):
    """A still and a video that shows four fifths of its width; the still takes longer to be read out."""
    focal = FOCAL * 320 / (0.8 * WIDTH)
    camera = RotatingCamera(log or shaken(), 0.05, 18, 30.0, 0.55, 180, 320, focal)
    return SyntheticMotionPhoto(camera, 7.3, 0.8, HEIGHT, WIDTH, FOCAL, **more)


def scene():
    drawn = textured(600, 800, bands=1)[..., 0].astype(float)
    return np.clip(128 + 2.5 * (drawn - drawn.mean()), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def hurried():
    case = filmed()
    return case, case.motion_photo(scene())


@pytest.fixture(scope="module")
def stabilised():
    return filmed(stabilisation=Stabilisation.FRAMES).motion_photo(scene())


def evidence_of(data, **camera):
    return motion_by_embedded_video(View(Photo.from_bytes(data), Camera(focal_px=FOCAL, **camera)))


def error_px(motion, case):
    return motion_error(motion, case.motion()).epe


def test_the_video_says_how_the_still_moved(hurried):
    case, data = hurried
    found = evidence_of(data)
    motion = found.motion
    assert (found.estimator, found.source) == ("film", MotionSource.EMBEDDED_VIDEO) and found.confidence > 0.9
    assert error_px(motion.scaled(0), case) > 1
    assert error_px(motion, case) < 0.5


def test_a_photo_is_rectified_by_its_video(hurried, tmp_path, capsys):
    _, data = hurried
    result = unshutter.rectify(data, focal_px=FOCAL)
    assert result.changed and result.found.source is MotionSource.EMBEDDED_VIDEO
    assert result.verdict.described().endswith("(by the video inside it)")
    assert result.verdict.as_json()["source"] == "film"
    assert unshutter.estimate(data, estimator="none").motion.is_zero
    assert unshutter.candidates(data, focal_px=FOCAL)[0].finding.source is MotionSource.EMBEDDED_VIDEO


def test_no_film_leaves_the_video_alone(hurried, tmp_path):
    _, data = hurried
    assert unshutter.estimate(data, focal_px=FOCAL, no_film=True).estimator != "film"
    (tmp_path / "a.jpg").write_bytes(data)
    logs = [tmp_path / "with.jsonl", tmp_path / "without.jsonl"]
    words = ["rectify", str(tmp_path / "a.jpg"), "--focal-px", str(FOCAL), "--overwrite", "-o", str(tmp_path / "b.jpg")]
    assert main([*words, "--json-log", str(logs[0])]) == main([*words, "--no-film", "--json-log", str(logs[1])]) == 0
    assert ['"source": "film"' in log.read_text() for log in logs] == [True, False]


def test_a_still_that_software_has_turned_shows_its_readout_by_its_video(hurried):
    case, data = hurried
    photo = Photo.from_bytes(data)
    video = data[data.index(b"ftyp") - 4 :]
    turned = motion_photo(np.rot90(photo.pixels[..., 0], -1).copy(), _packet(video), video)
    motion = evidence_of(turned).motion
    assert motion.scan_direction is ScanDirection.RIGHT_TO_LEFT or motion.scan_direction is ScanDirection.LEFT_TO_RIGHT
    assert np.array_equal(motion.scan_direction.to_scan_frame(np.rot90(photo.pixels, -1)), photo.pixels)
    assert error_px(replace(motion, scan_direction=ScanDirection.TOP_TO_BOTTOM), case) < 0.5
    assert evidence_of(turned, readout="top-to-bottom").code is Code.EMBEDDED_VIDEO_DIFFERS  # the user knows better


def _packet(video):
    return packet(item("Primary", 0) + item("MotionPhoto", len(video), "video/mp4"), 'Cam:MotionPhoto="1"')


def test_a_video_that_was_stabilised_row_by_row_is_not_believed():
    evidence = evidence_of(filmed(stabilisation=Stabilisation.ROWS).motion_photo(scene()))
    assert isinstance(evidence, Reason) and evidence.code is Code.EMBEDDED_VIDEO_STABILISED


def test_a_photo_says_that_its_video_is_stabilised_and_not_used(stabilised, tmp_path, capsys):
    (tmp_path / "photo.jpg").write_bytes(stabilised)
    log, words = tmp_path / "log.jsonl", ["rectify", str(tmp_path / "photo.jpg"), "--focal-px", str(FOCAL)]
    assert main([*words, "-o", str(tmp_path / "out.jpg"), "--json-log", str(log)]) == 0
    assert "; the video inside it is stabilised: not used" in capsys.readouterr().err
    assert '"film": {"code": "film-stabilised"' in log.read_text()


def test_a_finding_says_why_the_video_was_not_used(stabilised):
    found = unshutter.estimate(stabilised, focal_px=FOCAL)
    assert found.video_unused.code is Code.EMBEDDED_VIDEO_STABILISED
    assert Finding.from_json(found.to_json()).video_unused == found.video_unused


def test_a_camera_that_stood_still_is_left_alone():
    data = filmed(moving=False).motion_photo(scene())
    result = unshutter.rectify(data, focal_px=FOCAL)
    assert not result.changed and result.verdict.cause is Cause.NO_MOTION
    assert result.found.reason.code is Code.EMBEDDED_VIDEO_STOOD_STILL


def test_an_even_pan_has_a_usual_readout_time_and_says_how_unsure_that_is():
    slow, fast = (filmed(log_of(lambda t, r=rate: 0 * t + r, *[lambda t: 0 * t] * 2)) for rate in (12.0, 40.0))
    of_slow, of_fast = (evidence_of(case.motion_photo(scene())) for case in (slow, fast))
    assert error_px(of_slow.motion, slow) < 0.5 < error_px(of_slow.motion.scaled(0), slow)
    assert of_fast.expected_error > 1.5 * of_slow.expected_error


def test_another_photos_video_says_nothing(hurried):
    _, data = hurried
    video = data[data.index(b"ftyp") - 4 :]
    other = motion_photo(textured(HEIGHT, WIDTH)[::-1].copy(), _packet(video), video)
    assert evidence_of(other).code is Code.EMBEDDED_VIDEO_DIFFERS


@pytest.mark.parametrize("video", [VIDEO, VIDEO[:100]])
def test_a_video_that_cannot_be_read_is_none(video):
    assert evidence_of(motion_photo(textured(HEIGHT, WIDTH), _packet(video), video)) is None


@pytest.mark.parametrize(("moment_s", "frames"), [(20.0, range(57, 60)), (12.0, range(33, 40)), (1e6, ())])
def test_a_long_video_is_decoded_around_the_moment_only(tmp_path, monkeypatch, moment_s, frames):
    """A video of three frames a second, with a key frame every ten frames."""
    path = clips.write(
        tmp_path / "a.mp4", clips.standing(1) * 60, times=[k / 3 for k in range(60)], options={"g": "10"}
    )
    params = video_module.VIDEO
    far_from_the_start = replace(params, most_before=25 - params.most_frames)
    monkeypatch.setattr(video_module, "VIDEO", far_from_the_start)
    video = video_module.decode_embedded_video(EmbeddedVideo(path.read_bytes(), moment_s))
    assert (video is None) == (not frames)
    if video is not None:
        assert np.round(video.times_s * 3).astype(int).tolist() == list(frames)


def test_a_video_that_was_cut_off_says_nothing(hurried):
    _, data = hurried
    video = data[data.index(b"ftyp") - 4 :]
    cut = video[: len(video) // 20]
    evidence = evidence_of(motion_photo(textured(HEIGHT, WIDTH), _packet(cut), cut))
    assert evidence is None or isinstance(evidence, Reason)


@pytest.mark.parametrize("seed", [0, *map(thorough, range(1, 4))])
def test_a_damaged_video_says_nothing_or_something(hurried, seed):
    _, data = hurried
    video, rng = bytearray(data[data.index(b"ftyp") - 4 :]), np.random.default_rng(seed)
    for at in rng.integers(48, len(video), 30 * seed + 3):
        video[at] = rng.integers(256)
    whole = data[: len(data) - len(video)] + bytes(video)
    evidence = evidence_of(whole)
    assert evidence is None or isinstance(evidence, Reason) or np.isfinite(evidence.motion.rz_rad).all()


def test_frames_that_show_nothing_say_nothing(hurried):
    _, data = hurried
    dull = DecodedVideo([np.full((90, 160), 120, np.uint8)] * 12, np.arange(12) / 30)
    view = View(Photo.from_bytes(data), Camera(focal_px=FOCAL))
    assert motion_by(dull, view).code is Code.EMBEDDED_VIDEO_DIFFERS
    assert motion_by(replace(dull, frames=dull.frames[:3]), view).code is Code.EMBEDDED_VIDEO_TOO_SHORT
    at_once = replace(filmed_frames(), times_s=np.zeros(18))
    assert motion_by(at_once, view).code is Code.EMBEDDED_VIDEO_TOO_SHORT


def filmed_frames():
    frames = [np.ascontiguousarray(frame) for frame in filmed().video(scene())]
    return DecodedVideo(frames, np.arange(len(frames)) / 30, 8 / 30)


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg writes Apple's videos")
def test_a_live_photo_has_its_video_next_to_it(hurried, tmp_path):
    case, data = hurried
    video = data[data.index(b"ftyp") - 4 :]
    (tmp_path / "video.mp4").write_bytes(video)
    name = "0E4B1E4C-0F1A-4B6B-A6A2-51C1B3A8B2D1"
    tag = f"com.apple.quicktime.content.identifier={name}"
    words = ["-c", "copy", "-movflags", "use_metadata_tags", "-metadata", tag]
    command = ["ffmpeg", "-v", "error", "-i", tmp_path / "video.mp4", *words, tmp_path / "IMG_1.MOV"]
    subprocess.run(command, check=True)
    note = b"Apple iOS\0\0\1MM" + directory(">", 14, (0x0011, 2, name.encode() + b"\0"))
    exif = exif_with_note(note, "Apple")
    still = Photo.from_bytes(data).pixels[..., 0]
    for file, own in (("IMG_1.JPG", exif), ("IMG_2.JPG", exif)):
        (tmp_path / file).write_bytes(encoded(still, "JPEG", exif=own, quality=95))
    view = View(Photo.open(tmp_path / "IMG_1.JPG"), Camera(focal_px=FOCAL))
    found = motion_by_embedded_video(view)
    assert isinstance(found, Finding) and error_px(found.motion, case) < 0.5
    assert Photo.open(tmp_path / "IMG_2.JPG").embedded_video() is None
    other = note.replace(name.encode(), name[::-1].encode())
    (tmp_path / "IMG_1.JPG").write_bytes(encoded(still, "JPEG", exif=exif_with_note(other, "Apple"), quality=95))
    assert motion_by_embedded_video(View(Photo.open(tmp_path / "IMG_1.JPG"))) is None


def test_a_heic_has_its_video_in_a_box(hurried):
    case, data = hurried
    video = data[data.index(b"ftyp") - 4 :]
    heif = heic(np.repeat(Photo.from_bytes(data).pixels[..., :1], 3, axis=2))
    boxed = heif + struct.pack(">I4s", len(video) + 8, b"mpvd") + video
    assert Photo.from_bytes(boxed).embedded_video().place == video
    assert error_px(evidence_of(boxed).motion, case) < 0.5
    assert Photo.from_bytes(heif).embedded_video() is None
