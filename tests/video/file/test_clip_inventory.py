"""What FFmpeg passes over in a clip's file is named."""

import struct

import av
import pytest

from support import clips
from support.movie_boxes import box, chunk_places, with_entry_boxes, with_gaps, with_moov
from unshutter.cli import main
from unshutter.inventory import left_out
from unshutter.video.file.clip_inventory import lost_of_frames
from unshutter.video.file.containers import creation_time, opened

GREYS = clips.moving(24)[1]
CREDENTIALS = box(b"uuid", bytes.fromhex("d8fec3d61b0e483c92975828877ec481") + bytes(40))
CLAP = box(b"clap", struct.pack(">8I", 180, 1, 120, 1, 0, 1, 0, 1))


def not_kept(capsys, source, target, *flags):
    assert main(["video", str(source), "-o", str(target), *clips.KNOWN, *flags]) == 0
    assert source.read_bytes() != target.read_bytes()  # it was straightened
    lines = [line for line in capsys.readouterr().err.splitlines() if "not kept" in line]
    return lines[0].partition("not kept: ")[2] if lines else ""


@pytest.mark.parametrize(("ending", "flags"), [(".mkv", ()), (".mp4", ("--end", "0.4"))])
def test_boxes_of_mp4(tmp_path, capsys, ending, flags):
    made = clips.write(tmp_path / "made.mp4", GREYS, sound=True, tags={"title": "Walk", "OWN_TAG": "of its owner"})
    data = made.read_bytes()
    assert not_kept(capsys, made, tmp_path / f"as{ending}", *flags) == ""
    data = with_entry_boxes(data, CLAP)
    data = with_moov(data, lambda moov: moov + box(b"udta", box(b"CAMS", b"of a camera")) + box(b"Xtra", b"1234"))
    data, _ = with_gaps(data, {chunk_places(data)[2]: b"between"})
    path = tmp_path / "in.mp4"
    path.write_bytes(data + box(b"free", b"$GPRMC") + box(b"free", bytes(99)) + CREDENTIALS + b"\x7f\xff\xff\xffbehind")
    said = not_kept(capsys, path, tmp_path / f"out{ending}", *flags)
    assert "content credentials (they sign the old frames)" in said
    assert "boxes 'CAMS', 'Xtra', 'clap', 'free'" in said
    assert "data between samples" in said and "data behind the last box" in said


def test_chunks_of_avi(tmp_path, capsys):
    made = clips.write(tmp_path / "made.avi", GREYS, "ffv1", tags={"title": "Walk"})
    assert not_kept(capsys, made, tmp_path / "made.out.avi") == ""
    data = made.read_bytes()
    camera = struct.pack("<4sI", b"ncdt", 8) + b"of Nikon"
    data += struct.pack("<4sI4s", b"LIST", len(camera) + 4, b"ncdt") + camera
    path = tmp_path / "in.avi"
    path.write_bytes(data[:4] + struct.pack("<I", len(data) - 8) + data[8:])
    assert not_kept(capsys, path, tmp_path / "out.avi") == "chunks 'ncdt'"
    at = data.index(b"JUNK") + 8  # a chunk that keeps room
    filler = data[:at] + b"OLYM" + data[at + 4 :]
    path.write_bytes(filler[:4] + struct.pack("<I", len(data) - 8) + filler[8:])
    assert not_kept(capsys, path, tmp_path / "filled.avi") == "chunks 'JUNK', 'ncdt'"


def element(number, content):
    return number.to_bytes((number.bit_length() + 7) // 8, "big") + bytes([0x80 | len(content)]) + content


LANGUAGES = "languages of chapters, countries of chapters, regional languages of tracks, regional languages of tags"


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (((0x85, b"One"), (0x85, b"Eins")), "further names of chapters"),
        (((0x437C, b"und"), (0x22B59D, b"en"), (0x447B, b"en")), ""),
        (((0x437C, b"ger"), (0x437E, b"mx"), (0x22B59D, b"es-419"), (0x447B, b"de-AT")), LANGUAGES),
    ],
)
def test_texts_of_matroska_that_ffmpeg_passes_over(tmp_path, capsys, texts, said):
    chapters = [{"id": 0, "start": 0, "end": 200, "time_base": clips.Fraction(1, 1000), "metadata": {"title": "One"}}]
    made = clips.write(tmp_path / "made.mkv", GREYS, chapters=chapters)
    data = made.read_bytes()
    at = data.index(b"\xec\1\0\0\0\0\0\0") + 9  # what keeps room for an index
    names = b"".join(element(0x80, element(kind, text)) for kind, text in texts)  # all in the displays of a chapter
    listed = element(0x1043A770, element(0x45B9, element(0xB6, element(0x73C4, b"\1") + names)))
    assert data[at - 1] > len(listed) + 2
    void = b"\xec" + bytes([0x80 | data[at - 1] + 9 - len(listed) - 2])
    path = tmp_path / "in.mkv"
    path.write_bytes(data[: at - 9] + listed + void + data[at - 9 + len(listed) + 2 :])
    assert not_kept(capsys, path, tmp_path / "out.mkv") == said


def test_date_of_creation(tmp_path, capsys):
    date = "2003-12-12T01:31:27.000000Z"
    for name, codec in (("a.wmv", "wmv2"), ("a.mxf", "mpeg2video")):
        made = clips.write(tmp_path / name, GREYS, codec, options={"b": "2M"}, tags={"creation_time": date})
        for ending, flags in ((made.suffix, ()), (".mkv", ("--codec", "libx264"))):
            target = tmp_path / f"out.{name}{ending}"
            assert "creation_time" not in not_kept(capsys, made, target, *flags)
            with opened(str(target)) as video:
                assert date in (creation_time(video) | video.container.metadata).values()
        assert "creation_time" in not_kept(capsys, made, tmp_path / f"{name}.avi", "--codec", "mjpeg")


def test_texts_of_mxf(tmp_path, capsys):
    made = clips.write(tmp_path / "made.mxf", GREYS, "mpeg2video", options={"b": "2M"})
    assert not_kept(capsys, made, tmp_path / "made.out.mxf") == ""
    data = made.read_bytes()
    text = "Left Channel".encode("utf-16-be")
    at = data.index(bytes(200))  # in a filler
    path = tmp_path / "in.mxf"
    path.write_bytes(data[: at + 20] + text + data[at + 20 + len(text) :])
    assert not_kept(capsys, path, tmp_path / "out.mxf") == "texts of the MXF header"


def test_tags_and_chapters(tmp_path, capsys):
    chapters = [{"id": 0, "start": 0, "end": 200, "time_base": clips.Fraction(1, 1000), "metadata": {"title": "One"}}]
    more = {"tags": {"title": "Walk", "OWN_TAG": "of its owner"}, "chapters": chapters}
    made = clips.write(tmp_path / "made.mkv", GREYS, **more)
    assert not_kept(capsys, made, tmp_path / "out.mkv") == ""
    said = not_kept(capsys, made, tmp_path / "out.avi", "--codec", "mjpeg")
    assert "chapters" in said and "OWN_TAG" in said and "title" not in said
    with av.open(str(tmp_path / "out.avi")) as video:
        assert "Walk" in video.metadata.values()


def test_what_is_in_the_frames():
    before = {"A53_CC": b"1", "SEI_UNREGISTERED": b"of a camera", "FILM_GRAIN_PARAMS": b"", "DISPLAYMATRIX": b""}
    parts = list(lost_of_frames(before, {"DISPLAYMATRIX": b""}))
    assert left_out(parts) == ["closed captions in the frames", "data of the camera in the frames"]
    x264 = bytes.fromhex("dc45e9bde6d948b7962cd820d923eeef") + b"x264"
    assert list(lost_of_frames({"SEI_UNREGISTERED": x264}, {})) == []
    assert list(lost_of_frames({"STEREO3D": bytes(36)}, {})) == []  # a single view
    assert left_out(lost_of_frames({"STEREO3D": b"\1" + bytes(35)}, {})) == ["arrangement of two views"]
    assert left_out(lost_of_frames({"DOVI_METADATA": b""}, {})) == ["Dolby Vision (it describes the old frames)"]
