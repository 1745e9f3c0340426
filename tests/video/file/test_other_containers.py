"""Clips into films of another kind: each stream is kept, or named."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from support import clips
from support.refusals import left_behind, refused
from unshutter.cli import main
from unshutter.photo.boxes import inside
from unshutter.video.file import mp4
from unshutter.video.file.clip_facts import read_clip_facts

GREYS = clips.moving(6)[1]
COVER = cv2.imencode(".jpg", np.full((32, 32, 3), 90, np.uint8))[1].tobytes()
TIMECODE = "01:02:03:04"


def written(capsys, source, target):
    """What is not kept."""
    assert main(["video", str(source), "-o", str(target), *clips.KNOWN]) == 0
    assert np.allclose(times(target), times(source), atol=0.002)
    said = capsys.readouterr()
    return [line for line in (said.out + said.err).splitlines() if "not kept" in line]


def times(path):
    return np.array([frame.time for frame in read_clip_facts(path).frames_between()])


def streams(path):
    """(type, codec) of the streams other than the video."""
    with av.open(str(path)) as video:
        rest = [each for each in video.streams if each is not video.streams.video[0]]
        return [(each.type, each.codec_context.name if each.codec_context else None) for each in rest]


def covers(path):
    with av.open(str(path)) as video:
        pictures = {each.index for each in video.streams.video if each.disposition & 0x400}
        return [bytes(packet) for packet in video.demux() if packet.stream_index in pictures and packet.size]


@pytest.mark.parametrize("ending", [".mp4", ".mov"])
@pytest.mark.parametrize(
    ("codec", "format_", "sound"),
    [("mpeg4", "yuv420p", "mp2"), ("mjpeg", "yuvj420p", "pcm_s16le"), ("libx264", "yuv420p", "ac3")],
)
def test_avi(tmp_path, capsys, codec, format_, sound, ending):
    source = clips.write(tmp_path / "in.avi", GREYS, codec, format_, sound=sound)
    assert not written(capsys, source, tmp_path / f"out{ending}")
    assert [kind for kind, _ in streams(tmp_path / f"out{ending}")] == ["audio"]


def test_sound_that_a_container_takes_only_next_to_frames(tmp_path, capsys):
    only = {"b": "20M", "bf": "0"}  # as broadcasters write it
    greys = clips.moving(24)[1]
    source = clips.write(tmp_path / "in.mxf", greys, "mpeg2video", "yuv422p", sound="pcm_s16le", options=only)
    assert not written(capsys, source, tmp_path / "out.mxf")
    assert source.read_bytes() != (tmp_path / "out.mxf").read_bytes()  # it was straightened
    assert streams(tmp_path / "out.mxf") == [("audio", "pcm_s16le")]


def with_chapter_pictures(path):
    """A clip whose first track holds pictures of its chapters, to which the film, in the second one, refers."""
    film = clips.write(path.with_name("film.mov"), clips.moving(16)[1])
    with av.open(str(film)) as old, av.open(str(path), "w") as new:
        pictures = new.add_stream("mjpeg", rate=30)
        pictures.width, pictures.height, pictures.pix_fmt = 32, 32, "yuvj420p"
        copy = new.add_stream_from_template(old.streams.video[0], opaque=True)
        new.start_encoding()
        picture = av.Packet(COVER)
        picture.stream, picture.pts, picture.dts, picture.time_base = pictures, 0, 0, pictures.time_base
        new.mux(picture)
        for packet in old.demux():
            if packet.size:
                packet.stream = copy
                new.mux(packet)
    data = path.read_bytes()
    at = data.rindex(b"moov") - 4  # it stands last
    moov = b""
    for name, content in inside(data[at + 8 :]):
        is_film = name == b"trak" and b"avc1" in content
        moov += mp4.box(name, content + mp4.box(b"tref", mp4.box(b"chap", b"\0\0\0\1")) if is_film else content)
    path.write_bytes(data[:at] + mp4.box(b"moov", moov))
    return path


def packets_of(path, number):
    with av.open(str(path)) as video:
        return [bytes(packet) for packet in video.demux(video.streams[number]) if packet.size]


def test_pictures_of_chapters_that_come_first_are_kept_and_the_film_is_straightened(tmp_path, capsys):
    source = with_chapter_pictures(tmp_path / "in.mov")
    assert not written(capsys, source, tmp_path / "out.mov")
    assert set(packets_of(tmp_path / "out.mov", 0)) == {COVER}  # FFmpeg also gives it as an attached picture
    assert packets_of(tmp_path / "out.mov", 1) != packets_of(source, 1)


@pytest.mark.parametrize("ending", [".mp4", ".mov", ".mkv"])
def test_cover_picture_and_attachment(tmp_path, capsys, ending):
    made = clips.write(tmp_path / "made.mkv", GREYS, sound=True, tags={"title": "Walk", "OWN_TAG": "of its owner"})
    source = tmp_path / "in.mkv"
    with av.open(str(made)) as old, av.open(str(source), "w") as new:
        copies = [new.add_stream_from_template(each, opaque=True) for each in old.streams]
        new.metadata.update(old.metadata)
        new.add_attachment("cover.jpg", "image/jpeg", COVER)
        new.add_attachment("font.ttf", "font/ttf", b"1234")
        for packet in old.demux():
            if packet.size:
                packet.stream = copies[packet.stream_index]
                new.mux(packet)
    target = tmp_path / f"out{ending}"
    left_out = written(capsys, source, target)
    assert covers(target) == [COVER]
    assert set(clips.facts(target)["tags"].values()) >= {"Walk", "of its owner"}
    assert ("font.ttf" in "".join(left_out)) == (("attachment", None) not in streams(target)) == (ending != ".mkv")
    if ending == ".mp4":
        assert not written(capsys, target, tmp_path / "again.mov")
        assert covers(tmp_path / "again.mov") == [COVER]


@pytest.mark.parametrize("ending", [".mp4", ".mov", ".mkv"])
def test_timecode(tmp_path, capsys, ending):
    source = clips.write(tmp_path / "in.mp4", clips.moving(16)[1], stream_tags={"timecode": TIMECODE})
    assert ("data", None) in streams(source)
    assert not written(capsys, source, tmp_path / f"out{ending}")
    assert source.read_bytes() != (tmp_path / f"out{ending}").read_bytes()
    tags = clips.facts(tmp_path / f"out{ending}")["streams"][0]["tags"]
    assert TIMECODE in (tags.get("timecode"), tags.get("TIMECODE"))


@pytest.mark.parametrize(
    ("sound", "ending", "kept"),
    [("pcm_s16le", ".mp4", True), ("flac", ".mov", False), ("libopus", ".mp4", True), ("libopus", ".mov", False)],
)
def test_sound(tmp_path, capsys, sound, ending, kept):
    source = clips.write(tmp_path / "in.mkv", GREYS, sound=sound)
    left_out = written(capsys, source, tmp_path / f"out{ending}")
    assert len(streams(tmp_path / f"out{ending}")) == kept
    assert kept or f"stream 1 (audio, {sound.removeprefix('lib')})" in left_out[0]


@pytest.mark.parametrize(("codec", "ending"), [("rawvideo", ".mov"), ("ffv1", ".mov"), ("huffyuv", ".mkv")])
def test_a_codec_that_the_video_cannot_hold(tmp_path, capsys, codec, ending):
    source = clips.write(tmp_path / "in.avi", GREYS, codec, "yuv422p" if codec == "huffyuv" else "yuv420p")
    words = [source, "-o", tmp_path / f"out{ending}", *clips.KNOWN]
    refused(capsys, words, 1, f"cannot write {codec} into {ending} videos", "add --codec libx264")
    assert left_behind(tmp_path) == []


def test_h263_in_3gp(tmp_path, capsys):
    """MP4 does not take it."""
    greys = [np.pad(grey, ((0, 0), (0, 160)), mode="edge")[:, :352] for grey in clips.moving(24)[1]]
    greys = [np.pad(grey, ((0, 288 - len(grey)), (0, 0)), mode="edge") for grey in greys]
    source = clips.write(tmp_path / "in.3gp", greys, "h263", options={"b": "2000000"})
    assert not written(capsys, source, tmp_path / "out.3gp")
    assert clips.facts(tmp_path / "out.3gp")["streams"][0]["codec"] == "h263"
    assert source.read_bytes() != (tmp_path / "out.3gp").read_bytes()


def test_transparency_of_vp9_is_named(tmp_path, capsys):
    source = clips.write(tmp_path / "in.webm", GREYS, "libvpx-vp9", "yuva420p", options={"b": "2000000"})
    assert clips.facts(source)["streams"][0]["tags"]["alpha_mode"] == "1"
    (line,) = written(capsys, source, tmp_path / "out.mkv")
    assert line.endswith("not kept: transparency (FFmpeg does not decode that of VP8 and VP9)")
    assert "alpha_mode" not in clips.facts(tmp_path / "out.mkv")["streams"][0]["tags"]


def test_dnxhr(tmp_path, capsys):
    greys = [np.pad(grey, ((0, 0), (0, 64)), mode="edge") for grey in GREYS]
    source = clips.write(tmp_path / "in.mov", greys, "dnxhd", "yuv422p", options={"profile": "dnxhr_hq"})
    assert not written(capsys, source, tmp_path / "out.mov")
    assert clips.facts(tmp_path / "out.mov")["streams"][0]["profile"] == "DNXHR HQ"


@pytest.mark.parametrize("name", ["out.mpd", "out.m3u8", "out.ismv", "out.bmp", "out.webp"])
def test_films_of_several_files_are_refused(tmp_path, capsys, name):
    source = clips.write(tmp_path / "in.mp4", GREYS)
    (tmp_path / "chunk-stream0-00001.m4s").write_bytes(b"of another video")
    before = sorted(tmp_path.iterdir())
    refused(
        capsys, [source, "-o", tmp_path / name, *clips.KNOWN], 1, "no video that is one file", "use .mp4, .mov or .mkv"
    )
    assert sorted(tmp_path.iterdir()) == before
    assert (tmp_path / "chunk-stream0-00001.m4s").read_bytes() == b"of another video"


@pytest.mark.parametrize(
    ("name", "ending"), [("in.mkv", ".mkv"), ("in.mkv", ".mp4"), ("in.ts", ".ts"), ("in.mp4", ".mp4")]
)
def test_a_second_film_is_carried_and_named(tmp_path, capsys, name, ending):
    """Matroska's first packets have no decoding times if frames are reordered."""
    film = clips.write(tmp_path / "film.mp4", clips.moving(16)[1], options={"bf": "2"})
    source = tmp_path / name
    with av.open(str(film)) as old, av.open(str(source), "w") as new:
        copies = [new.add_stream_from_template(old.streams.video[0], opaque=True) for _ in range(2)]
        packets = [packet for packet in old.demux() if packet.size]
        for packet in packets:
            for copy in copies:
                twin = av.Packet(bytes(packet))
                twin.pts, twin.dts, twin.time_base = packet.pts, packet.dts, packet.time_base
                twin.is_keyframe, twin.stream = packet.is_keyframe, copy
                new.mux(twin)
    target = tmp_path / f"out{ending}"
    assert main(["video", str(source), "-o", str(target), *clips.KNOWN]) == 0
    assert "only one film of a file is straightened" in capsys.readouterr().err
    assert pictures(target, 1) == pictures(source, 1)
    assert pictures(target, 0) != pictures(source, 0)


def pictures(path, number):
    with av.open(str(path)) as video:
        return [bytes(frame.planes[0]) for frame in video.decode(video.streams.video[number])]


def test_avi_whose_clock_ticks_twice_a_frame(tmp_path, capsys):
    """FFmpeg writes H.264 so into AVI; its header counts ticks."""
    film = clips.write(tmp_path / "film.avi", clips.moving(16)[1], options={"bf": "0"})
    with av.open(str(film)) as old, av.open(str(tmp_path / "in.avi"), "w") as new:
        copy = new.add_stream_from_template(old.streams.video[0], opaque=True)
        copy.time_base = Fraction(1, 60)
        for packet in old.demux():
            if packet.size:
                packet.stream = copy
                new.mux(packet)
    assert not written(capsys, tmp_path / "in.avi", tmp_path / "out.avi")
