"""What PyAV 18 and 19 do differently, on whichever is installed, and what each of them is asked for."""

import contextlib
import io
import signal
import time
from types import SimpleNamespace

import av
import numpy as np
import pytest
from PIL import Image

from support import clips
from unshutter import cli
from unshutter.frames import pyav
from unshutter.video.file.pixels import upright


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


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_frames_with_exif_have_their_rotation(tmp_path, turn):
    """PyAV 18.1 has no name for Exif, which FFmpeg 8 finds in the frames of MJPEG videos, and then tells nothing."""
    exif = Image.Exif()
    exif[0x010F] = "Maker"
    picture = io.BytesIO()
    Image.new("RGB", (64, 48)).save(picture, "JPEG", exif=exif)
    path = tmp_path / "in.mov"
    with av.open(str(path), "w") as out:
        stream = out.add_stream("mjpeg", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        stream.set_display_rotation(turn)
        out.start_encoding()
        packet = av.Packet(picture.getvalue())
        packet.stream, packet.pts, packet.dts, packet.time_base = stream, 0, 0, stream.time_base
        out.mux(packet)
    with pyav.open_to_read(str(path)) as container:
        frame = next(container.decode(video=0))
    pixels = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    assert np.array_equal(upright(pixels, frame), np.rot90(pixels, round(frame.rotation / 90)))
    assert round(frame.rotation) % 360 in (turn, (360 - turn) % 360)


@pytest.mark.parametrize(
    ("matrix", "shown"),
    [
        ((1, 0, 0, 1), lambda pixels: pixels),
        ((-1, 0, 0, 1), np.fliplr),
        ((1, 0, 0, -1), np.flipud),
        ((-1, 0, 0, -1), lambda pixels: np.rot90(pixels, 2)),
        ((0, 1, 1, 0), lambda pixels: np.swapaxes(pixels, 0, 1)),
        ((0, 1, -1, 0), lambda pixels: np.rot90(pixels, -1)),
        ((0, -1, 1, 0), np.rot90),
        ((0, -1, -1, 0), lambda pixels: np.rot90(np.swapaxes(pixels, 0, 1), 2)),
    ],
)
def test_frames_are_shown_rotated_and_mirrored_as_their_file_says(tmp_path, matrix, shown):
    a, b, c, d = (number << 16 for number in matrix)
    path = tmp_path / "in.mp4"
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.set_display_matrix([a, b, 0, c, d, 0, 0, 0, 1 << 30])
        for packet in [*stream.encode(av.VideoFrame(64, 48, "yuv420p")), *stream.encode(None)]:
            out.mux(packet)
    with pyav.open_to_read(str(path)) as container:
        frame = next(container.decode(video=0))
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    assert np.array_equal(upright(pixels, frame), shown(pixels))


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
