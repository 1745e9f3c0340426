"""A plain folder of photos: those of a burst show one another's motion, all others are judged by themselves."""

import json
from datetime import datetime, timedelta

import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from support.batches import rectify
from support.covering import thorough
from support.drawn_photos import textured
from support.hand_held import HEIGHT, WIDTH, camera, hand, still
from support.tagged_files import EXIF
from unshutter import Motion, Photo
from unshutter.options import Camera
from unshutter.run import bursts
from unshutter_lab.evaluation.metrics import motion_error

READOUT_S, INTERVAL_S = 0.02, 0.1
START = datetime(2024, 5, 6, 7, 8, 9, 120_000)
PHONE = {0x010F: "Apple", 0x0110: "iPhone 12"}


def write(folder, frames, interval_s=INTERVAL_S, cameras=PHONE, subseconds=3, **each):
    """Photos with their times; ``each``: values of further tags (``t920a``), photo by photo."""
    folder.mkdir()
    for k, frame in enumerate(frames):
        at = START + timedelta(seconds=k * interval_s)
        tags = Image.Exif()
        tags.update(cameras)
        details = {0x829A: IFDRational(1, 200), 0x9003: at.strftime("%Y:%m:%d %H:%M:%S")}
        details |= {0x9291: f"{at:%f}"[:subseconds]} if subseconds else {}
        details |= {int(tag[1:], 16): values[k] for tag, values in each.items()}
        tags.get_ifd(EXIF).update(details)
        Image.fromarray(frame).convert("RGB").save(folder / f"{k}.png", exif=tags)
    return folder


@pytest.fixture(scope="module")
def moving():
    """(camera, its photos)."""
    made = camera(hand(4), READOUT_S / INTERVAL_S, frames=4, fps=1 / INTERVAL_S)
    return made, list(made.rendered(textured(2 * HEIGHT, 2 * WIDTH, bands=1)[..., 0], 1.0))


def records(folder, tmp_path, *flags):
    """What the log says of each photo."""
    log = tmp_path / "log.jsonl"
    assert (
        rectify(folder, "-o", tmp_path / "out", "--save-motion", tmp_path / "motions", "--json-log", log, *flags) == 0
    )
    return [record for record in map(json.loads, log.read_text().splitlines()) if record["event"] == "done"]


@pytest.mark.parametrize("flags", [(), thorough(("--jobs", 2))])
def test_a_burst_is_found_by_its_times(moving, tmp_path, capsys, flags):
    made, frames = moving
    focal = ("--focal-px", made.focal_px)
    done = records(write(tmp_path / "in", frames), tmp_path, *focal, *flags)
    used = {
        "others": 3,
        "interval_s": 0.1,
        "readout_ms": pytest.approx(14),
        "plausible_ms": [0, 50],
        "found_by": "phone",
    }
    assert [record["burst"] for record in done] == 4 * [used]
    motions = [Motion.load(file) for file in sorted((tmp_path / "motions").glob("*.json"))]
    true = [made.motion(k) for k in range(4)]
    off, before = (
        sum(motion_error(each, motion).epe for each, motion in zip(found, true, strict=True))
        for found in (motions, [motion.scaled(0) for motion in true])
    )
    assert off < 0.4 * before  # by 14 ms instead of 20
    assert capsys.readouterr().err.count("by 3 photos 0.1 s apart, taking 14 ms (phone)") == 4
    lines = (tmp_path / "out" / "unshutter-manifest.jsonl").read_text().splitlines()
    assert [line["burst"] for line in map(json.loads, lines) if line["state"] == "done"] == 4 * [used]


def test_uneven_intervals_count(moving, tmp_path):
    """The second photo is missing: the speed until the third is half of what its displacement seems to say."""
    made, frames = moving
    folder = write(tmp_path / "in", frames)
    (folder / "1.png").unlink()
    done = records(folder, tmp_path, "--focal-px", made.focal_px, "--readout-ms", 1000 * READOUT_S)
    assert all(record["burst"]["others"] == 2 for record in done)
    motions = [Motion.load(tmp_path / "motions" / f"{k}.json") for k in (0, 2, 3)]
    off = [motion_error(motion, made.motion(k)).epe for k, motion in zip((0, 2, 3), motions, strict=True)]
    assert max(off) < 0.6


def test_a_video_tells_more_than_a_burst(moving, tmp_path, monkeypatch):
    photo = write(tmp_path / "in", moving[1][:1]) / "0.png"
    assert bursts._Taken.of(photo, 10**9, photo.parent) is not None
    monkeypatch.setattr(Photo, "embedded_video", lambda _: object())
    assert bursts._Taken.of(photo, 10**9, photo.parent) is None


BRACKET = [IFDRational(1, n) for n in (200, 100, 50, 400)]
FOCAL = [IFDRational(n, 10) for n in (42, 60, 42, 60)]
DISTANCE = [IFDRational(n, 10) for n in (5, 6, 7, 8)]


@pytest.mark.parametrize(
    ("count", "how", "found"),
    [
        (4, {}, 4),
        (2, {}, 2),
        (2, {"interval_s": 0.2}, 0),  # two must be closer together than three
        (3, {"interval_s": 0.2}, 3),
        (4, {"subseconds": 0}, 0),
        (4, {"interval_s": 0.3}, 0),
        (4, {"interval_s": 0.0}, 0),
        (4, {"t829a": BRACKET}, 0),
        (4, {"ta402": 4 * [2]}, 0),
        (4, {"t920a": FOCAL}, 0),
        (4, {"t9206": DISTANCE}, 0),
        (4, {"cameras": {0x010F: "Canon", 0x0110: "Canon EOS 5D"}}, 0),
    ],
)
def test_times_settings_and_the_camera_make_a_burst(moving, tmp_path, count, how, found):
    photos = sorted(write(tmp_path / "in", moving[1][:count], **how).iterdir())
    camera = Camera(focal_px=moving[0].focal_px)
    assert len(bursts.bursts_among(photos, photos, camera, 10**9)) == found


def test_each_alone_and_a_known_readout_time(moving, tmp_path):
    folder = write(tmp_path / "in", moving[1], cameras={0x010F: "Canon", 0x0110: "Canon EOS R5"})
    done = records(folder, tmp_path, "--readout-ms", 16)
    assert [record["burst"]["readout_ms"] for record in done] == 4 * [pytest.approx(16)]
    assert not any("burst" in record for record in records(folder, tmp_path, "--each-alone", "--overwrite")[4:])


def test_other_contents_are_not_neighbours(tmp_path):
    """Photos of different things, at times and with settings of a burst."""
    scene = textured(3 * HEIGHT, WIDTH, bands=1)[..., 0]
    frames = [scene[k * HEIGHT : (k + 1) * HEIGHT] for k in range(3)]
    done = records(write(tmp_path / "in", frames), tmp_path)
    assert not any("burst" in record for record in done)


def test_a_camera_at_rest_is_left_alone(tmp_path):
    made = camera(still(), 0.2, frames=3, fps=10)
    done = records(write(tmp_path / "in", list(made.rendered(textured(360, 640, bands=1)[..., 0]))), tmp_path)
    assert [record["changed"] for record in done] == 3 * [False]
    assert all(record["burst"]["others"] == 2 for record in done)


def test_two_frames_of_a_sequence_take_a_usual_ratio(moving, tmp_path, capsys):
    (tmp_path / "in").mkdir()
    for k, frame in enumerate(moving[1][:2]):
        Photo.from_array(frame).save(tmp_path / "in" / f"{k}.png")
    assert rectify(tmp_path / "in", "--sequence", "-o", tmp_path / "out") == 0
    assert "readout ratio 0.500 +- 0.250 (from usual value)" in capsys.readouterr().err


def test_photos_that_came_together_look_like_bursts(moving, tmp_path):
    timed = sorted(write(tmp_path / "timed", moving[1]).iterdir())
    stripped = []
    for k, frame in enumerate(moving[1]):
        stripped.append(tmp_path / f"{k}.png")
        Image.fromarray(frame).convert("RGB").save(stripped[k])
    other = tmp_path / "other.png"
    Image.fromarray(textured(HEIGHT, WIDTH, bands=1)[::-1, ::-1, 0].copy()).convert("RGB").save(other)
    damaged = tmp_path / "damaged.png"
    damaged.write_bytes(b"no picture")
    found = bursts.look_like_bursts([*timed, damaged, *stripped, other], 10**9)
    assert found == [timed, stripped]


def test_photos_of_a_tripod_are_no_burst(tmp_path):
    made = camera(still(), READOUT_S / INTERVAL_S, frames=3, fps=1 / INTERVAL_S)
    photos = []
    for k, frame in enumerate(made.rendered(textured(2 * HEIGHT, 2 * WIDTH, bands=1)[..., 0], 1.0)):
        photos.append(tmp_path / f"{k}.png")
        Image.fromarray(frame).convert("RGB").save(photos[k])
    assert bursts.look_like_bursts(photos, 10**9) == []
