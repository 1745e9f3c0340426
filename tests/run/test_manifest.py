"""What a manifest knows of results: finished by a look, its own by the digest."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from support.batches import make_photos, rectify, results
from unshutter.errors import UnshutterError
from unshutter.options import Find, Rectify
from unshutter.run.job import Job, Outcome
from unshutter.run.manifest import NAME, Manifest
from unshutter.storage import files
from unshutter.storage.files import digest, fingerprint
from unshutter.storage.targets import Target, Written


@pytest.fixture
def job(tmp_path: Path) -> Job:
    (tmp_path / "out").mkdir()
    (tmp_path / "a.jpg").write_bytes(b"photo")
    return Job(tmp_path / "a.jpg", (Target(tmp_path / "out" / "a.rectified.jpg"),))


def done(manifest: Manifest, job: Job, data: bytes = b"result") -> None:
    """As a run does it."""
    manifest.begin(job)
    job.picture.write_bytes(data)  # type: ignore[union-attr]
    written = Written(job.picture, fingerprint=fingerprint(job.picture), digest=digest(job.picture))
    made = Outcome(source_is=fingerprint(job.source), written=(written,))
    manifest.end(job, made)
    manifest.close()


def opened(job: Job, options: str = "options") -> Manifest:
    return Manifest(job.picture.parent, Rectify(Find(options)))


def known(job: Job, options: str = "options") -> Manifest:
    return Manifest(job.picture.parent, Rectify(Find(options)), read_only=True)


def test_finished_is_what_is_as_it_was_left(job: Job) -> None:
    assert known(job).compared(job)[0] == "open"
    done(opened(job), job)
    assert known(job).compared(job)[0] == "finished"
    assert known(job, "others").compared(job)[0] == "open"
    job.picture.unlink()
    assert known(job).compared(job)[0] == "open"


def test_a_copied_folder_is_known_by_digest(job: Job) -> None:
    done(opened(job), job)
    os.utime(job.picture, (0, 0))
    assert known(job).compared(job)[0] == "finished"
    job.picture.write_bytes(b"RESULT")  # of the same size
    assert known(job).compared(job)[0] == "open"


def test_nothing_is_read_to_be_skipped(job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    done(opened(job), job)

    def refuse(_: object) -> None:
        raise AssertionError("a finished result was read")

    monkeypatch.setattr(files, "digest", refuse)
    assert known(job).compared(job)[0] == "finished"
    assert known(job, "others").compared(job)[1].targets[0].left is not None  # nor before its job is done


def test_what_an_earlier_run_left_is_known_by_its_digest(job: Job) -> None:
    assert known(job).compared(job)[1] == job
    done(opened(job), job)
    assert known(job, "others").compared(job)[1] == replace(
        job, targets=(Target(job.picture, left=digest(job.picture)),)
    )
    job.picture.write_bytes(b"edited, and longer")
    assert known(job, "others").compared(job)[1].targets == job.targets


def test_what_was_begun_may_have_been_written(job: Job) -> None:
    manifest = opened(job)
    manifest.begin(job)
    assert known(job).compared(job)[1] == replace(job, may_repeat=True)
    manifest.end(job, Outcome(UnshutterError("went wrong")))
    manifest.close()
    assert known(job).compared(job)[1] == job


def test_another_photo_of_the_same_name(job: Job, tmp_path: Path) -> None:
    done(opened(job), job)
    other = tmp_path / "other" / "a.jpg"
    other.parent.mkdir()
    other.write_bytes(b"another photo")
    assert known(job).compared(replace(job, source=other))[0] == "another's"


def test_records_of_runs_without_digests(job: Job) -> None:
    """Of earlier versions: what is finished stays so, but replacing it needs --overwrite."""
    done(opened(job), job)
    path = job.picture.parent / f"{NAME}.jsonl"
    records = [json.loads(line) for line in path.read_text().splitlines()]
    path.write_text("".join(json.dumps({**record, "digests": {}}) + "\n" for record in records))
    assert known(job).compared(job)[0] == "finished"
    assert known(job, "others").compared(job)[1].targets == job.targets


def test_a_result_that_was_edited_to_the_same_size(motion: Path, tmp_path: Path, capsys) -> None:
    make_photos(tmp_path / "in", ["a.png"])
    out = tmp_path / "out"
    assert rectify(tmp_path / "in", "-o", out, "--motion", motion, "--save-motion", out) == 0
    for name in ("a.rectified.png", "a.json"):
        whole = (out / name).read_bytes()
        (out / name).write_bytes(whole[:-1] + b"!")
        before = (out / name).stat()
        os.utime(out / name, ns=(before.st_atime_ns, before.st_mtime_ns))
        words = ["--motion", motion, "--save-motion", out, "--edges", "fill"]
        assert rectify(tmp_path / "in", "-o", out, *words) == 1
        assert f"{name} exists already" in capsys.readouterr().err
        assert (out / name).read_bytes().endswith(b"!")
        (out / name).write_bytes(whole)
    first = results(out)
    assert rectify(tmp_path / "in", "-o", out, *words) == 0  # as they were left: theirs no more
    assert results(out) != first


def test_digests_are_only_made_for_manifests(motion: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_photos(tmp_path / "in", ["a.jpg"])
    made = []
    monkeypatch.setattr("unshutter.run.work.digest", lambda path: made.append(path))
    assert rectify(tmp_path / "in" / "a.jpg", "--motion", motion) == 0
    assert made == []
    assert rectify(tmp_path / "in", "-o", tmp_path / "out", "--motion", motion) == 0
    assert made == [tmp_path / "out" / "a.rectified.jpg"]


def test_what_another_run_begins_meanwhile_is_not_taken_for_somebody_elses(job: Job) -> None:
    """As a dry run sees it, beside a run that is at work."""
    one, other = (replace(job, targets=(Target(job.picture.with_name(name)),)) for name in ("b.jpg", "c.jpg"))
    done(opened(job), job)
    looking = known(job)
    assert not any(looking.has_begun(each) for each in (job, one, other))
    for each in (one, other):
        done(opened(job), each)
    assert looking.has_begun(one) and looking.has_begun(other)
    assert not looking.has_begun(job)  # known from the beginning, so what is in its place is in the way
