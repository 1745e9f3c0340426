"""What PyAV 18 and 19 do differently, on whichever is installed, and what each of them is asked for."""

import contextlib
import io
import signal
import time
from types import SimpleNamespace

import pytest

from support import clips
from unshutter import cli
from unshutter.frames import pyav


@pytest.fixture
def video(tmp_path):
    path = clips.write(tmp_path / "video.mp4", [clips.wall()] * 2, turn=90, tags={"artist": "Jose!"})
    path.write_bytes(path.read_bytes().replace(b"Jose!", b"Jos\xe9!"))  # Latin-1
    return path


def test_a_video_with_tags_that_are_no_utf8_is_read_and_its_tags_can_be_shown(video):
    with pyav.open_to_read(str(video)) as container:
        shown = pyav.tags(container)["artist"]
    assert shown == "Jos\ufffd!"
    shown.encode()


def test_side_data_has_ffmpegs_names(video):
    with pyav.open_to_read(str(video)) as container:
        frame = next(container.decode(video=0))
    found = pyav.side_data(frame)
    assert len(found["DISPLAYMATRIX"]) == 36
    assert all(isinstance(data, bytes) for data in found.values())


@pytest.mark.parametrize(
    ("version", "asked"), [("18.1.0", {"metadata_errors": "replace"}), ("19.0.2", {}), ("20.0", {})]
)
def test_only_pyav_18_takes_a_rule_for_tags(monkeypatch, version, asked):
    library = SimpleNamespace(__version__=version, open=lambda source, **arguments: (source, arguments))
    monkeypatch.setattr(pyav, "av", lambda: library)
    assert pyav.open_to_read("video.mp4", options={}) == ("video.mp4", {"options": {}, **asked})


def test_a_position_that_there_cannot_be_prints_nothing(tmp_path, capfd):
    """As in a damaged WMV, where PyAV printed the traceback of the file's own exception."""

    class Odd(io.BytesIO):
        def seek(self, offset, whence=0):
            raise OSError(22, "Invalid argument")

    whole = clips.write(tmp_path / "in.mov", clips.moving(4)[1], "mpeg4").read_bytes()
    with contextlib.suppress(OSError, ValueError), pyav.open_to_read(Odd(whole)) as container:
        list(container.demux())
    assert "Traceback" not in "".join(capfd.readouterr())


class _Signalling(io.BytesIO):
    """A file during whose seek the program is asked to end."""

    def seek(self, offset: int, whence: int = 0) -> int:
        signal.raise_signal(signal.SIGTERM)
        return super().seek(offset, whence)


def test_a_signal_waits_until_ffmpeg_has_its_answer():
    """FFmpeg prints the traceback of whatever is raised meanwhile, and takes the video for damaged."""
    usual = signal.signal(signal.SIGTERM, cli._stop)
    try:
        assert pyav._Seekable(_Signalling(b"film")).seek(2) == 2
        with pytest.raises(cli.Stopped):
            time.sleep(5)
    finally:
        signal.signal(signal.SIGTERM, usual)
