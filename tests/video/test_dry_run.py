"""``unshutter video --dry-run`` lists what a run then does, and writes nothing."""

import json
from typing import Any

import pytest

from support import clips
from support.movie_boxes import box
from unshutter.cli import main
from unshutter.inventory import Fate, Part

GREYS = clips.moving(45)[1]
CREDENTIALS = box(b"uuid", bytes.fromhex("d8fec3d61b0e483c92975828877ec481") + bytes(40))
CHAPTER = {"id": 0, "start": 0, "end": 700, "time_base": clips.Fraction(1, 1000), "metadata": {"title": "One"}}


@pytest.mark.parametrize(("ending", "flags"), [(".mp4", ()), (".mkv", ()), (".mp4", ("--end", "1.3"))])
def test_the_list_is_that_of_the_run(tmp_path, capsys, ending, flags):
    path = tmp_path / "in.mp4"
    more: dict[str, Any] = {
        "tags": {"title": "Walk", "OWN_TAG": "of its owner"},
        "container": {"movflags": "use_metadata_tags"},
    }
    clips.write(path, GREYS, sound=True, subtitles="mov_text", chapters=[CHAPTER], **more)
    path.write_bytes(path.read_bytes() + box(b"free", b"$GPRMC") + CREDENTIALS)
    out, log = tmp_path / f"out{ending}", tmp_path / "log.jsonl"
    words = ["video", str(path), "-o", str(out), "--json-log", str(log), *clips.KNOWN, *flags]
    assert main([*words, "--dry-run"]) == 0
    said = capsys.readouterr()
    assert [each.name for each in tmp_path.iterdir()] == ["in.mp4"]
    assert said.err.splitlines()[-1] == "unshutter: nothing was written"
    assert main(words) == 0
    record = json.loads(log.read_text())
    assert record["rectified"]
    first, *listed = said.out.splitlines()
    assert first == f"{path} -> {out}"
    done = [Part(each["name"], Fate(each["fate"]), each.get("reason", "")) for each in record["parts"]]
    assert listed == [*dict.fromkeys(f"  {part.fate}: {part}" for part in done)]
    assert "  left out: content credentials (they sign the old frames)" in listed
    assert {line.partition(":")[0].strip() for line in listed} >= {"replaced", "carried", "left out"}


def test_a_clip_that_would_be_left(tmp_path, capsys):
    path = clips.write(tmp_path / "in.mkv", clips.standing(20), "ffv1")
    words = ["video", str(path), "--dry-run"]
    assert main([*words, "-o", str(tmp_path / "out.mkv")]) == 0
    assert f"in.mkv -> {tmp_path / 'out.mkv'} (copied: " in capsys.readouterr().out
    assert main(words) == 0
    assert f"{path} (nothing to write: " in capsys.readouterr().out
    assert main([*words, "-o", str(tmp_path / "out.mkv"), "--end", "0.5"]) == 0
    assert capsys.readouterr().out.splitlines()[1:] == ["  replaced: stream 0 (video, ffv1)"]
    assert [each.name for each in tmp_path.iterdir()] == ["in.mkv"]


def test_what_a_run_would_refuse(tmp_path, capsys):
    path = clips.write(tmp_path / "in.mkv", GREYS[:16], "ffv1")
    assert main(["video", str(path), "-o", str(tmp_path / "away" / "out.mkv"), "--dry-run"]) == 1
    assert "there is no folder" in capsys.readouterr().err
    assert main(["video", str(path), "-o", "-", "--dry-run"]) == 2
    assert "leave out - or --dry-run" in capsys.readouterr().err
