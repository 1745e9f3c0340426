"""Evaluates the answers of other programs: a folder of motion files, one for each picture.

``unshutter evaluate --pictures-only`` writes the pictures, so that any program can answer them, in any language.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from unshutter.errors import UnshutterError, UsageError
from unshutter.motion.finding import Finding
from unshutter.progress import Progress
from unshutter.reasons import MotionSource
from unshutter.single import Method
from unshutter.single.estimator import Estimator, View
from unshutter.storage.files import written_whole
from unshutter_lab.evaluation.case import Case

PREFIX = "answers:"  # of the names of such methods in tables, before that of the folder
LIST = "pictures.json"


class FolderAnswers(Estimator):
    """Answers with the motion file that has the picture's name; declines where there is none."""

    def __init__(self, folder: Path):
        super().__init__(Method(f"{PREFIX}{folder}", "a folder of motion files", ""))
        self.folder = folder

    def __reduce__(self) -> tuple:
        return type(self), (self.folder,)

    def estimate(self, view: View) -> Finding:
        """See :class:`Estimator`."""
        if view.photo.path is None:
            return view.no_motion(self.name, "this protocol's pictures have no names")
        file = self.folder / f"{view.photo.path.stem}.json"
        if not file.is_file():
            return view.no_motion(self.name, f"there is no {file.name}")
        found = Finding.load(file).resized(view.height, view.width).rereferenced("first")
        return replace(found, estimator=self.name, source=MotionSource.PIXELS)


def answers_in(folders: Iterable[Path], cases: Iterable[Case]) -> list[str]:
    """Returns the names of the methods whose answers are in these folders, each of which must have some."""
    names = {case.file.stem for case in cases}
    for folder in folders:
        if not folder.is_dir():
            raise UnshutterError(f"there is no folder {folder}")
        if not any(path.stem in names for path in folder.glob("*.json")):
            example = min(names, default="PICTURE")
            raise UnshutterError(f"no answers in {folder}: motion files are named like the pictures: {example}.json")
    return [f"{PREFIX}{folder}" for folder in folders]


def write_pictures(cases: list[Case], folder: Path) -> int:
    """Writes what methods that see one photo are shown, as PNG, and a list of it; returns the number of pictures."""
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"{folder} is not empty: pictures go into a new folder")
    folder.mkdir(parents=True, exist_ok=True)
    known = {}
    with Progress(len(cases), "pictures") as bar:
        for case in cases:
            view = case.view()
            view.photo.save(folder / case.file)
            known[case.file.name] = {"focal_px": view.known_focal_px(), "case": case.place}
            bar.advance()
    with written_whole(folder / LIST) as part:
        part.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
    return len(known)
