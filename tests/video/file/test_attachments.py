"""Files attached to a Matroska clip: they are kept, do not count as its video, and are not held many times."""

import os
import subprocess
import sys
from pathlib import Path

import av
import pytest

from support import clips
from unshutter.video.file.clip_facts import read_clip_facts

_, GREYS = clips.moving(12)
MEGABYTES = 60


@pytest.fixture(scope="module")
def attached(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip with a large file in it."""
    folder = tmp_path_factory.mktemp("attached")
    made = clips.write(folder / "made.mkv", GREYS)
    with av.open(str(made)) as old, av.open(str(folder / "in.mkv"), "w") as new:
        copy = new.add_stream_from_template(old.streams.video[0], opaque=True)
        new.add_attachment("notes.bin", "application/octet-stream", os.urandom(MEGABYTES << 20))
        for packet in old.demux():
            if packet.size:
                packet.stream = copy
                new.mux(packet)
    return folder / "in.mkv"


def test_attachments_do_not_count_as_video(attached: Path) -> None:
    with_file = read_clip_facts(str(attached)).coding.bits_per_s
    without = read_clip_facts(str(attached.with_name("made.mkv"))).coding.bits_per_s
    assert without > 0
    assert with_file == pytest.approx(without, rel=0.3)  # the file's own headers count


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs the peak memory of a child process")
def test_attachments_are_not_held_many_times(attached: Path, tmp_path: Path) -> None:
    """FFmpeg alone holds one four times when it opens the file; copying it into the new one takes one more."""
    opening = [sys.executable, "-c", f"import av; av.open({str(attached)!r})"]
    running = [sys.executable, "-m", "unshutter", "video", str(attached), "-o", str(tmp_path / "out.mkv"), *clips.KNOWN]
    without = [*running]
    without[4] = str(attached.with_name("made.mkv"))
    without[6] = str(tmp_path / "small.mkv")
    more = (_peak_megabytes(running) - _peak_megabytes(without)) / MEGABYTES
    assert more < _peak_megabytes(opening) / MEGABYTES + 2
    with av.open(str(tmp_path / "out.mkv")) as video:
        assert [len(each.data) for each in video.streams if each.type == "attachment"] == [MEGABYTES << 20]


def _peak_megabytes(command: list[str]) -> float:
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    assert child.returncode == 0
    return usage.ru_maxrss / (1 << 10 if sys.platform == "linux" else 1 << 20)
