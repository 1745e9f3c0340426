"""``-`` for standard input and output: bytes as files have them, whole or not at all, and messages elsewhere."""

import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from support import clips
from support.camera_files import heic
from unshutter.cli import main, pipes
from unshutter.photo import Photo

Answer = tuple[int, bytes, str]  # exit code, standard output, standard error
PROGRAM = [sys.executable, "-m", "unshutter"]


@pytest.fixture
def piped(capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch):
    """Runs a command with bytes on standard input, in this process; files go to the current folder."""

    def run(data: bytes, *words: object) -> Answer:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
        capfdbinary.readouterr()
        code = main([str(word) for word in words])
        told = capfdbinary.readouterr()
        return code, told.out, told.err.decode()

    return run


@pytest.fixture
def still(tmp_path: Path) -> Path:
    path = tmp_path / "still photo.png"
    Photo.from_array(np.full((90, 120, 3), 90, np.uint8)).save(path)
    return path


def test_a_photo_goes_through_as_it_goes_through_files(photo: Path, piped) -> None:
    data = photo.read_bytes()
    result = photo.with_name("straight.jpg")
    assert main(["rectify", str(photo), "-o", str(result)]) == 0
    expected = result.read_bytes()
    for words in (["rectify", "-"], ["rectify", "-", "-o", "-"], ["rectify", photo, "-o", "-"]):
        code, out, told = piped(data, *words)
        assert (code, out) == (0, expected)
        start = "standard input" if "-" in words[:2] else str(photo)
        assert told.startswith(f"{start} -> standard output (points moved by up to ") and told.count("\n") == 1
    assert piped(data, "rectify", "-", "-o", photo.with_name("other.jpg"))[1] == b""
    assert photo.with_name("other.jpg").read_bytes() == expected
    assert photo.read_bytes() == data


def test_the_format_is_kept_or_asked_for(photo: Path, piped) -> None:
    assert piped(photo.read_bytes(), "rectify", "-", "--format", "png")[1].startswith(b"\x89PNG")
    Photo.open(photo).save(photo.with_name("a.tif"))
    assert piped(photo.with_name("a.tif").read_bytes(), "rectify", "-")[1].startswith(b"II*\0")
    video = piped(heic(Photo.open(photo).to_array()), "rectify", "-")[1]  # cannot be written
    assert video[8:12] == b"avif"


def test_an_unchanged_photo_comes_out_byte_for_byte(still: Path, piped) -> None:
    for words in (["-"], [still, "-o", "-"]):
        code, out, told = piped(still.read_bytes(), "rectify", *words)
        assert (code, out) == (0, still.read_bytes())
        assert told.startswith(("standard input left unchanged (", f"{still} left unchanged ("))
    assert piped(still.read_bytes(), "rectify", "-", "--only-changed")[:2] == (0, b"")


@pytest.mark.parametrize(
    ("data", "words", "complaint"),
    [
        (b"", "rectify -", "standard input is empty (0 bytes)"),
        (b"hello", "rectify -", "standard input is not a JPEG, PNG, WebP, TIFF, AVIF, HEIC or raw picture"),
        (b"hello", "estimate -", "standard input is not a JPEG, PNG, WebP, TIFF, AVIF, HEIC or raw picture"),
        (b"", "rectify - b.jpg", "leave out the others"),
        (b"", "rectify a.jpg b.jpg -o -", "several photos need --output FOLDER: - is for one"),
        (b"\0\0\0\x18ftypmp42" + bytes(99), "rectify -", "standard input is a video, not a photo: use unshutter video"),
        (b"", "video -", "cannot read standard input: no video that can be read"),
        (b"hello", "video -", "cannot read standard input: no video that can be read"),
        (b"", "rectify a.jpg --save-motion -", "'-' is not accepted here"),
    ],
)
def test_bad_input_gets_one_line_and_no_output(data: bytes, words: str, complaint: str, piped) -> None:
    code, out, told = piped(data, *words.split())
    assert code in (1, 2) and out == b""
    assert complaint in told and told.count("\n") == 1 and "unshutter-" not in told


def test_a_damaged_photo_gives_nothing(photo: Path, piped) -> None:
    code, out, told = piped(photo.read_bytes()[:3000], "rectify", "-")
    assert (code, out) == (1, b"")
    assert told == "unshutter: standard input is damaged or incomplete: it ends too early\n"
    code, out, told = piped(photo.read_bytes(), "video", "-")
    assert (code, out) == (2, b"") and "standard input is a photo, not a clip: unshutter rectify -" in told


def test_input_without_an_end_is_refused(photo: Path, piped, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipes, "_CHUNK", 4096)
    monkeypatch.setattr(pipes, "_LARGEST_PHOTO", 20_000)
    endless = Path("/dev/zero")
    if endless.exists():
        with endless.open("rb") as zeros:
            done = subprocess.run([*PROGRAM, "rectify", "-"], stdin=zeros, capture_output=True, timeout=60, check=False)
        assert done.returncode == 1 and b"is not a JPEG" in done.stderr
    code, out, told = piped(photo.read_bytes() + bytes(20_000), "rectify", "-")
    assert (code, out) == (
        1,
        b"",
    ) and told == "unshutter: standard input is larger than 4 GB: write it to a file first\n"


def test_a_terminal_is_not_for_pictures(photo: Path, piped, monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.TextIOWrapper):
        def isatty(self) -> bool:
            return True

    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdin", Terminal(io.BytesIO()))
        assert main(["rectify", "-", "-o", "x.jpg"]) == 2
    screen = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", Terminal(screen))
    for words in (["rectify", "-"], ["rectify", photo, "-o", "-"], ["video", "-"]):
        code, _, told = piped(photo.read_bytes(), *words)
        assert code == 2 and told.endswith("cannot be shown in a terminal: give --output FILE, or add > FILE\n")
    assert screen.getvalue() == b""


def test_a_reader_that_closes_early_gets_no_traceback(tmp_path: Path) -> None:
    big = tmp_path / "big.png"
    noise = np.random.default_rng(1).integers(0, 9, (1200, 1600, 3), np.uint8)  # more than a pipe holds
    Photo.from_array(noise).save(big)
    process = subprocess.Popen([*PROGRAM, "rectify", str(big), "-o", "-"], stdout=-1, stderr=-1)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.read(10)
    process.stdout.close()
    told = process.stderr.read().decode()
    process.stderr.close()
    assert process.wait() == 1
    assert told.startswith(f"{big} left unchanged") and "Traceback" not in told


def test_the_original_behind_standard_input_is_never_overwritten(photo: Path) -> None:
    before = photo.read_bytes()
    for words in (["-o", photo], ["-o", photo.with_name("b.jpg"), "--preview", photo]):
        with photo.open("rb") as stream:
            command = [*PROGRAM, "rectify", "-", *map(str, words), "--overwrite"]
            done = subprocess.run(command, stdin=stream, capture_output=True, text=True, check=False)
        assert done.returncode == 1 and "an original" in done.stderr and done.stderr.count("\n") == 1
    with photo.open("ab") as stream:
        command = [*PROGRAM, "rectify", str(photo), "-o", "-"]
        done = subprocess.run(command, stdout=stream, stderr=-1, text=True, check=False)
    assert done.returncode == 1 and "which is never overwritten" in done.stderr
    assert photo.read_bytes() == before


def test_logs_call_it_standard_input(photo: Path, piped, tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    assert piped(photo.read_bytes(), "rectify", "-", "--json-log", log)[0] == 0
    done = json.loads(log.read_text().splitlines()[0])
    assert (done["photo"], done["target"]) == ("standard input", "standard output")


def test_estimate_reads_it_too(photo: Path, piped) -> None:
    code, out, told = piped(photo.read_bytes(), "estimate", "-")
    assert code == 0 and out.startswith(b"standard input: ") and told == ""
    _, direct, _ = piped(b"", "estimate", photo, "--json")
    for words in (["--json"], ["-o", "-"]):
        code, out, told = piped(photo.read_bytes(), "estimate", "-", *words)
        assert (code, out) == (0, direct) and told.startswith("standard input: ")
    code, out, told = piped(photo.read_bytes(), "estimate", "-", "-o", photo.with_name("m.json"))
    assert (code, out) == (0, b"") and told.startswith(f"standard input -> {photo.with_name('m.json')}: ")
    assert photo.with_name("m.json").read_bytes() == direct


def test_a_clip_goes_through_as_matroska(tmp_path: Path, piped) -> None:
    clip = clips.write(tmp_path / "a.mp4", clips.moving(12)[1])
    words = (*clips.KNOWN, "--codec", "ffv1")  # lossless, so that two runs give the same bytes
    assert main(["video", str(clip), "-o", str(tmp_path / "a.mkv"), *words]) == 0
    expected = (tmp_path / "a.mkv").read_bytes()
    for start in (["-"], ["-", "-o", "-"], [clip, "-o", "-"]):
        code, out, told = piped(clip.read_bytes(), "video", *start, *words)
        assert (code, out) == (0, expected)
        assert f"{start[0] if start[0] is clip else 'standard input'} -> standard output: 12 of 12 frames" in told
    assert piped(clip.read_bytes(), "video", "-", "-o", tmp_path / "b.mkv", *words)[1] == b""
    assert (tmp_path / "b.mkv").read_bytes() == expected


def test_an_unchanged_clip_comes_out_byte_for_byte(tmp_path: Path, piped) -> None:
    clip = clips.write(tmp_path / "still.mp4", [clips.moving(1)[1][0]] * 12)
    for words in (["-"], [clip, "-o", "-"]):
        code, out, told = piped(clip.read_bytes(), "video", *words)
        assert (code, out) == (0, clip.read_bytes()) and "-> standard output: 0 of 12 frames straightened" in told
    assert piped(clip.read_bytes(), "video", "-", "--only-changed")[:2] == (0, b"")
