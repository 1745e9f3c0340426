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
from unshutter_lab.evaluation.metrics import epe_of_nothing, motion_error


@dataclass(frozen=True)
class Exam:
    """A synthesised picture."""

    view: View  # the estimators' input
    gs: np.ndarray  # the global-shutter picture, uint8 [H, W, 3]
    truth: Motion  # the true motion

    @property
    def photo(self) -> Photo:
        """The rolling-shutter picture."""
        return self.view.photo


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
        nothing = epe_of_nothing(exam.truth)
        oracle = rectified(exam.photo, exam.truth) if self.compares_pictures else None
        records = []
        for name in names:
            answer = ask(loaded(name), exam.view)
            error = vars(motion_error(answer.motion, exam.truth))
            best = min([nothing, error["epe"], *(motion_error(each, exam.truth).epe for each in answer.others)])
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
        errors = {name: motion_error(motion, exam.truth).epe for name, motion in curves.items()}
        errors["input"] = epe_of_nothing(exam.truth)
        pictures = [(f"{name} {errors[name]:.1f} px", picture) for name, picture in compared(exam.photo, curves)]
        return Example(self.title, [*pictures, ("truth", exam.gs)], {"truth": exam.truth, **curves})
