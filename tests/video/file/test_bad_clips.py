"""What is no clip, or cannot be worked on: one clear line, the right exit code, and no half-written file."""

import os
import resource
import signal
import struct
import subprocess
import sys
import time
import tracemalloc
from itertools import pairwise

import av
import numpy as np
import pytest

from support import clips
from support.covering import thorough
from support.refusals import left_behind, refused
from unshutter import UnshutterError, measure_clips, rectify_clip
from unshutter.cli import main
from unshutter.options.clip_options import RectifyClip
from unshutter.video.file import mp4, mp4_writer

GREYS = clips.moving(16)[1]


@pytest.fixture
def clip(tmp_path):
    return clips.write(tmp_path / "in.mp4", GREYS, sound=True)


@pytest.mark.parametrize("flags", [(), ("--readout-ratio", "0.6"), ("--stabilize",), ("--strength", "0")])
def test_a_part_without_frames(tmp_path, capsys, flags):
    clip = clips.write(tmp_path / "gap.mkv", GREYS[:7], "ffv1", times=[*range(0, 6000, 1000), 60_000])
    words = [clip, "-o", tmp_path / "out.mkv", "--start", "0.5", "--end", "1.5", *flags]
    refused(capsys, words, 1, "gap.mkv has no frames in this part")


def test_not_there(tmp_path, capsys):
    refused(capsys, [tmp_path / "no.mp4", "-o", tmp_path / "out.mp4"], 1, "no.mp4", "No such file")


def test_no_video_at_all(tmp_path, capsys):
    text = tmp_path / "in.mp4"
    text.write_text("hello, this is a letter" * 100)
    refused(capsys, [text, "-o", tmp_path / "out.mp4"], 1, "no video that can be read")


def test_what_cannot_be_is_reported_before_the_work(tmp_path, capsys, clip, monkeypatch):
    monkeypatch.setattr("unshutter.video.calibrate.questions.sample_frames", None)  # the long search
    refused(capsys, [clip, "-o", tmp_path / "out.txt"], 1, "ends in '.txt': use .mp4, .mov or .mkv")
    refused(capsys, [clip, clip], 2, "takes one CLIP: leave out ")
    refused(capsys, [clip, "-o", tmp_path / "out.jpg"], 1, "'.jpg' is not a video", "out/%05d.jpg")
    refused(capsys, [clip, "-o", tmp_path / "out.mp4", "--start", 99], 1, "in.mp4 ends at", "--start")
    refused(capsys, [tmp_path / "photo.jpg"], 2, "is a photo, not a clip: unshutter rectify")


def test_another_ending_or_codec_is_offered_that_works(tmp_path, capsys):
    clip = clips.write(tmp_path / "in.webm", GREYS, "libvpx-vp9", options={"cpu-used": "8"})
    ways = {".mov": "end the name in .mp4 or .mkv, or add --codec libx264", ".ogv": "end the name in"}
    for ending, way in ways.items():
        words = [clip, *clips.KNOWN, "-o", tmp_path / f"out{ending}"]
        refused(capsys, words, 1, f"cannot write libvpx-vp9 into {ending} videos (192x144 px, yuv420p): {way}")
    for kind, flags in ((".mkv", []), (".mov", ["--codec", "libx264"])):
        out = tmp_path / f"out{kind}"
        assert main(["video", *map(str, [clip, *clips.KNOWN, "-o", out, "--overwrite", *flags])]) == 0


@pytest.mark.parametrize("kind", ["concat", "hls"])
def test_a_list_of_other_files_is_no_video(tmp_path, capsys, clip, kind):
    """What lists like these name would be opened, wherever it is."""
    texts = {
        "concat": f"ffconcat version 1.0\nfile '{clip.name}'\n",
        "hls": f"#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\n{clip.name}\n#EXT-X-ENDLIST\n",
    }
    path = tmp_path / "list.m3u8"
    path.write_text(texts[kind])
    refused(capsys, [path, "-o", tmp_path / "out.mp4", "--readout-ratio", "0.6"], 1, "no video that can be read")


def test_sound_only(tmp_path, capsys):
    path = tmp_path / "in.mp4"
    with av.open(str(path), "w") as out:
        stream = out.add_stream("aac", rate=48000)
        clips._ring(out, stream, 0)
        out.mux(stream.encode(None))
    refused(capsys, [path, "-o", tmp_path / "out.mp4"], 1, "contains no video")


@pytest.mark.parametrize("early", [True, False], ids=["tables first", "tables last"])
def test_cut_off(tmp_path, capsys, early):
    more = {"container": {"movflags": "faststart"}} if early else {}
    whole = clips.write(tmp_path / "whole.mp4", GREYS, **more).read_bytes()
    cut = tmp_path / "in.mp4"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    refused(capsys, [cut, "-o", tmp_path / "out.mp4", "--readout-ratio", "0.6"], 1, "in.mp4")
    assert left_behind(tmp_path) == []


def test_one_frame_has_no_motion(tmp_path, capsys):
    path = clips.write(tmp_path / "in.mkv", GREYS[:1], "ffv1")
    for flags in ([], ["--readout-ratio", "0.6", "--overwrite"]):
        assert main(["video", str(path), "-o", str(tmp_path / "out.mkv"), *flags]) == 0
        assert "1 left unchanged (there is no frame before or after it)" in capsys.readouterr().err
        assert np.array_equal(clips.luma(tmp_path / "out.mkv"), clips.luma(path))


def test_too_small(tmp_path, capsys):
    path = clips.write(tmp_path / "in.mkv", [grey[:32, :48] for grey in GREYS], "ffv1")
    refused(capsys, [path, "-o", tmp_path / "out.mkv"], 1, "48x32", "64 px")


def test_too_large(tmp_path, capsys, clip):
    words = ["-o", tmp_path / "out.mp4", *clips.KNOWN, "--max-pixels"]
    refused(capsys, [clip, *words, 192 * 144 - 1], 1, "192x144 px", "--max-pixels")
    assert main(["video", *map(str, [clip, *words, 192 * 144])]) == 0
    assert RectifyClip().max_pixels == 38_000_000


@pytest.mark.parametrize("focal", ["1", "7", "1e308"])
def test_a_focal_length_that_no_camera_has(tmp_path, capsys, clip, focal):
    words = [clip, "-o", tmp_path / "out.mp4", "--readout-ratio", "0.6", "--focal-px", focal]
    refused(capsys, words, 2, "--focal-px must lie between", "px")


def test_a_pipe_is_not_waited_for(tmp_path, capsys, clip):
    pipe = tmp_path / "pipe.mp4"
    os.mkfifo(pipe)
    refused(capsys, [pipe, "-o", tmp_path / "out.mp4"], 1, "it is a pipe or a device, not a file")
    refused(capsys, [clip, "-o", tmp_path / "out.mp4", "--motion", pipe], 1, "it is a pipe or a device, not a file")


def test_names_do_not_reach_the_terminal_as_they_are(tmp_path, capsys):
    """Neither those of files nor those in them."""
    path = clips.write(tmp_path / "in\x1b[31m\nb.mkv", GREYS, subtitles="text", stream_tags={"handler_name": "\x1b[1m"})
    assert main(["video", str(path), "-o", str(tmp_path / "out\x1b[32m.mp4"), *clips.KNOWN]) == 0
    shown = capsys.readouterr().err
    assert "\x1b" not in shown and len(shown.splitlines()) == shown.count("\n") <= 3
    assert r"in\x1b[31m\nb.mkv" in shown


def test_interlaced_by_its_rows_not_by_its_flags(tmp_path, capsys):
    flags = {"flags": "+ildct+ilme", "x264-params": "tff=1", "crf": "12"}
    woven = [np.where(np.arange(len(one))[:, None] % 2, one, other) for one, other in pairwise(GREYS)]
    path = clips.write(tmp_path / "woven.mp4", woven, options=flags)
    refused(capsys, [path, "-o", tmp_path / "out.mp4"], 1, "interlaced (its rows show two moments)")
    whole = clips.write(tmp_path / "whole.mp4", GREYS, options=flags)
    with av.open(str(whole)) as video:
        assert next(video.decode(video=0)).interlaced_frame
    assert main(["video", str(whole), "-o", str(tmp_path / "out.mp4"), *clips.KNOWN]) == 0
    assert f"{len(GREYS)} of {len(GREYS)} frames straightened" in capsys.readouterr().err


def test_a_clip_that_is_too_short_does_not_say_that_the_camera_stood_still(tmp_path, capsys):
    path = clips.write(tmp_path / "in.mkv", GREYS[:12], "ffv1")
    assert main(["video", str(path), "-o", str(tmp_path / "out.mkv")]) == 0
    shown = capsys.readouterr().err
    assert "no 20 frames in a row" in shown and "stood still" not in shown and "12 left unchanged" in shown
    assert "give its readout time: --readout-ms" in shown


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        (["--codec", "libnothing"], 1, "no encoder 'libnothing'"),
        (["--codec", "aac"], 2, "not a video encoder"),
        (["--preset", "quick"], 2, "veryfast"),
        (["--crf", "80"], 2, "between 0 and 63"),
        (["--readout-ms", "40"], 2, "33.33 ms apart"),
        (["--readout-ms", "20", "--readout-ratio", "0.5"], 2, "not both"),
        (["--start", "5", "--end", "3"], 2, "--end after it"),
        (["--start", "nan"], 2, "--start must be 0 or later"),
        (["--start", "inf"], 2, "--start must be 0 or later"),
        (["--start", "1e300"], 2, "--start must be 0 or later"),
        (["--end", "nan"], 2, "--end after it"),
        (["--end", "1e300"], 2, "--end after it"),
        (["--max-pixels", "0"], 2, "at least 1"),
        (["--start", "50", "--readout-ratio", "0.6"], 1, ": --start must come before that"),
        (["--start", "999999999", "--readout-ratio", "0.6"], 1, ": --start must come before that"),
        (["--motion", "none.json"], 1, "none.json"),
    ],
)
def test_options_that_cannot_be(tmp_path, capsys, clip, flags, code, message):
    words = flags if "ratio" in "".join(flags) or "-ms" in "".join(flags) else [*flags, "--readout-ratio", "0.6"]
    if "--motion" in flags:
        words = flags
    refused(capsys, [clip, "-o", tmp_path / "out.mp4", *words], code, message)
    assert left_behind(tmp_path) == []


def test_the_clip_itself_is_never_written(capsys, clip):
    before = clip.read_bytes()
    refused(capsys, [clip, "-o", clip, "--overwrite"], 1, "is an original")
    assert clip.read_bytes() == before


def test_what_is_there_stays(tmp_path, capsys, clip):
    out = tmp_path / "out.mp4"
    out.write_bytes(b"mine")
    refused(capsys, [clip, "-o", out], 1, "--overwrite")
    assert out.read_bytes() == b"mine"


def test_an_ending_that_holds_no_video(tmp_path, capsys, clip):
    refused(capsys, [clip, "-o", tmp_path / "out.xyz", "--readout-ratio", "0.6"], 1, ".xyz")
    assert left_behind(tmp_path) == []


def test_the_motion_of_another_clip(tmp_path, capsys, clip):
    saved = tmp_path / "motion.json"
    other = clips.write(tmp_path / "other.mkv", [grey[:128] for grey in GREYS], "ffv1")
    flags = [*clips.KNOWN, "--save-motion", str(saved)]
    assert main(["video", str(other), "-o", str(tmp_path / "o.mkv"), *flags]) == 0
    capsys.readouterr()
    refused(capsys, [clip, "-o", tmp_path / "out.mp4", "--motion", saved], 1, "another clip")
    saved.write_text(saved.read_text().replace('"readout_ratio": 0.6', '"readout_ratio": -7'))
    refused(capsys, [clip, "-o", tmp_path / "out.mp4", "--motion", saved], 1, "motion.json")


def started(tmp_path, clip, **more):
    words = ["video", str(clip), "-o", str(tmp_path / "out.mp4"), *clips.KNOWN]
    slowly_at_once = ["--preset", "veryslow", "--edges", "keep"]  # without a look at all frames first
    command = [sys.executable, "-m", "unshutter", *words, *slowly_at_once]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **more)


def at_work(tmp_path):
    """Waits until frames are being written."""
    until = time.monotonic() + 60
    while not left_behind(tmp_path):
        assert time.monotonic() < until, "nothing was begun"
        time.sleep(0.02)


@pytest.fixture
def long_clip(tmp_path):
    return clips.write(tmp_path / "in.mp4", GREYS * 20, options={"preset": "ultrafast"})


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), thorough(signal.SIGTERM, 143)])
def test_stopped(tmp_path, long_clip, number, code):
    process = started(tmp_path, long_clip)
    at_work(tmp_path)
    process.send_signal(number)
    _, shown = process.communicate(timeout=60)
    assert process.returncode == code
    assert shown.strip().splitlines() == ["unshutter: stopped; no half-written file is left"]
    assert left_behind(tmp_path) == []


def test_killed_and_begun_anew(tmp_path, long_clip, capsys):
    process = started(tmp_path, long_clip)
    at_work(tmp_path)
    process.kill()
    process.communicate(timeout=60)
    assert not (tmp_path / "out.mp4").exists()
    words = ["video", str(long_clip), "-o", str(tmp_path / "out.mp4"), *clips.KNOWN]
    assert main([*words, "--preset", "ultrafast", "--end", "1"]) == 0
    assert "started from the beginning" in capsys.readouterr().err
    assert left_behind(tmp_path) == ["out.mp4"]


def test_no_room_on_the_disc(tmp_path, clip):
    def small():
        resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))

    process = started(tmp_path, clip, preexec_fn=small)
    _, shown = process.communicate(timeout=60)
    assert process.returncode == 1
    assert len(shown.strip().splitlines()) == 1 and "Traceback" not in shown
    assert left_behind(tmp_path) == []


def test_no_folder_for_it(tmp_path, capsys, clip):
    refused(capsys, [clip, "-o", tmp_path / "no" / "out.mp4", "--readout-ratio", "0.6"], 1, "no folder")
    assert not os.path.exists(tmp_path / "no")


def test_ctrl_c_while_the_library_is_loaded(clip):
    """What was imported so far stays behind: a module without its parts."""
    script = (
        "import sys\n"
        "class Stop:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'av.container': sys.meta_path.remove(self); raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Stop())\n"
        "from unshutter.video.file.clip_facts import read_clip_facts\n"
        "try: read_clip_facts(sys.argv[1])\n"
        "except KeyboardInterrupt: sys.exit(130)"
    )
    ended = subprocess.run([sys.executable, "-c", script, str(clip)], capture_output=True, text=True, check=False)
    assert ended.returncode == 130 and not ended.stderr


def test_a_time_scale_of_0(tmp_path, capsys, clip):
    data = bytearray(clip.read_bytes())
    at = data.index(b"mdhd")
    data[at + 16 : at + 20] = bytes(4)
    path = tmp_path / "false.mp4"
    path.write_bytes(data)
    refused(capsys, [path, "-o", tmp_path / "out.mp4"], 1, "the times of its frames cannot be right")


def test_a_false_count_of_samples_takes_no_memory(tmp_path, clip):
    data = bytearray(clip.read_bytes())
    at = data.rindex(b"stsz")
    data[at + 8 : at + 16] = struct.pack(">II", 1, 1 << 20)
    path = tmp_path / "false.mp4"
    path.write_bytes(data)
    tracemalloc.start()
    try:
        with path.open("rb") as stream:
            assert not mp4_writer.can_take(mp4.Movie.read(stream), 1)
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def test_the_user_may_say_that_frames_are_whole(tmp_path, capsys):
    """Rows that look as if they showed two moments may be a fence, or a striped shirt."""
    flags = {"flags": "+ildct+ilme", "x264-params": "tff=1", "crf": "12"}
    striped = [np.where(np.arange(len(grey))[:, None] % 2, grey, grey // 2 + 90).astype(np.uint8) for grey in GREYS]
    path = clips.write(tmp_path / "in.mp4", striped, options=flags)
    refused(capsys, [path, "-o", tmp_path / "out.mp4"], 1, "or, if its frames are whole, add --progressive")
    assert main(["video", str(path), "-o", str(tmp_path / "out.mp4"), "--progressive", *clips.KNOWN]) == 0
    assert f"{len(GREYS)} of {len(GREYS)} frames straightened" in capsys.readouterr().err
    with pytest.raises(UnshutterError, match="interlaced"):
        measure_clips([path])
    (measured,) = measure_clips([path], progressive=True)
    assert measured.width == clips.WIDTH


def with_damage(path, numbers):
    """Overwrites packets of a clip, each of which is a frame of its own."""
    data = bytearray(path.read_bytes())
    with av.open(str(path)) as video:
        packets = [bytes(packet) for packet in video.demux(video=0) if packet.size]
    for number in numbers:
        at = data.index(packets[number])
        data[at : at + len(packets[number])] = bytes(len(packets[number]))
    path.write_bytes(data)
    return path


def test_damaged_frames_are_counted_and_the_others_straightened(tmp_path, capsys):
    clip = with_damage(clips.write(tmp_path / "in.mp4", GREYS, options={"crf": "12"}), [7])
    outcome = rectify_clip(clip, tmp_path / "out.mp4", readout_ratio=clips.RATIO, focal_px=clips.FOCAL)
    assert (outcome.frames, outcome.rectified, outcome.damaged) == (len(GREYS) - 1, len(GREYS) - 1, 1)
    assert outcome.as_json()["damaged"] == 1 and len(clips.times(tmp_path / "out.mp4")) == len(GREYS) - 1
    words = ["video", str(clip), "-o", str(tmp_path / "out.mp4"), "--overwrite", *clips.KNOWN]
    assert main(words) == 0 and "1 frame of" in (shown := capsys.readouterr().err) and "cannot be decoded" in shown
    many = with_damage(clips.write(tmp_path / "many.mp4", GREYS, options={"crf": "12"}), range(3, 12))
    refused(capsys, [many, "-o", tmp_path / "other.mp4"], 1, "is damaged from 0.", "use the intact part")


def test_a_frame_decoded_from_damaged_data_is_left_as_it_is(tmp_path):
    """As FFmpeg marks it: the frames around it are straightened."""
    path = clips.write(tmp_path / "in.mkv", GREYS, "mpeg4", options={"b": "4000000"})
    data = bytearray(path.read_bytes())
    with av.open(str(path)) as video:
        packet = [bytes(packet) for packet in video.demux(video=0) if packet.size][9]
    begin = data.index(packet) + len(packet) // 3
    end = data.index(packet) + len(packet)
    data[begin:end] = np.random.default_rng(1).integers(0, 256, end - begin, dtype=np.uint8).tobytes()
    path.write_bytes(data)
    with av.open(str(path)) as video:
        if not any(frame.is_corrupt for frame in video.decode(video=0)):
            pytest.skip("this FFmpeg does not mark it")
    outcome = rectify_clip(path, tmp_path / "out.mkv", readout_ratio=clips.RATIO, focal_px=clips.FOCAL)
    assert outcome.rectified == len(GREYS) - 1 and outcome.unchanged == {"it is damaged in the file": 1}
