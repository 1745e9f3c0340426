"""Chapters and the timecode of a clip move along with the part that is written."""

from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise, product

import av
import pytest

from support import clips
from unshutter.cli import main
from unshutter.video.file.part_times import timecode_after

GREYS = clips.moving(45)[1]


def counted(rate: int, dropped: int, minutes: Iterable[int]) -> list[str]:
    """The timecodes of some minutes of the day in their order, counted as the standard says."""
    mark = ";" if dropped else ":"
    return [
        f"{minute // 60:02}:{minute % 60:02}:{second:02}{mark}{number:02}"
        for minute, second in product(minutes, range(60))
        for number in range(dropped if second == 0 and minute % 10 else 0, rate)
    ]


@pytest.mark.parametrize(
    ("rate", "whole", "dropped"),
    [
        (Fraction(25), 25, 0),
        (Fraction(24000, 1001), 24, 0),
        (Fraction(30000, 1001), 30, 2),
        (Fraction(60000, 1001), 60, 4),
    ],
)
def test_timecodes_are_counted_as_the_standard_says(rate, whole, dropped):
    morning = counted(whole, dropped, range(20))
    midnight = counted(whole, dropped, [24 * 60 - 2, 24 * 60 - 1, 0, 1])
    frame_s = 1 / rate
    for codes, begin in (*((morning, at * whole) for at in (0, 59, 9 * 60, 1000)), (midnight, 20 * whole)):
        for one, other in pairwise(range(begin, begin + 70 * whole, 7)):
            assert timecode_after(codes[one], float(7 * frame_s), rate) == codes[other]
        assert timecode_after(codes[begin], float(110 * whole * frame_s), rate) == codes[begin + 110 * whole]
    assert timecode_after("no timecode", 1, rate) == "no timecode"
    assert timecode_after(morning[5], 0.2 * frame_s, rate) == morning[6]  # the next frame is the first one


@pytest.mark.parametrize("ending", [".mov", ".mkv"])
def test_a_part_has_the_chapters_and_the_timecode_of_its_frames(tmp_path, ending):
    chapters = [
        {"id": number, "start": start, "end": end, "time_base": Fraction(1, 1000), "metadata": {"title": title}}
        for number, (title, start, end) in enumerate((("One", 0, 700), ("Two", 700, 1500)), start=1)
    ]
    source = clips.write(tmp_path / "in.mov", GREYS, chapters=chapters, stream_tags={"timecode": "01:02:03:04"})
    words = ["video", str(source), "-o", str(tmp_path / f"out{ending}"), *clips.KNOWN]
    assert main([*words, "--start", "0.9", "--end", "1.2"]) == 0
    with av.open(str(tmp_path / f"out{ending}")) as part:
        found = [
            (each["metadata"]["title"], *(float(each[key] * each["time_base"]) for key in ("start", "end")))
            for each in part.chapters()
        ]
        tags = dict(part.streams.video[0].metadata) | dict(part.metadata)
    assert found == [("Two", 0.0, pytest.approx(0.3))]
    assert "01:02:04:01" in (tags.get("timecode"), tags.get("TIMECODE"))
    assert main([*words, "--end", "0.5", "--overwrite"]) == 0
    with av.open(str(tmp_path / f"out{ending}")) as part:
        assert [each["metadata"]["title"] for each in part.chapters()] == ["One"]
        assert float(part.chapters()[0]["end"] * part.chapters()[0]["time_base"]) == pytest.approx(0.5)
