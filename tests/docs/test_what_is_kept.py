"""Each sentence of the guide's "What is kept" has tests that check it."""

import io
import re
from pathlib import Path

import av
import pytest

from support import clips
from support.movie_boxes import box, chunk_places, with_gaps
from unshutter.cli import main
from unshutter.video.file import mp4_inventory
from unshutter.video.file.mp4 import Movie

ROOT = Path(__file__).parents[2]
HERE = "docs/test_what_is_kept"
CLIP = "video/test_clip_rectification"
GAIN = "video/calibrate/test_gain"
REPEATED = "video/calibrate/test_repeated_frames"
# how a sentence begins -> the tests that fail if it is not true
CHECKED = {
    "Sound, other tracks": [f"{CLIP}::test_all_but_the_frames_stays_as_it_was"],
    "Frames keep their format": [
        f"{HERE}::test_frames_keep_their_format_and_codec",
        f"{CLIP}::test_all_but_the_frames",
    ],
    "In MP4 and QuickTime files": [
        f"{HERE}::test_everything_but_the_frames_of_an_mp4",
        "video/file/test_mp4_inventory::test_random_boxes_gaps_and_trailers_are_carried",
        "video/file/test_mp4_inventory::test_blocks_between_samples_are_found_where_their_table_says",
    ],
    "Other containers": ["video/file/test_other_containers::test_avi", "video/file/test_part_times::test_a_part_has"],
    "A line lists": [
        "video/file/test_clip_inventory::test_boxes_of_mp4",
        "video/file/test_clip_inventory::test_chunks_of_avi",
        "video/file/test_clip_inventory::test_tags_and_chapters",
        "video/file/test_mp4_inventory::test_what_signs_the_old_frames_is_left_out_and_named",
    ],
    "HDR10+ and Dolby Vision": [
        "video/file/test_dynamic_hdr::test_hdr10_plus_stays_with_its_frames",
        "video/file/test_dynamic_hdr::test_dolby_vision_of_a_picture_that_shows_itself_stays",
        "video/file/test_clip_inventory::test_what_is_in_the_frames",
    ],
    "A second film": ["video/file/test_other_containers::test_a_second_film_is_carried_and_named"],
    "`--dry-run` lists": ["video/test_dry_run::test_the_list_is_that_of_the_run"],
    "The new video is": [
        "video/render/test_size::test_a_video_takes_as_many_bits_as_the_clip_if_asked",
        "video/render/test_size::test_a_quality_is_followed_unless_the_clips_rate_is_asked_for",
    ],
    "**A clip is better": [f"{GAIN}::test_what_does_not_help_is_not_done"],
    "Some tracks": [f"{GAIN}::test_what_a_rolling_shutter", f"{GAIN}::test_what_does_not_help_is_not_done"],
    "So is a clip": [f"{GAIN}::test_distortion_that_nobody_sees_is_left"],
    "`--readout-ms`, `--motion`": [f"{GAIN}::test_a_strength_other_than_asked_of_the_clip_is_obeyed"],
    "Black bars": ["video/file/test_bars::test_bars_of_a_file_stay_byte_for_byte"],
    "Frames that a conversion repeated": [
        f"{REPEATED}::test_repeats_are_straightened_like_the_frame_they_repeat",
        f"{REPEATED}::test_slow_motion_is_measured_on_the_cameras_clock",
    ],
    "`--progressive` says": ["video/file/test_bad_clips::test_the_user_may_say_that_frames_are_whole"],
    "A frame is left unchanged": [
        f"{CLIP}::test_a_camera_that_stood_still",
        f"{CLIP}::test_a_shot_of_a_few_frames_is_left_alone",
    ],
    "So is a scene": ["video/calibrate/test_scene_check::test_frames_are_left_where_less_than_half_of_it_is_there"],
    "The last line counts": ["video/calibrate/test_scene_check::test_a_scene_of_another_camera_is_left_as_it_is"],
    "Single frames": [f"{CLIP}::test_frames_that_show_no_motion_do_not_jump_back_to_their_distortion"],
}
GREYS = clips.moving(16)[1]


def sentences() -> list[str]:
    page = (ROOT / "docs" / "guide" / "video.md").read_text(encoding="utf-8")
    section = page.partition("## What is kept\n")[2].partition("\n## ")[0]
    return re.split(r"(?<=[.!])(?:\*\*)?\s+(?=[A-Z`*])", " ".join(section.split()))


def test_each_sentence_is_checked() -> None:
    begun = {sentence: [key for key in CHECKED if sentence.startswith(key)] for sentence in sentences()}
    assert [sentence for sentence, keys in begun.items() if len(keys) != 1] == []
    assert [key for key in CHECKED if not any(sentence.startswith(key) for sentence in begun)] == []
    for test in (test for tests in CHECKED.values() for test in tests):
        file, _, name = test.partition("::")
        assert f"\ndef {name}" in (ROOT / "tests" / f"{file}.py").read_text(encoding="utf-8"), test


def test_everything_but_the_frames_of_an_mp4_is_the_same(tmp_path) -> None:
    chapter = {"id": 0, "start": 0, "end": 300, "time_base": clips.Fraction(1, 1000), "metadata": {"title": "One"}}
    made = clips.write(tmp_path / "in.mp4", GREYS, sound=True, subtitles="mov_text", chapters=[chapter], turn=90)
    data, _ = with_gaps(made.read_bytes(), {chunk_places(made.read_bytes())[1]: b"gps of a camera"})
    made.write_bytes(data + box(b"free", b"$GPRMC") + box(b"abcd", bytes(range(50))) + b"\x7f\xff\xff\xffbehind")
    out = tmp_path / "out.mp4"
    assert main(["video", str(made), "-o", str(out), *clips.KNOWN]) == 0
    before, after = (Movie.read(io.BytesIO(path.read_bytes())) for path in (made, out))
    assert before.track(1).places[1].sum() != after.track(1).places[1].sum()
    assert mp4_inventory.audit(before, after, before.track(1)) == []
    for held in (b"gps of a camera", b"$GPRMC", bytes(range(50)), b"\x7f\xff\xff\xffbehind"):
        assert out.read_bytes().count(held) == 1


@pytest.mark.parametrize("pixels", ["yuv444p16le", "yuv420p12le", "yuv422p", "gray16le"])
def test_frames_keep_their_format_and_codec(tmp_path, pixels) -> None:
    made = clips.write(tmp_path / "in.mkv", GREYS, "ffv1", pixels)
    assert main(["video", str(made), "-o", str(tmp_path / "out.mkv"), *clips.KNOWN]) == 0
    assert made.read_bytes() != (tmp_path / "out.mkv").read_bytes()
    with av.open(str(tmp_path / "out.mkv")) as video:
        coded = video.streams.video[0].codec_context
        assert (coded.name, coded.pix_fmt) == ("ffv1", pixels)
