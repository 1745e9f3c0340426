"""What becomes of strangers' files: any folders of pictures through ``unshutter rectify``, in one batch.

    python benchmarks/corpus.py FOLDER... [--jobs 2] [--estimator NAME] [--page docs/research/files.md]

Prints tables: outcomes by ending, reasons of refusals, metadata lost by kind (by exiftool, where it is installed), the
slowest files. All files are copied first, and stay where they are; results go into a temporary folder. Not part of the
tests: what lies in the folders is not part of the repository.

Metadata are compared by name and value (numbers to six digits) between a file and its result, as exiftool reads both;
left out is what must follow new pixels (sizes, thumbnails, places in the file; that a still picture is an animation of
one frame).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

BEGIN, END = "<!-- measured: python benchmarks/corpus.py -->\n", "<!-- end -->"
SLOW_S = 10
KINDS = ("EXIF", "MakerNotes", "XMP", "IPTC", "Photoshop", "ICC_Profile", "JFIF", "PNG", "MPF")
# what follows the new pixels, the new file, or the format that it is written in
STRUCTURE = re.compile(
    r"(Thumbnail|Preview|Strip|Tile|Jpg|JpgFromRaw|OtherImage|.*Offsets?$|.*Image(Width|Height|Size|Length)$|"
    r"PixelXDim|PixelYDim|BitsPer|BitDepth|Compression|Photometric|SamplesPer|RowsPer|Planar|Predictor|SubfileType|"
    r"YCbCr|ExtraSamples|SampleFormat|ColorType|Filter|Interlace|Palette|Transparency|FillOrder|T4Options|T6Options|"
    r"Free|JPEG|Animation|Padding|ExifByteOrder|XMPToolkit|IPTCDigest|CurrentIPTCDigest)"
)
OUTCOMES = ("done", "refused", "given up", "worker died", "unexpected")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--estimator", default="segment-manhattan")
    parser.add_argument("--timeout", type=float, default=60, help="seconds for each file")
    parser.add_argument("--page", type=Path, help="page to write the tables into, between its marks")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="corpus-") as place:
        top = Path(place)
        for number, folder in enumerate(given.folders):
            shutil.copytree(folder, top / "in" / f"{number}-{folder.name}", copy_function=_copied)
        events, strays = run_batch(top, given.jobs, given.estimator, given.timeout)
        report = "\n".join([about(given.folders), *outcomes(events, strays), *slow(events), *lost(events, top)]) + "\n"
    print(report)
    if given.page:
        text = given.page.read_text(encoding="utf-8")
        before, _, rest = text.partition(BEGIN)
        after = rest.partition(END)[2]
        given.page.write_text(f"{before}{BEGIN}\n{report}\n{END}{after}", encoding="utf-8")


def _copied(source: str, target: str) -> None:
    """Copies what is a file; pipes and devices stay behind."""
    if os.path.isfile(source):
        shutil.copyfile(source, target)


def run_batch(top: Path, jobs: int, estimator: str, timeout_s: float) -> tuple[list[dict[str, Any]], list[str]]:
    """What happened to each photo, from the batch's log; lines on standard error that no photo accounts for."""
    command = [sys.executable, "-m", "unshutter", "rectify", str(top / "in"), "-o", str(top / "out")]
    command += ["--jobs", str(jobs), "--estimator", estimator, "--timeout", str(timeout_s)]
    command += ["--json-log", str(top / "log.jsonl")]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    events = [json.loads(line) for line in (top / "log.jsonl").read_text(encoding="utf-8").splitlines()]
    events = [event for event in events if event["event"] in ("done", "failed")]
    for event in events:
        event["outcome"] = _outcome(event)
        event["name"] = Path(event["photo"]).relative_to(top / "in").as_posix()
    strays = [line for line in done.stderr.splitlines() if " -> " not in line and not line.startswith("unshutter: ")]
    return events, strays


def _outcome(event: dict[str, Any]) -> str:
    error = event.get("error", "")
    if not error:
        return "done"
    marks = {"given up after": "given up", "its worker died": "worker died", "please report": "unexpected"}
    return next((outcome for mark, outcome in marks.items() if mark in error), "refused")


# ---- tables ----------------------------------------------------------------------------------------------------


def about(folders: list[Path]) -> str:
    root = Path(__file__).parent.parent
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=root, capture_output=True, text=True, check=False
    ).stdout.strip()
    names = ", ".join(f"`{folder.name}`" for folder in folders)
    return f"Folders {names}; commit {commit}; {os.cpu_count()} processors ({platform.machine()}).\n"


def outcomes(events: list[dict[str, Any]], strays: list[str]) -> list[str]:
    by_ending: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for event in events:
        by_ending[Path(event["name"]).suffix.lower()][event["outcome"]] += 1
    rows = [(ending, *(str(count[o] or "–") for o in OUTCOMES)) for ending, count in sorted(by_ending.items())]
    total = Counter(event["outcome"] for event in events)
    rows.append(("all", *(str(total[o] or "–") for o in OUTCOMES)))
    reasons = Counter(_reason(event) for event in events if event["outcome"] != "done")
    lines = table(("files", *OUTCOMES), rows)
    lines += table(("why not", "files"), [(reason, str(count)) for reason, count in reasons.most_common()])
    noise = f": {'; '.join(sorted(set(strays))[:3])}" if strays else ""
    return [*lines, f"Lines on standard error beside one for each file: {len(strays)}{noise}.\n"]


def _reason(event: dict[str, Any]) -> str:
    """The message without what is this file's own."""
    error = event["error"].replace(event["photo"], "").strip(" :")
    return re.sub(r"[\d.,]*\d", "N", error).replace("|", "/")[:110]


def slow(events: list[dict[str, Any]]) -> list[str]:
    timed = sorted(((event.get("seconds", 0.0), event["name"]) for event in events), reverse=True)
    count = sum(seconds > SLOW_S for seconds, _ in timed)
    middle = timed[len(timed) // 2][0] if timed else 0
    rows = [(f"`{name}`", f"{seconds:.1f}") for seconds, name in timed[:5]]
    return [*table(("slowest", "s"), rows), f"Median {middle:.2f} s; over {SLOW_S} s: {count} files.\n"]


def lost(events: list[dict[str, Any]], top: Path) -> list[str]:
    """Of what each kind of metadata holds, how much is not in the result, where exiftool is installed."""
    if shutil.which("exiftool") is None:
        return ["exiftool is not installed: metadata not compared.\n"]
    tags = _tags(top / "in") | _tags(top / "out")
    having, losing, names = Counter[str](), Counter[str](), defaultdict[str, Counter[str]](Counter)
    for event in events:
        if event["outcome"] != "done":
            continue
        before, after = (tags.get(os.path.realpath(event[end]), {}) for end in ("photo", "target"))
        for kind in KINDS:
            own = {tag: value for (group, tag), value in before.items() if group == kind}
            gone = [tag for tag, value in own.items() if not _same(value, after.get((kind, tag)))]
            having[kind] += bool(own)
            losing[kind] += bool(gone)
            names[kind].update(gone)
    rows = []
    for kind in KINDS:
        most = ", ".join(f"{tag} ({count})" for tag, count in names[kind].most_common(4))
        rows.append((kind, str(having[kind]), str(losing[kind] or "–"), most or "–"))
    return table(("metadata", "files that have them", "lose or change some", "most often"), rows)


def _same(before: str, after: str | None) -> bool:
    """Whether two values are the same; of ratios some formats keep six digits."""
    if after is None or before == after:
        return before == after
    try:
        return math.isclose(float(before), float(after), rel_tol=1e-6)
    except ValueError:
        return False


def _tags(folder: Path) -> dict[str, dict[tuple[str, str], str]]:
    """File -> (kind, name) -> value, as exiftool reads all files below a folder."""
    command = ["exiftool", "-json", "-G0", "-n", "-all", "-r", str(folder)]
    text = subprocess.run(command, capture_output=True, check=False).stdout
    read: dict[str, dict[tuple[str, str], str]] = {}
    for found in json.loads(text or "[]"):
        pairs = ((*name.partition(":")[::2], value) for name, value in found.items() if ":" in name)
        tags = {(kind, tag): str(value) for kind, tag, value in pairs if not STRUCTURE.match(tag)}
        read[os.path.realpath(found["SourceFile"])] = tags
    return read


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """Markdown."""
    lines = [head, ("---",) * len(head), *rows]
    return ["| " + " | ".join(line) + " |" for line in lines] + [""]


if __name__ == "__main__":
    main()
