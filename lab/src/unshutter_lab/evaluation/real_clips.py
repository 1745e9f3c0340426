"""Compares real clips before and after stabilising programs: their wobble, their sharpness, and what got worse.

Nobody knows what a global shutter would have seen, so clips are measured before and after as in ``clip_wobble.py``. The
programs are ``unshutter video`` without options, and FFmpeg's stabilisers.
"""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from shutil import which

from unshutter.errors import UnshutterError
from unshutter.frames.pyav import VIDEO_FORMATS
from unshutter.reasons import JsonObject
from unshutter_lab.evaluation.case import NOTHING, Case, Example, Loaded, Record
from unshutter_lab.evaluation.clip_wobble import ClipWobble

SECONDS = 5.0  # of each clip
OURS = "unshutter"
_FILTERS = {"deshake": "deshake", "vid.stab": "vidstabtransform=smoothing=15:input={}"}
METHODS = (NOTHING, OURS, *_FILTERS)
_NEEDED = {"deshake": "deshake", "vid.stab": "vidstabdetect"}  # filters of FFmpeg
_LIST = "clips.csv"  # in the folder, if someone wrote it: clip, note, source
_STEPS = ("rms", "usual", "largest")
# a clip got worse if its root mean square or largest step grew by more than these factors, and by more px than these
_WORSE, _WORSE_ONCE, _WORSE_PX = 1.05, 1.1, 0.05


def check_programs(names: list[str]) -> None:
    """Checks that the programs with these names can be run.

    Raises:
        UnshutterError: FFmpeg is missing, or was built without a filter.
    """
    others = [name for name in names if name in _NEEDED]
    if not others:
        return
    instead = f"or leave out {' and '.join(others)}: --estimators {NOTHING},{OURS}"
    if which("ffmpeg") is None:
        raise UnshutterError(f"{others[0]} needs FFmpeg's program ffmpeg: install it, {instead}")
    listed = subprocess.run(["ffmpeg", "-hide_banner", "-filters"], capture_output=True, text=True).stdout.split()
    for name in others:
        if _NEEDED[name] not in listed:
            raise UnshutterError(f"this FFmpeg has no filter {_NEEDED[name]}: install one that has it, {instead}")


def clips_in(folder: Path) -> list[Path]:
    """Returns the clips of a folder, sorted.

    Raises:
        UnshutterError: there is no such folder, or no clip in it.
    """
    if not folder.is_dir():
        raise UnshutterError(f"there is no folder {folder}" if not folder.exists() else f"{folder} is not a folder")
    clips = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in VIDEO_FORMATS and path.is_file()]
    if not clips:
        raise UnshutterError(f"no clips in folder {folder} (looked for .mp4, .mov, .avi and other videos)")
    return clips


@dataclass(frozen=True)
class RealClipCase(Case):
    """The first seconds of a clip."""

    group: str  # name of its folder in the tables
    path: Path  # its file

    @property
    def key(self) -> str:
        """Group and file."""
        return f"{self.group}|{self.path.name}"

    @property
    def place(self) -> Record:
        """Group and file."""
        return {"suite": f"first {SECONDS:g} s", "group": self.group, "photo": self.path.stem, "draw": 0}

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns one record per program."""
        before = self._before
        about = self.place | self._listed()
        records = []
        with tempfile.TemporaryDirectory() as folder:
            for name in names:
                after, said = self._result(name, Path(folder))
                records.append({**about, "estimator": name, **_figures(before, after), **said})
        return records

    def show(self, names: list[str], loaded: Loaded) -> Example | None:
        """Returns None: a picture does not show a wobble."""
        return None

    @cached_property
    def _before(self) -> ClipWobble:
        return ClipWobble.of(self.path, SECONDS)

    def _result(self, name: str, folder: Path) -> tuple[ClipWobble, Record]:
        """Returns what is measured after a program, and what our own one says."""
        if name == NOTHING:
            return self._before, {}
        if name == OURS:
            output = folder / f"{name}{self.path.suffix}"
            said = straighten(self.path, output, "--end", str(SECONDS))
            return ClipWobble.of(output, SECONDS), outcome_of(said)
        output = folder / f"{name}.mp4"
        _stabilise(self.path, output, name)
        return ClipWobble.of(output, SECONDS), {}

    def _listed(self) -> Record:
        """Returns what the folder's list says about the clip."""
        path = self.path.parent / _LIST
        if not path.is_file():
            return {}
        with path.open(encoding="utf-8", newline="") as lines:
            listed = {row.get("clip"): row for row in csv.DictReader(lines)}
        row = listed.get(self.path.name, {})
        return {key: row.get(key) or "" for key in ("note", "source")}


def straighten(clip: Path, output: Path, *words: str) -> JsonObject:
    """Runs ``unshutter video`` as users do; returns its record in the JSON log.

    Raises:
        UnshutterError: it failed.
    """
    log = output.with_suffix(".jsonl")
    log.unlink(missing_ok=True)
    command = [sys.executable, "-m", "unshutter", "video", str(clip), "-o", str(output), "--json-log", str(log)]
    done = subprocess.run([*command, "--overwrite", *words], capture_output=True, text=True)
    if done.returncode:
        raise UnshutterError(f"{clip}: unshutter video failed: {' '.join(done.stderr.split())}")
    return json.loads(log.read_text(encoding="utf-8").splitlines()[-1])


def _stabilise(clip: Path, output: Path, name: str) -> None:
    """Writes what one of FFmpeg's stabilisers makes of a clip."""
    transforms = output.with_suffix(".trf")
    begin = ["ffmpeg", "-v", "error", "-y", "-t", str(SECONDS), "-i", str(clip)]
    commands = [[*begin, "-vf", _FILTERS[name].format(transforms), "-crf", "18", str(output)]]
    if name == "vid.stab":
        commands.insert(0, [*begin, "-vf", f"vidstabdetect=result={transforms}", "-f", "null", "-"])
    for command in commands:
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise UnshutterError(f"{clip}: FFmpeg's {name} failed: {' '.join(done.stderr.split())}")


def _figures(before: ClipWobble, after: ClipWobble) -> Record:
    """Returns the figures of a clip before and after a program."""
    shown = before.regression
    is_worse = after.rms > max(_WORSE * before.rms, before.rms + _WORSE_PX)
    is_worse |= after.largest > max(_WORSE_ONCE * before.largest, before.largest + _WORSE_PX)
    return {
        **{key: getattr(after, key) for key in _STEPS},
        **{f"{key}_input": getattr(before, key) for key in _STEPS},
        "sharpness": after.sharpness / before.sharpness if before.sharpness else None,
        "worse": float(is_worse),
        "pairs": 0 if shown is None else shown.pairs,
        "ratio": None if shown is None else shown.rows.ratio,
        "ratio_t": None if shown is None else shown.t,
        "explained": before.explained,
    }


def outcome_of(said: JsonObject) -> Record:
    """Returns the figures of a record of ``unshutter video``."""
    is_found = said["found_by"] != "usual value"
    spread = said.get("readout_ratio_sd")
    left = said["left"]
    return {
        "frames": said["frames"],
        "straightened": said["rectified"] / max(said["frames"], 1),
        "readout_ms": said["readout_ms"] if is_found else None,
        "readout_error_ms": spread / said["readout_ratio"] * said["readout_ms"] if is_found and spread else None,
        "found_by": said["found_by"] if is_found else "",
        "left": max(left, key=left.__getitem__, default=""),
    }
