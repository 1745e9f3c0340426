"""``rectify --sequence``: each photo is undone by what its neighbours say, and gets its own motion file."""

import json
from pathlib import Path

import pytest
from PIL import Image

from support.batches import rectify, results
from support.hand_held import FOCAL, clip, hand, pan
from unshutter import Motion, Photo
from unshutter.options import Clock, Neighbours, Rectify
from unshutter.run.job import Job
from unshutter.run.sequences import add_motions
from unshutter.storage.targets import Target
from unshutter_lab.evaluation.metrics import motion_error

RATIO = ("--readout-ratio", "0.9")
FOCAL_PX = ("--focal-px", FOCAL)  # half of a search is to find it


@pytest.fixture
def moving(tmp_path):
    """(camera, folder of its frames)."""
    camera, frames = clip(hand(4), 0.9, frames=6)
    (tmp_path / "frames").mkdir()
    for k, frame in enumerate(frames):
        Photo.from_array(frame).save(tmp_path / "frames" / f"{k}.png")
    return camera, tmp_path / "frames"


def errors(camera, folder):
    motions = [Motion.load(file) for file in sorted(folder.glob("*.json"))]
    return [motion_error(motion, camera.motion(k)).epe for k, motion in enumerate(motions)]


@pytest.mark.parametrize("how", [(), ("--jobs", 2)])
def test_each_photo_gets_its_own_motion(moving, tmp_path, how):
    camera, folder = moving
    assert (
        rectify(folder, "--sequence", *RATIO, *FOCAL_PX, "-o", tmp_path / "out", "--save-motion", tmp_path, *how) == 0
    )
    assert len(results(tmp_path / "out")) == 6
    found = errors(camera, tmp_path)
    assert len(found) == 6 and max(found) < 0.5


def test_finished_frames_are_still_neighbours(moving, tmp_path):
    _, folder = moving
    words = (folder, "--sequence", *RATIO, *FOCAL_PX, "-o", tmp_path / "out")
    assert rectify(*words) == 0
    before = results(tmp_path / "out")
    (tmp_path / "out" / "3.rectified.png").unlink()
    assert rectify(*words) == 0
    assert results(tmp_path / "out") == before


def test_other_ratios_are_other_results(moving, tmp_path, capsys):
    _, folder = moving
    assert rectify(folder, "--sequence", *RATIO, *FOCAL_PX, "-o", tmp_path / "out") == 0
    before = results(tmp_path / "out")
    assert rectify(folder, "--sequence", "--readout-ratio", "0.3", *FOCAL_PX, "-o", tmp_path / "out") == 0
    assert "finished already" not in capsys.readouterr().err
    assert results(tmp_path / "out") != before


def test_a_photo_that_cannot_be_read_parts_the_sequence_and_is_reported(moving, tmp_path, capsys):
    _, folder = moving
    (folder / "2.png").write_bytes(b"no picture")
    assert rectify(folder, "--sequence", *RATIO, *FOCAL_PX, "-o", tmp_path / "out") == 1
    assert len(results(tmp_path / "out")) == 5
    assert capsys.readouterr().err.count("2.png") == 1


def test_where_the_ratio_cannot_be_told_nothing_is_written(tmp_path, capsys):
    (tmp_path / "in").mkdir()
    for k, frame in enumerate(clip(pan(), 0.8, frames=8)[1]):
        Photo.from_array(frame).save(tmp_path / "in" / f"{k}.png")
    assert rectify(tmp_path / "in", "--sequence", "-o", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert "give --readout-ratio" in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_what_falls_back_is_rectified_by_itself(tmp_path):
    """An even pan does not tell the readout time: each photo is then what it is on its own, and the log says so."""
    (tmp_path / "in").mkdir()
    for k, frame in enumerate(clip(pan(), 0.8, frames=8)[1]):
        Photo.from_array(frame).save(tmp_path / "in" / f"{k}.png")
    log = tmp_path / "log"
    assert rectify(tmp_path / "in", "--sequence", "--fallback", "-o", tmp_path / "out", "--json-log", log) == 0
    assert {event["model"] for event in map(json.loads, log.read_text().splitlines()[:-1])} == {"alone"}
    assert rectify(tmp_path / "in", "-o", tmp_path / "alone") == 0
    assert results(tmp_path / "out") == results(tmp_path / "alone")


def test_the_model_may_be_forced_and_the_log_says_it(moving, tmp_path):
    _, folder = moving
    for model in ("camera", "dense"):
        log, words = tmp_path / f"{model}.log", (*FOCAL_PX, "--model", model, "-o", tmp_path / model)
        assert rectify(folder, "--sequence", *RATIO, *words, "--json-log", log) == 0
        done = [json.loads(line) for line in log.read_text().splitlines()][:-1]
        assert {event["model"] for event in done} == {model}
    assert results(tmp_path / "camera") != results(tmp_path / "dense")


def tagged(path, time, fraction):
    """Gives a file the time at which it was taken, as cameras write it."""
    exif = Image.Exif()
    exif[0x8769] = {0x9003: time, 0x9291: fraction}
    Image.open(path).save(path, exif=exif)


def test_gaps_in_time_part_a_sequence(moving, tmp_path):
    """Half a second between photos, but a day between the third and the fourth."""
    _, folder = moving
    for k, path in enumerate(sorted(folder.glob("*.png"))):
        tagged(path, f"2026:01:0{1 if k < 3 else 2} 12:00:0{k // 2}", f"{5 * (k % 2)}")
    photos = [Path(path) for path in sorted(folder.glob("*.png"))]
    jobs = [Job(photo, (Target(tmp_path / photo.name),)) for photo in photos]
    neighbours = Neighbours(sequence=True, clock=Clock(0.9))
    complete, _ = add_motions(jobs, photos, Rectify(neighbours=neighbours), 10**8)
    assert [(job.before and job.before.stem, job.after and job.after.stem) for job in complete] == [
        (None, "1"),
        ("0", "2"),
        ("1", None),
        (None, "4"),
        ("3", "5"),
        ("4", None),
    ]


def test_missing_numbers_part_a_sequence(moving, tmp_path, capsys):
    """A frame that was deleted took its time: those next to it are not neighbours."""
    _, folder = moving
    photos = [Path(path) for path in sorted(folder.glob("*.png")) if path.stem != "4"]
    jobs = [Job(photo, (Target(tmp_path / photo.name),)) for photo in photos]
    request = Rectify(neighbours=Neighbours(sequence=True, clock=Clock(0.9)))
    complete, _ = add_motions(jobs, photos, request, 10**8)
    found = [(job.before and job.before.stem, job.after and job.after.stem) for job in complete]
    assert found == [(None, "1"), ("0", "2"), ("1", "3"), ("2", None), (None, None)]
    line = f"unshutter: the sequence is interrupted before {photos[-1]}: numbers are missing in the names\n"
    assert capsys.readouterr().err == line
    complete, _ = add_motions(jobs[::2], photos[::2], request, 10**8)  # too few to tell how they count
    assert [job.after and job.after.stem for job in complete] == ["2", "5", None]
    assert not capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--sequence",), "several photos"),
        (("--sequence", "--before", "b.png"), "leave out --before"),
        (("--readout-ratio", "0.5", "--fallback"), "--sequence"),
        (("--sequence", "--motion", "m.json"), "leave out --motion"),
        (("--sequence", "--roll-deg", "1"), "for single photos"),
        (("--readout-ratio", "0.5"), "--sequence"),
    ],
)
def test_what_does_not_go_together_is_refused(moving, words, says, capsys):
    _, folder = moving
    assert rectify(folder / "0.png", *words) == 2
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1
