"""Lines that are only ever added to, by one run at a time."""

from pathlib import Path

import pytest

from unshutter import UnshutterError
from unshutter.storage.journals import journal_in
from unshutter.storage.objects import objects_below


def test_what_was_added_is_read_by_the_next_run(folder) -> None:
    journal = journal_in(folder, "notes", "run1")
    assert journal.read() == b""
    journal.add("one")
    journal.add("two")
    journal.close()
    assert journal_in(folder, "notes", "run2", read_only=True).read() == b"one\ntwo\n"


def test_the_lines_of_several_runs(folder) -> None:
    for run in ("run1", "run2"):
        journal = journal_in(folder, "notes", run)
        journal.add(f"{run} begins")
        journal.flush()
        journal.add(f"{run} ends")
        journal.close()
    news = journal_in(folder, "notes", "run3", read_only=True).read()
    assert sorted(line for line in news.decode().splitlines() if line) == [
        "run1 begins", "run1 ends", "run2 begins", "run2 ends",
    ]  # fmt: skip


def test_one_run_at_a_time(tmp_path: Path) -> None:
    first, second = (journal_in(tmp_path, "notes", run) for run in ("run1", "run2"))
    first.add("one")
    with pytest.raises(UnshutterError, match="another run is writing to"):
        second.add("two")
    with pytest.raises(UnshutterError, match="another run is writing to"):
        journal_in(tmp_path, "notes", "run3").read()
    first.close()
    second.add("two")
    second.close()
    assert journal_in(tmp_path, "notes", "run4", read_only=True).read() == b"one\ntwo\n"


def test_a_folder_that_becomes_a_link_does_not_redirect_the_lines(tmp_path: Path) -> None:
    folder, kept, elsewhere = (tmp_path / name for name in ("out", "kept", "elsewhere"))
    elsewhere.mkdir()
    (elsewhere / "notes.jsonl").write_bytes(b"another's\n")
    journal = journal_in(folder, "notes", "run1")
    journal.add("one")
    folder.rename(kept)
    folder.symlink_to(elsewhere)
    journal.add("two")
    journal.close()
    assert (kept / "notes.jsonl").read_bytes() == b"one\ntwo\n"
    assert (elsewhere / "notes.jsonl").read_bytes() == b"another's\n"


def test_a_journal_that_is_replaced_between_reading_and_writing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.jsonl").write_bytes(b"one\n")
    journal = journal_in(tmp_path, "notes", "run1")
    assert journal.read() == b"one\n"
    (tmp_path / "notes.jsonl").unlink()
    (tmp_path / "notes.jsonl").write_bytes(b"another's\n")
    with pytest.raises(UnshutterError, match="was replaced while this run used it"):
        journal.add("two")
    journal.close()
    assert (tmp_path / "notes.jsonl").read_bytes() == b"another's\n"


def test_a_line_that_was_cut_short_is_ended_by_the_next(tmp_path: Path) -> None:
    (tmp_path / "notes.jsonl").write_bytes(b"one\ntw")
    journal = journal_in(tmp_path, "notes", "run1")
    assert journal.read() == b"one\n"
    journal.add("three")
    journal.close()
    assert (tmp_path / "notes.jsonl").read_bytes() == b"one\ntw\nthree\n"


def test_the_pieces_of_a_run_become_one(memory) -> None:
    journal = journal_in(memory, "notes", "run1")
    for line in ("one", "two", "three"):
        journal.add(line)
        journal.flush()
    assert len(objects_below(memory)) == 3
    journal.close()
    assert [str(name) for name in objects_below(memory)] == ["notes/run1-000000.jsonl"]
    assert journal_in(memory, "notes", "run2").read() == b"one\ntwo\nthree\n"
