"""Single pictures with a known motion: the estimators' input, the truth, and the scores of their answers."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from unshutter.motion import Motion
from unshutter.photo import Photo
from unshutter.single.estimator import View
from unshutter_lab.evaluation.case import (
    Case,
    Example,
    Loaded,
    Record,
    ask,
    compared,
    in_8_bits,
    picture_scores,
    rectified,
)
from unshutter_lab.evaluation.metrics import MotionError, epe_of_nothing, motion_error


@dataclass(frozen=True)
class Exam:
    """A synthesised picture."""

    view: View  # the estimators' input
    gs: np.ndarray  # the global-shutter picture, uint8 [H, W, 3]
    truth: Motion  # the true motion, or that of rows which comes nearest
    moved: np.ndarray | None = None  # [2, H, W] how far pixels move (columns, rows), where there is parallax

    @property
    def photo(self) -> Photo:
        """The rolling-shutter picture."""
        return self.view.photo

    def error(self, motion: Motion) -> MotionError:
        """Returns the distance of an answer from the truth."""
        return motion_error(motion, self.truth, moved=self.moved)

    def epe_of_nothing(self) -> float:
        """Returns the EPE [px at 256 rows] of the unchanged picture."""
        return epe_of_nothing(self.truth, self.moved)


class ExamCase(Case):
    """A picture with a known motion."""

    @abstractmethod
    def exam(self) -> Exam:
        """Returns the picture, synthesised again at every call."""

    @property
    @abstractmethod
    def title(self) -> str:
        """Names the picture."""

    @property
    def compares_pictures(self) -> bool:
        """Whether PSNR and SSIM are computed."""
        return True

    def view(self) -> View:
        """See :class:`Case`."""
        return self.exam().view

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns one record per estimator."""
        exam = self.exam()
        nothing = exam.epe_of_nothing()
        oracle = rectified(exam.photo, exam.truth) if self.compares_pictures else None
        records = []
        for name in names:
            answer = ask(loaded(name), exam.view)
            error = vars(exam.error(answer.motion))
            best = min([nothing, error["epe"], *(exam.error(each).epe for each in answer.others)])
            record = {**self.place, "estimator": name, **error, "epe_nothing": nothing, "epe_best": best}
            record |= answer.figures()
            if oracle:
                picture, mask = rectified(exam.photo, answer.motion)
                pictures = {"": picture, "input": in_8_bits(exam.photo), "oracle": oracle[0]}
                record |= picture_scores(pictures, exam.gs, mask & oracle[1])
            records.append(record)
        return records

    def show(self, names: list[str], loaded: Loaded) -> Example:
        """Returns the pictures and curves behind the records."""
        exam = self.exam()
        curves = {name: ask(loaded(name), exam.view).motion for name in names}
        errors = {name: exam.error(motion).epe for name, motion in curves.items()}
        errors["input"] = exam.epe_of_nothing()
        pictures = [(f"{name} {errors[name]:.1f} px", picture) for name, picture in compared(exam.photo, curves)]
        return Example(self.title, [*pictures, ("truth", exam.gs)], {"truth": exam.truth, **curves})
