"""Pairs of a rolling-shutter frame and a global-shutter picture taken at the time of its first or middle row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.estimators.base import View
from unshutter.options import Reference
from unshutter.photo import Photo
from unshutter_lab.evaluation.cases.case import (
    NOTHING,
    Answer,
    Case,
    Example,
    Loaded,
    Record,
    ask,
    in_8_bits,
    picture_scores,
    rectified,
)
from unshutter_lab.evaluation.cases.ceiling import fit_to_pair
from unshutter_lab.evaluation.cases.folders import Frame
from unshutter_lab.evaluation.cases.sequence import FRAMES, PUBLISHED, by_neighbours, neighbours_of, published_of
from unshutter_lab.evaluation.metrics import psnr

CEILING = "ceiling"


@dataclass(frozen=True)
class PairCase(Case):
    """One rolling-shutter frame, judged at every reference row with a global-shutter picture.

    Attributes:
        group: name of the data set in the tables.
        frame: its files.
        readout_ratio: readout time / frame interval of the camera; None if unknown, which excludes neighbouring frames.
    """

    group: str
    frame: Frame
    readout_ratio: float | None = None

    @property
    def key(self) -> str:
        """Group, sequence and file of the frame."""
        return f"{self.group}|{self.frame.sequence}|{self.frame.rs.name}"

    @property
    def oracles(self) -> tuple[str, ...]:
        """The motion fitted to both pictures, and the results of using the frame's neighbours."""
        has_neighbours = self.readout_ratio is not None and any(neighbours_of(self.frame))
        return (*FRAMES, CEILING) if has_neighbours else (CEILING,)

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns one record per name and reference row."""
        photo = Photo.open(self.frame.rs)
        truths = {reference: self._truth(reference, photo) for reference in self.frame.gs}
        records = []
        for name in names:
            if name in FRAMES:
                records += [self._record_of_neighbours(name, photo, reference, gs) for reference, gs in truths.items()]
                continue
            answer = None if name == CEILING else ask(loaded(name), View(photo))
            records += [self._record(name, answer, photo, reference, gs) for reference, gs in truths.items()]
        return records

    def show(self, names: list[str], loaded: Loaded) -> Example:
        """Returns the pictures at the last reference row."""
        photo = Photo.open(self.frame.rs)
        reference = cast(Reference, list(self.frame.gs)[-1])
        truth = self._truth(reference, photo)
        motions = {name: ask(loaded(name), View(photo)).motion.rereferenced(reference) for name in names}
        motions[CEILING] = fit_to_pair(in_8_bits(photo), truth, reference)
        pictures = [("input", in_8_bits(photo))]
        pictures += [(name, rectified(photo, motion)[0]) for name, motion in motions.items() if name != NOTHING]
        by_frames = [name for name in self.oracles if name in FRAMES]
        pictures += [(name, self._by_neighbours(name, reference)[0]) for name in by_frames]
        title = f"{self.group} {self.frame.sequence} {self.frame.number}, {reference} row"
        return Example(title, [*pictures, ("truth", truth)], motions)

    def _record(self, name: str, answer: Answer | None, photo: Photo, reference: str, gs: np.ndarray) -> Record:
        row = cast(Reference, reference)
        rs = in_8_bits(photo)
        motion = answer.motion.rereferenced(row) if answer else fit_to_pair(rs, gs, row)
        picture, mask = rectified(photo, motion)
        figures = (answer or Answer(motion.rereferenced("first"))).figures()
        return self._scored(name, reference, figures, {"": picture, "input": rs}, gs, mask)

    def _by_neighbours(self, name: str, reference: Reference) -> tuple[np.ndarray, np.ndarray, Record]:
        return by_neighbours(self.frame, self.readout_ratio or 1, reference, FRAMES[name])

    def _record_of_neighbours(self, name: str, photo: Photo, reference: str, gs: np.ndarray) -> Record:
        picture, mask, figures = self._by_neighbours(name, cast(Reference, reference))
        pictures = {"": picture, "input": in_8_bits(photo)}
        figures |= {
            f"{PUBLISHED}{name}": psnr(picture, gs, mask)
            for name, picture in published_of(self.frame, reference).items()
            if picture.shape == gs.shape
        }
        return self._scored(name, reference, figures, pictures, gs, mask)

    def _scored(
        self,
        name: str,
        reference: str,
        figures: Record,
        pictures: dict[str, np.ndarray],
        gs: np.ndarray,
        mask: np.ndarray,
    ) -> Record:
        record: Record = {"suite": f"{reference} row", "group": self.group, "photo": self.frame.sequence}
        record |= {"draw": self.frame.number, "estimator": name}
        return record | figures | picture_scores(pictures, gs, mask)

    def _truth(self, reference: str, photo: Photo) -> np.ndarray:
        gs, rs = in_8_bits(Photo.open(self.frame.gs[reference])), in_8_bits(photo)
        if gs.shape != rs.shape:
            raise UnshutterError(
                f"{self.frame.gs[reference]} and {photo.path} differ in size or channels: they are not a pair"
            )
        return gs
