"""Each hint in a message is followed once: doing what it says changes the answer.

Commands run in an empty folder with small files. ``NOT_FOLLOWED`` lists hints that need what a test machine lacks, and
those that other tests follow.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from support import clips
from support.sure_estimator import Sure
from support.tagged_files import png_with_chunks
from unshutter.cli import main
from unshutter.motion import RowMotion
from unshutter.photo import Photo

ROOT = Path(__file__).parents[2]
DRY = "rectify a.png --dry-run"
NO_CLIP = "video none.mp4 -o out.mp4"  # once the options are right, it says that there is no such clip

# words of a command | hint in its message | words that follow it
HINTS = [
    # the command line
    ("rectfy a.png", "did you mean rectify?", DRY),
    ("--strength 1 a.png", "options come after the command", f"{DRY} --strength 1"),
    (f"{DRY} --strenght 1", "did you mean --strength?", f"{DRY} --strength 1"),
    (f"{DRY} --frobnicate", "leave it out", DRY),
    (f"{DRY} --edges krop", "did you mean crop?", f"{DRY} --edges crop"),
    (f"{DRY} --preview -", "leave it out", DRY),
    (f"{DRY} -o -", "leave out -", DRY),
    ("rectify hdr.png --motion m.json -o x.jpg", "save it as AVIF or PNG", "rectify hdr.png --motion m.json -o x.avif"),
    ("rectify a.png b.png -o -", "need --output FOLDER", f"{DRY} b.png -o folder"),
    (f"{DRY} --estimator manhatan", "did you mean manhattan?", f"{DRY} --estimator manhattan"),
    (
        f"{DRY} --estimator xyz",
        "choose one of segment-transformer, segment-manhattan",
        f"{DRY} --estimator segment-manhattan",
    ),
    (f"{DRY} --estimator manhattan@w", "leave out @w", f"{DRY} --estimator manhattan"),
    (
        "rectify clip.mkv --dry-run",
        "use unshutter video clip.mkv",
        "video clip.mkv -o out.mkv --readout-ms 20 --end 0.2",
    ),
    ("video a.png", "unshutter rectify a.png", DRY),
    ("estimate http://x/a.png", "is a URL: give a file", "estimate a.png"),
    # photos: options that exclude or need one another
    (f"{DRY} --motion m.json --roll-deg 3", "leave them out", f"{DRY} --motion m.json"),
    (f"{DRY} --motion m.json --min-confidence 0.5", "leave out --min-confidence", f"{DRY} --motion m.json"),
    (f"{DRY} --motion m.json --upright full", "leave it out", f"{DRY} --motion m.json"),
    (f"{DRY} --before b.png --readout-ratio 0.5 --fps 30", "not both", f"{DRY} --before b.png --readout-ratio 0.5"),
    (f"{DRY} --before b.png --readout-ms 20", "give both", f"{DRY} --before b.png --readout-ms 20 --fps 30"),
    (f"{DRY} --before b.png --at 0.5 --model camera", "leave out --model camera", f"{DRY} --before b.png --at 0.5"),
    (f"{DRY} --before b.png --at 0.5 --strength 0.5", "leave out --strength", f"{DRY} --before b.png --at 0.5"),
    (
        f"{DRY} --before b.png --model dense --strength 0.5",
        "leave out --strength",
        f"{DRY} --before b.png --model dense",
    ),
    (f"{DRY} --before b.png --motion m.json", "leave out --motion", f"{DRY} --before b.png"),
    (f"{DRY} --before b.png --roll-deg 1", "leave them out", f"{DRY} --before b.png"),
    (f"{DRY} --before b.png --upright level", "leave it out", f"{DRY} --before b.png"),
    (f"{DRY} --before b.png --at 0.5 --reference last", "choose one", f"{DRY} --before b.png --at 0.5"),
    (f"{DRY} --before b.png --scheduler tcp://x:1", "leave out --scheduler", f"{DRY} --before b.png"),
    (f"{DRY} --before b.png b.png --sequence", "leave out --before", f"{DRY} b.png --sequence"),
    (f"{DRY} --at 0.5", "name one with --before or --after", f"{DRY} --at 0.5 --after b.png"),
    (f"{DRY} --edges borrow", "name one with --before or --after", f"{DRY} --edges borrow --after b.png"),
    (f"{DRY} --sequence", "name them in order", f"{DRY} b.png --sequence"),
    (f"{DRY} --timeout 9 --scheduler tcp://x:1", "leave it out", f"{DRY} --scheduler tcp://x:1"),
    (f"{DRY} --jobs 2 --scheduler tcp://x:1", "choose one", f"{DRY} --jobs 2"),
    (f"{DRY} --masks masks --edges crop", "leave out --edges crop", f"{DRY} --masks masks"),
    (
        f"{DRY} --before b.png --save-motion s.json --model dense",
        "leave out --model dense",
        f"{DRY} --before b.png --save-motion s.json",
    ),
    (f"{DRY} --keep-names", "needs --output FOLDER", f"{DRY} b.png --keep-names -o folder"),
    (f"{DRY} --manifest folder", "leave it out", DRY),
    (f"{DRY} --format png -o x.jpg", "already sets the format", f"{DRY} -o x.jpg"),
    (f"{DRY} --save-motion s.txt", "a .json file, not s.txt: choose another name", f"{DRY} --save-motion s.json"),
    # photos: their files
    ("rectify a.png -o x.xyz", "use one of these extensions", "rectify a.png -o x.png"),
    (f"{DRY} b.png -o x.jpg", "leave out .jpg", f"{DRY} b.png -o x"),
    (f"{DRY} -o a.png", "choose another name", f"{DRY} -o x.png"),
    (f"{DRY} -o there.png", "use --overwrite to replace it", f"{DRY} -o there.png --overwrite"),
    (
        "rectify a.png -o x.png --json-log there.png",
        "choose another name",
        "rectify a.png -o x.png --json-log log.jsonl",
    ),
    ("estimate a.png b.png --json", "leave out --json", "estimate a.png b.png"),
    ("estimate a.png --candidates --plot p.png", "leave out --plot", "estimate a.png --candidates"),
    ("estimate a.png --candidates --lines l.json", "leave out --candidates", "estimate a.png --candidates"),
    (
        "map a.png -o x.npz --size big",
        "write it like 1920x1080",
        "map a.png -o x.npz --size 1920x1440 --estimator none",
    ),
    ("serve --host 0.0.0.0", "add --i-know", "serve --host 0.0.0.0 --i-know --port 99999"),
    ("serve --token short", "needs at least 8 characters", "serve --token long-enough-1 --port 99999"),
    # clips: options that exclude or need one another
    (f"{NO_CLIP} --readout-ms 9 --readout-ratio 0.5", "not both", f"{NO_CLIP} --readout-ms 9"),
    (f"{NO_CLIP} --readout-ms 9 --camera x", "one of them", f"{NO_CLIP} --readout-ms 9"),
    (f"{NO_CLIP} --lens a.png --focal-px 900", "leave out --focal-px", f"{NO_CLIP} --lens a.png"),
    (f"{NO_CLIP} --edges borrow", "needs --model dense", f"{NO_CLIP} --edges borrow --model dense"),
    (f"{NO_CLIP} --edges crop --model dense", "choose --edges borrow", f"{NO_CLIP} --edges fill --model dense"),
    (f"{NO_CLIP} --level", "needs --stabilize", f"{NO_CLIP} --level --stabilize"),
    (f"{NO_CLIP} --zoom-limit 9", "needs --stabilize", f"{NO_CLIP} --zoom-limit 9 --stabilize"),
    (f"{NO_CLIP} --motion m.json --readout-ms 9", "leave out --readout-ms", f"{NO_CLIP} --motion m.json"),
    (f"{NO_CLIP} --motion m.json --model dense", "use --model camera", f"{NO_CLIP} --motion m.json --model camera"),
    (
        f"{NO_CLIP} --motion m.json --level --stabilize",
        "leave out --motion",
        f"{NO_CLIP} --level --stabilize",
    ),
    (f"{NO_CLIP} --level --stabilize --gyro off", "leave out --gyro off", f"{NO_CLIP} --level --stabilize"),
    (f"{NO_CLIP} --straight-lines --stabilize", "stabilise the straightened clip", f"{NO_CLIP} --straight-lines"),
    (f"{NO_CLIP} --save-gyro s.csv", "a .gcsv file, not s.csv: choose another name", f"{NO_CLIP} --save-gyro s.gcsv"),
    # clips: what they are and become
    ("video clip.mkv -o out.png", "write video.mkv", "video clip.mkv -o video.mkv --readout-ms 20 --end 0.2"),
    ("video clip.mkv -o out.xyz", "use .mp4, .mov or .mkv", "video clip.mkv -o out.mkv --readout-ms 20 --end 0.2"),
    (
        "video clip.mkv -o out.mkv --camera Aple-iPhone-12",
        "did you mean Apple iPhone 12",
        "video clip.mkv -o out.mkv --camera Apple-iPhone-12",
    ),
    (
        "video clip.mkv -o out.mkv --camera Apple-iPhone-12",
        "give --readout-ms",
        "video clip.mkv -o out.mkv --readout-ms 20 --end 0.2",
    ),
    (
        "video clip.mkv -o out.mkv --codec nonsense --readout-ms 20 --end 0.2",
        "such as libx264",
        "video clip.mkv -o out.mkv --codec libx264 --readout-ms 20 --end 0.2",
    ),
    (
        "video clip.mkv -o out.mkv --codec aac --readout-ms 20 --end 0.2",
        "choose libx264",
        "video clip.mkv -o out.mkv --codec libx264 --readout-ms 20 --end 0.2",
    ),
    (
        "video clip.mkv -o out.mkv --preset fast --readout-ms 20 --end 0.2",
        "leave out --preset",
        "video clip.mkv -o out.mkv --readout-ms 20 --end 0.2",
    ),
    (
        "video clip.mkv -o out.mkv --codec libx264 --preset fastest --readout-ms 20 --end 0.2",
        "choose one of ultrafast",
        "video clip.mkv -o out.mkv --codec libx264 --preset ultrafast --readout-ms 20 --end 0.2",
    ),
    (
        "video clip.mkv -o out.mkv --crf 20 --readout-ms 20 --end 0.2",
        "leave it out",
        "video clip.mkv -o out.mkv --readout-ms 20 --end 0.2",
    ),
    (
        "video clip.mp4 -o out.mp4 --start 9 --readout-ms 20",
        "must come before that",
        "video clip.mp4 -o out.mp4 --start 0.2 --readout-ms 20",
    ),
    (
        "video clip.mkv -o there.mkv --readout-ms 20 --end 0.2",
        "use --overwrite",
        "video clip.mkv -o there.mkv --readout-ms 20 --end 0.2 --overwrite",
    ),
    (
        "video clip.mkv -o out.mkv --max-pixels 9 --readout-ms 20 --end 0.2",
        "see --max-pixels",
        "video clip.mkv -o out.mkv --max-pixels 99999 --readout-ms 20 --end 0.2",
    ),
    (
        "video clip.mkv -o out.mkv --level --stabilize",
        "name one with --gyro",
        "video clip.mkv -o out.mkv --level --stabilize --gyro none.gcsv",
    ),
]

# Beginning or part of a message -> why its hint is not in the table in these words
NOT_FOLLOWED = {
    "standard input": "tests/cli/test_pipes.py",
    "cannot be shown in a terminal": "needs a terminal: tests/cli/test_pipes.py",
    # followed there, but with values in the middle
    "is a video, not a photo: use unshutter video": "in the table",
    "a folder, but  is the name of a file: leave out": "in the table",
    "accepts no other weights: leave out @": "in the table",
    "--at and --edges borrow are for --model dense": "in the table",
    # for words that the command line does not pass on
    "unknown reference row": "from Python only",
    "--edges does not take": "from Python only",
    "--model does not take": "from Python only",
    "candidates() lists all motions: leave out candidate": "from Python only",
    "unknown kind of line": "from Python and the page, which send lines themselves",
    "page/": "for programs that send requests: tests/page",
    # files and programs that are not here
    "holds no COLMAP model": "a model: tests/poses/test_pose_files.py",
    "is missing: name the folder of the pictures": "a model: tests/poses/test_ncore.py",
    "has no number in": "a model: tests/poses/test_row_poses.py",
    "motion files of pictures do not say when": "a model: tests/poses/test_row_poses.py",
    "is an input of this run: choose another folder": "a folder of results that a link leads to: tests/storage",
    "cropping would leave": "a motion that leaves little: tests/motion/test_edges.py",
    "the frames have too little in common": "frames of two scenes: tests/frames/test_neighbours.py",
    "cannot read motions of kind": "a package that is not installed",
    "convert it": "another program converts the photo",
    "contains an old-style JPEG": "another program converts the photo",
    "is too large for": "a picture with a side of more than 16,383 px",
    "cannot process the pixel format": "another program converts the clip",
    "could be : give the full name": "a camera with several lenses: tests/video/calibrate/test_cameras.py",
    "name one with --lens": "the clip of a wide lens: tests/video/calibrate/test_lenses.py",
    "is from an earlier version and lacks the turns": "a file of an earlier version",
    "is damaged: use the intact part": "a clip that is damaged in its middle",
}
_ADVICE = re.compile(r": (use|choose|give|leave|name|try|add|convert|install|draw|save|write|did you mean)\b")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two photos, a motion, a clip and a few other files."""
    folder = tmp_path_factory.mktemp("hints")
    pixels = np.full((90, 120, 3), 90, np.uint8)
    for name in ("a.png", "b.png", "there.png", "there.mkv"):
        Photo.from_array(pixels).save(folder / f"{name}.png")
        (folder / f"{name}.png").rename(folder / name)
    hdr = png_with_chunks((folder / "a.png").read_bytes(), (b"cICP", bytes([9, 16, 0, 1])))
    (folder / "hdr.png").write_bytes(hdr)
    RowMotion.zero(90, 120).save(folder / "m.json")
    (folder / "folder").mkdir()
    frames = clips.moving(16)[1]
    clips.write(folder / "clip.mkv", frames, "ffv1")
    clips.write(folder / "clip.mp4", frames)
    return folder


def _answer(words: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    code = main([word.replace("-iPhone-", " iPhone ") for word in words.split()])
    return code, capsys.readouterr().err


@pytest.mark.parametrize(("words", "hint", "followed"), HINTS)
def test_following_a_hint_changes_the_answer(
    words: str,
    hint: str,
    followed: str,
    files: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(files)
    before = sorted(files.iterdir())
    code, told = _answer(words, capsys)
    assert (code and hint in told and told.count("\n") == 1) or ("dry-run" in words and hint in told), told
    assert sorted(files.iterdir()) == before
    again, told_again = _answer(followed, capsys)
    for each in set(files.iterdir()) - set(before):  # as it was, for the next
        each.unlink() if each.is_file() else None
    for each in (files / "folder").iterdir():
        each.unlink()
    needs_more = followed.startswith((NO_CLIP, "serve")) or "none.gcsv" in followed or "tcp://" in followed
    assert hint not in told_again and told_again != told
    assert again == 0 or needs_more or "give --readout-ms" in told_again, told_again


def test_the_confidence_that_is_named_changes_a_photo(photo: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("unshutter.run.ahead.load", lambda name: Sure(0.36))
    assert main(["rectify", str(photo)]) == 0
    advice = re.search(r"(--min-confidence [\d.]+) would move it", capsys.readouterr().err)
    assert advice is not None
    assert main(["rectify", str(photo), *advice[1].split()]) == 0
    assert "unchanged" not in (told := capsys.readouterr().err) and "up to" in told


def _unfollowed() -> Iterator[str]:
    """Yields the hints in the texts of errors that no row of the table follows."""
    followed = {hint for _, hint, _ in HINTS}
    for file in sorted((ROOT / "src" / "unshutter").rglob("*.py")):
        for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            name = getattr(call.func, "id", getattr(call.func, "attr", "")) if isinstance(call, ast.Call) else ""
            if not name.endswith("Error"):
                continue
            parts = [each.value for each in ast.walk(call) if isinstance(each, ast.Constant)]
            said = re.sub(r"\{(--[a-z-]+)\}", r"\1", "".join(map(str, parts)))
            if _ADVICE.search(said) and not any(hint in said for hint in followed):
                yield f"{file.relative_to(ROOT / 'src' / 'unshutter').as_posix()}: {said}"


def test_every_hint_is_followed_or_has_a_reason() -> None:
    unfollowed = list(_unfollowed())
    missing = [hint for hint in unfollowed if not any(start in hint for start in NOT_FOLLOWED)]
    assert not missing
    assert all(any(start in hint for hint in unfollowed) for start in NOT_FOLLOWED)
