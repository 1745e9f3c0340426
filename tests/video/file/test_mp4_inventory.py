"""What an MP4 or QuickTime file holds besides its film is carried byte for byte, or named."""

import io
import json
import random
import struct

import av
import pytest

from support import clips
from support.covering import thorough
from support.movie_boxes import (
    box,
    boxes,
    chunk_places,
    content_of,
    rebuilt,
    with_box_behind,
    with_entry_boxes,
    with_gaps,
    with_moov,
)
from unshutter.cli import main
from unshutter.inventory import Fate, left_out
from unshutter.video.file import mp4_inventory
from unshutter.video.file.clip_facts import read_clip_facts
from unshutter.video.file.mp4 import Movie
from unshutter.video.file.mp4_writer import can_take, write_with_video

GREYS = clips.moving(16)[1]
CREDENTIALS = box(b"uuid", bytes.fromhex("d8fec3d61b0e483c92975828877ec481") + bytes(4) + b"manifest\0" + bytes(40))
ALL = slice(None)


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    """A film with sound, whose tables come last or first; and other frames for it."""
    folder = tmp_path_factory.mktemp("films")
    short = {"options": {"g": "4", "bf": "2"}, "sound": True}
    late = clips.write(folder / "late.mp4", GREYS, **short)
    early = clips.write(folder / "early.mp4", GREYS, **short, container={"movflags": "faststart"})
    new = clips.write(folder / "new.mp4", [255 - grey for grey in GREYS])
    return late.read_bytes(), early.read_bytes(), new.read_bytes()


def replaced(data, new, **more):
    """The file with the frames of another, once it was audited; and what became of its parts."""
    out = io.BytesIO()
    source = io.BytesIO(data)
    assert can_take(Movie.read(source), 1)
    write_with_video(source, 1, io.BytesIO(new), out, **more)
    before = Movie.read(source)
    assert mp4_inventory.audit(before, Movie.read(out), before.track(1)) == []
    return out.getvalue(), list(mp4_inventory.parts(before, before.track(1)))


def streams(data):
    """The packets of each stream, as FFmpeg reads them."""
    found = {}
    with av.open(io.BytesIO(data)) as video:
        for packet in video.demux():
            if packet.size:
                found.setdefault(packet.stream.index, []).append((packet.pts, bytes(packet)))
    return found


def check(old, result, new):
    assert [each for _, each in streams(result)[0]] == [each for _, each in streams(new)[0]]
    assert streams(result)[1] == streams(old)[1]


def some_bytes(draw, most=400):
    return draw.randbytes(draw.randrange(1, most))


def decorated(data, draw):
    """A file with random boxes, gaps and a trailer; and these."""
    extras = []

    def extra(content):
        extras.append(content)
        return content

    places = chunk_places(data)
    gaps = {place: extra(some_bytes(draw)) for place in draw.sample(places, draw.randrange(1, len(places)))}
    data, _ = with_gaps(data, gaps)
    kinds = [b"free", b"skip", b"uuid", b"gps ", b"abcd", b"udta"]
    inner = box(draw.choice(kinds), extra(some_bytes(draw)))
    data = with_moov(data, lambda moov: moov + inner)
    out = b"".join(box(name, content) for name, _, content in boxes(data))
    for name in (b"moov", b"mdat"):
        behind = box(draw.choice(kinds[:-1]), extra(some_bytes(draw))) if draw.random() < 0.7 else b""
        out = with_box_behind(out, name, behind)
    if draw.random() < 0.5:
        out += extra(struct.pack(">I", draw.choice([3, 0x7FFFFFFF])) + some_bytes(draw))
    return out, extras


@pytest.mark.parametrize("seed", [0, 1, *(thorough(seed) for seed in range(2, 40))])
@pytest.mark.parametrize("is_early", [False, True])
def test_random_boxes_gaps_and_trailers_are_carried(films, seed, is_early):
    draw = random.Random(seed)
    data, extras = decorated(films[is_early], draw)
    assert streams(data) == streams(films[is_early])  # FFmpeg does not mind them
    result, parts = replaced(data, films[2])
    check(data, result, films[2])
    assert all(result.count(extra) == data.count(extra) for extra in extras if len(extra) > 4)
    assert left_out(parts) == []
    names = [name for name, _, _ in boxes(data)]
    assert [name for name, _, _ in boxes(result)][: len(names)] == names


@pytest.mark.parametrize("is_early", [False, True])
@pytest.mark.parametrize(
    ("name", "kind", "before"), [(b"gps ", ">I", 8), (b"gps ", "<I", 0), (b"loc ", ">Q", 4), (b"loc ", ">I", 0)]
)
def test_blocks_between_samples_are_found_where_their_table_says(films, is_early, name, kind, before):
    blocks = [box(b"free", b"GPS " + bytes([k]) * (40 + k)) for k in range(6)]
    data = films[is_early]
    table = box(name, bytes(before) + b"".join(struct.pack(f"{kind[0]}2{kind[1]}", 1, 1) for _ in blocks))
    data = with_moov(data, lambda moov: moov + table)
    data, places = with_gaps(data, dict(zip(chunk_places(data)[:: len(chunk_places(data)) // 6], blocks, strict=False)))
    rows = [(place, len(block)) for place, block in zip(places, blocks, strict=True)]
    listed = bytes(before) + b"".join(struct.pack(f"{kind[0]}2{kind[1]}", *row) for row in rows)
    data = with_moov(data, lambda moov: moov.replace(table, box(name, listed)))
    result, parts = replaced(data, films[2])
    check(data, result, films[2])
    found = content_of(result, b"moov", name)[before:]
    rows = struct.iter_unpack(f"{kind[0]}2{kind[1]}", found)
    assert [result[place : place + size] for place, size in rows] == blocks
    assert [part.fate for part in parts if name.decode() in part.name] == [Fate.TRANSFORMED]


def test_numbers_that_are_no_places_stay(films):
    odd = struct.pack(">8I", 5, 8, 1000, 20, 3000, 40, 7, 7)
    data, _ = with_gaps(
        with_moov(films[0], lambda moov: moov + box(b"odd ", odd)), {chunk_places(films[0])[2]: bytes(90)}
    )
    result, _ = replaced(data, films[2])
    assert content_of(result, b"moov", b"odd ") == odd


def test_what_signs_the_old_frames_is_left_out_and_named(films):
    result, parts = replaced(films[0] + CREDENTIALS + box(b"uuid", bytes(30)), films[2])
    assert CREDENTIALS[:24] not in result and box(b"uuid", bytes(30)) in result
    assert left_out(parts) == ["content credentials (they sign the old frames)"]


def test_an_open_box_at_the_end(films):
    """The last box may say that it goes on to the end of the file."""
    early = films[1]
    at = next(at for name, at, _ in boxes(early) if name == b"mdat")
    data = early[:at] + bytes(4) + early[at + 4 :]
    result, _ = replaced(data, films[2])
    check(data, result, films[2])


# ---- sample entries -------------------------------------------------------------------------------------------------

CLAP = box(b"clap", struct.pack(">IIIIiIiI", 180, 1, 120, 1, 2, 1, -4, 1))
VEXU = box(b"vexu", box(b"eyes", box(b"stri", bytes(4) + b"\3")))


@pytest.mark.parametrize("extra", [CLAP, VEXU, box(b"hfov", bytes([0, 0, 200, 0])), box(b"abcd", b"of a camera")])
def test_descriptions_of_the_film_are_carried(films, extra):
    data = with_entry_boxes(films[0], extra)
    result, parts = replaced(data, films[2])
    assert extra in result and not left_out(parts)
    check(data, result, films[2])


def test_the_clean_aperture_is_moved_with_a_part_of_the_frames(films, tmp_path):
    """It showed columns 8 to 188 and rows 8 to 128; of columns 16 to 176 and rows 12 to 132, these are all, and 116."""
    part = [grey[12:132, 16:176] for grey in GREYS]
    new = clips.write(tmp_path / "new.mp4", part).read_bytes()
    result, _ = replaced(with_entry_boxes(films[0], CLAP), new, corner=(16, 12))
    assert box(b"clap", struct.pack(">IIIIiIiI", 160, 1, 116, 1, 0, 1, -2, 1)) in result


def test_a_film_without_its_dolby_vision_is_not_called_so(tmp_path, capsys):
    quiet = {"x265-params": "log-level=none"}
    made = clips.write(tmp_path / "made.mp4", clips.moving(16)[1], "libx265", options=quiet, tag="hvc1")
    source = tmp_path / "in.mp4"
    source.write_bytes(with_entry_boxes(made.read_bytes(), box(b"dvcC", bytes(24))).replace(b"hvc1", b"dvh1"))
    log = tmp_path / "log.json"
    assert main(["video", str(source), "-o", str(tmp_path / "out.mp4"), *clips.KNOWN, "--json-log", str(log)]) == 0
    assert capsys.readouterr().err.count("Dolby Vision") == 1
    result = (tmp_path / "out.mp4").read_bytes()
    assert b"hvc1" in result and b"dvh1" not in result and b"dvcC" not in result
    (parts,) = [json.loads(line)["parts"] for line in log.read_text().splitlines() if "parts" in line]
    fates = {part["name"]: part["fate"] for part in parts}
    assert fates["Dolby Vision"] == "left out" and fates["box 'ftyp'"] == "carried"
    assert fates["track 1 ('vide', 'dvh1')"] == "replaced"


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (box(b"dvcC", bytes(24)), "Dolby Vision (it describes the old frames)"),
        (box(b"lhvC", bytes(24)) + VEXU, "the other eye's view (the encoder writes one view)"),
    ],
)
def test_what_describes_the_old_coding_is_named(films, extra, words):
    result, parts = replaced(with_entry_boxes(films[0], extra), films[2])
    assert left_out(parts) == [words]
    assert extra not in result and VEXU not in result


# ---- edit lists -----------------------------------------------------------------------------------------------------


def with_edits(data, edits):
    """The file whose film shows only some parts of itself: (length [file ticks], first time in the film or -1)."""
    content = struct.pack(">II", 0, len(edits)) + b"".join(struct.pack(">iii", *edit, 1 << 16) for edit in edits)
    listed = box(b"edts", box(b"elst", content))

    def change(path, content):
        if path[-1] != b"trak" or b"vide" not in content:
            return content
        rest = [(name, inner) for name, _, inner in boxes(content) if name != b"edts"]
        return b"".join(box(*each) + listed * (each[0] == b"tkhd") for each in rest)

    return with_moov(data, lambda moov: rebuilt(moov, change, (b"moov",)))


def shown(path):
    """When each frame is shown that is not hidden [s]."""
    return [round(frame.time, 3) for frame in read_clip_facts(str(path)).frames_between()]


@pytest.mark.parametrize("seed", [0, 1, *(thorough(seed) for seed in range(2, 12))])
def test_random_edit_lists_leave_frames_at_their_times(tmp_path, capsys, seed):
    draw = random.Random(seed)
    options = {"g": "5", "bf": str(seed % 3)}
    whole = clips.write(tmp_path / "whole.mp4", clips.moving(30)[1], options=options, sound=True)
    ticks = 15_360 // 30  # of a frame
    first = draw.randrange(0, 6)
    with whole.open("rb") as stream:
        second = Movie.read(stream).timescale  # which is FFmpeg's choice
    edits = [(draw.randrange(1, 900) * second // 1000, -1)] * draw.randrange(2)
    edits.append(((30 - first) * second // 30, first * ticks + 1024 * (seed % 3 > 0)))
    source = tmp_path / "in.mp4"
    source.write_bytes(with_edits(whole.read_bytes(), edits))
    assert main(["video", str(source), "-o", str(tmp_path / "out.mp4"), *clips.KNOWN]) == 0
    assert "not kept" not in capsys.readouterr().err
    assert source.read_bytes() != (tmp_path / "out.mp4").read_bytes()
    assert shown(tmp_path / "out.mp4") == pytest.approx(shown(source), abs=0.002)
    assert streams((tmp_path / "out.mp4").read_bytes())[1] == streams(source.read_bytes())[1]


def items(method, extents=1):
    """A box whose item of 8 bytes is at 100: in the file (method 0), or in its own data."""
    item = struct.pack(">HHHH", 1, method, 0, extents) + struct.pack(">II", 100, 8) * extents
    listed = box(b"iloc", bytes([1, 0, 0, 0, 0x44, 0]) + struct.pack(">H", 1) + item)
    return box(b"meta", bytes(4) + box(b"hdlr", bytes(8) + b"pict" + bytes(13)) + listed)


def test_lists_of_places_in_the_file_are_left_out_and_named(films):
    further = box(b"saiz", bytes(9)) + box(b"saio", struct.pack(">III", 0, 1, 100))
    tables = (b"trak", b"mdia", b"minf", b"stbl", b"stco")

    def of_sound(here, content):
        return content + further if here == tables[:-1] and b"mp4a" in content else content

    data = with_moov(films[0], lambda moov: rebuilt(moov, of_sound) + items(0) + items(1) + items(0, 0))
    result, parts = replaced(data + items(0) + items(1), films[2])
    assert left_out(parts) == [
        f"{name} (it lists places in the file, which move)"
        for name in ("table 'saiz' of track 2", "table 'saio' of track 2", "box moov/'meta'", "box 'meta'")
    ]
    assert b"saio" not in result and b"saiz" not in result
    assert result.count(items(0)) == 0 and result.count(items(1)) == 2 and result.count(items(0, 0)) == 1
    check(data, result, films[2])


def test_a_track_without_a_description_is_left_to_ffmpeg(films):
    data = films[0]
    at = data.rindex(b"stsd")
    assert can_take(Movie.read(io.BytesIO(data)), 1)
    assert not can_take(Movie.read(io.BytesIO(data[:at] + b"free" + data[at + 4 :])), 1)


def test_a_false_count_of_edits(films):
    edit = struct.pack(">Iiii", 1, 500, 0, 1 << 16)
    data = with_edits(films[0], [(500, 0)]).replace(edit, struct.pack(">I", 200) + edit[4:])
    result, parts = replaced(data, films[2])
    assert left_out(parts) == []
    check(data, result, films[2])


def test_the_speed_of_an_edit_is_named(films):
    edit = struct.pack(">iii", 500, 0, 1 << 16)
    data = with_edits(films[0], [(500, 0)]).replace(edit, struct.pack(">iii", 500, 0, 1 << 15))
    _, parts = replaced(data, films[2])
    assert left_out(parts) == ["speed of the film's edits (it plays as fast as it was recorded)"]
