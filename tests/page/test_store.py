"""Files in folders of their own, and folders that killed processes left."""

import asyncio
import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.page_server import desk
from unshutter.errors import UnshutterError
from unshutter.page.store import Refused, temporary_folder


async def _pieces(*pieces: bytes):
    for piece in pieces:
        yield piece


@pytest.mark.parametrize("name", ["../../../evil.jpg", "/tmp/evil.jpg", "a.jpg/../../b.sh", "photo.jpg", "x"])
def test_a_photo_lies_in_a_folder_of_its_own_whatever_its_name(name: str) -> None:
    with desk() as one:
        kept = asyncio.run(one.store.add(name, _pieces(b"a", b"b")))
        assert kept.path.parent == one.store.folder / kept.id
        assert kept.path.name in ("photo", "photo.jpg")
        assert kept.path.read_bytes() == b"ab"
        one.store.remove(kept)
        assert not kept.path.parent.exists()
        with pytest.raises(Refused):
            one.store.get(kept.id)


def test_nothing_stays_of_a_photo_that_is_not_taken() -> None:
    with desk() as one:
        with pytest.raises(UnshutterError, match="is empty"):
            asyncio.run(one.store.add("a.jpg", _pieces()))
        one.store.most_bytes = 1
        with pytest.raises(Refused):
            asyncio.run(one.store.add("a.jpg", _pieces(b"ab")))
        assert [path.name for path in one.store.folder.iterdir()] == ["lock"]


def test_a_file_in_use_is_kept_when_it_is_closed() -> None:
    with desk() as one:
        kept, other = (asyncio.run(one.store.add("a.jpg", _pieces(b"ab"))) for _ in range(2))
        with one.store.used([kept, other]):
            with one.store.used([kept]):
                one.store.remove(kept)
            assert kept.path.exists()
            with pytest.raises(Refused):
                one.store.get(kept.id)
        assert not kept.path.parent.exists() and one.store.get(other.id).path.exists()
        assert one.store._sizes == {other.id: 2}


@pytest.mark.skipif(sys.platform == "win32", reason="no folder of open files is removed there")
def test_folders_of_killed_processes_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    code = "import os, unshutter.page.store as s\nwith s.temporary_folder() as f: print(f, flush=True); os._exit(9)"
    dead = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {"TMPDIR": str(tmp_path)}, capture_output=True, text=True
    )
    left = Path(dead.stdout.strip())
    assert left.is_dir()
    with temporary_folder() as living:
        assert not left.exists()
        with temporary_folder():
            assert living.exists()  # its process lives
        assert (living.stat().st_mode & 0o777) == 0o700
    assert not living.exists()
