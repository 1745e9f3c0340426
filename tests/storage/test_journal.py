"""Lines that are only ever added to, by several runs."""

from pathlib import Path

from unshutter.storage.journal import open_journal
from unshutter.storage.places import objects_below


def test_what_was_added_is_news_once(folder) -> None:
    journal = open_journal(folder, "notes", "run1")
    assert journal.news() == b""
    journal.add("one")
    journal.add("two")
    assert journal.news() == b"one\ntwo\n"
    assert journal.news() == b""
    journal.close()
    assert open_journal(folder, "notes", "run2").news() == b"one\ntwo\n"


def test_the_lines_of_several_runs(folder) -> None:
    for run in ("run1", "run2"):
        journal = open_journal(folder, "notes", run)
        journal.add(f"{run} begins")
        journal.flush()
        journal.add(f"{run} ends")
        journal.close()
    news = open_journal(folder, "notes", "run3").news()
    assert sorted(line for line in news.decode().splitlines() if line) == [
        "run1 begins", "run1 ends", "run2 begins", "run2 ends",
    ]  # fmt: skip


def test_another_runs_lines_are_seen_at_once_in_files(tmp_path: Path) -> None:
    mine, other = (open_journal(tmp_path, "notes", run) for run in ("run1", "run2"))
    other.add("theirs")
    assert mine.news() == b"theirs\n"


def test_a_line_that_was_cut_short_is_ended_by_the_next(tmp_path: Path) -> None:
    (tmp_path / "notes.jsonl").write_bytes(b"one\ntw")
    journal = open_journal(tmp_path, "notes", "run1")
    assert journal.news() == b"one\n"
    journal.add("three")
    assert journal.news() == b"tw\nthree\n"


def test_the_pieces_of_a_run_become_one(memory) -> None:
    journal = open_journal(memory, "notes", "run1")
    for line in ("one", "two", "three"):
        journal.add(line)
        journal.flush()
    assert len(objects_below(memory)) == 3
    journal.close()
    assert [str(name) for name in objects_below(memory)] == ["notes/run1-000000.jsonl"]
    assert open_journal(memory, "notes", "run2").news() == b"one\ntwo\nthree\n"
