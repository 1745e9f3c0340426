"""Pictures with known synthetic motion: how each suite creates them, and how estimates are scored.

The motions of a photo depend only on the seed and the photo's own bytes, as in ``unshutter synthesize``.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from unshutter.estimators.base import Estimator, View
from unshutter.motion import Motion, RowMotion
from unshutter.options import MOST_ROLL_DEG, MOST_TILT_DEG, Camera
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
from unshutter_lab.evaluation.cases.disturbances import DISTURBANCES
from unshutter_lab.evaluation.cases.true_attitude import true_attitude
from unshutter_lab.evaluation.metrics import UNIT_ROWS, motion_error
from unshutter_lab.synthesis.pairs import synthesize, synthesize_native
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.row_motions import DrawnMotion, draw_from_trajectory, draw_quadratic

_CANVAS = 356 / 256  # ratio of canvas rows to kept rows, as in the predecessor's generator
_READOUT_S = 0.03  # of drawn motions with an exposure: typical of phones
_FOCAL = 1.0  # of recorded motions: focal length in picture sides (53 degrees across)


@dataclass(frozen=True)
class Suite:
    """The specification of a suite's pictures.

    Attributes:
        name: as in the tables.
        rows: side of the pictures [px]; None for the photo's own size.
        readout_s: readout time for recorded motions [s]; None for drawn quadratics.
        still: no motion at all.
        disturbance: one of DISTURBANCES, applied to the rolling-shutter picture.
        turned: counter-clockwise quarter turns of the scene before the motion is applied.
        orientation: EXIF orientation of the picture.
        of_pictures: whether PSNR and SSIM are computed.
        exposure_s: exposure time of each row [s], which blurs it by the motion; estimators are given the exposure and a
            readout of 30 ms; None for sharp rows, with neither given.
        attitude_deg: largest error of the attitude given to estimators, uniform [degrees]; None if not given.
    """

    name: str
    rows: int | None = 256
    readout_s: float | None = None
    still: bool = False
    disturbance: str = ""
    turned: int = 0
    orientation: int = 1
    of_pictures: bool = True
    exposure_s: float | None = None
    attitude_deg: float | None = None


@dataclass(frozen=True)
class Exam:
    """A synthesised picture.

    Attributes:
        view: the estimators' input.
        gs: the global-shutter picture, uint8 [H, W, 3].
        truth: the true motion.
    """

    view: View
    gs: np.ndarray
    truth: Motion

    @property
    def photo(self) -> Photo:
        """The rolling-shutter picture."""
        return self.view.photo

    def ask(self, estimator: Estimator) -> Answer:
        """Returns an estimator's answer."""
        return ask(estimator, self.view)


@dataclass(frozen=True)
class SyntheticCase(Case):
    """One picture with known motion.

    Attributes:
        suite: the picture's specification.
        group: name of the photo's folder in the tables.
        photo: name of the photo in that folder.
        path: path of the photo.
        draw: number of the motion, among those of the photo.
        seed: seed of the run.
        logs: recorded camera motions, for suites with a readout time.
    """

    suite: Suite
    group: str
    photo: str
    path: Path
    draw: int
    seed: int
    logs: tuple[Path, ...] = ()

    @property
    def key(self) -> str:
        """Suite, group, photo and number of the motion."""
        return f"{self.suite.name}|{self.group}|{self.photo}|{self.draw}"

    @property
    def oracles(self) -> tuple[str, ...]:
        """No oracles: each record contains the scores of the true motion."""
        return ()

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns one record per estimator."""
        exam = self.exam()
        nothing = motion_error(RowMotion.zero(exam.truth.height, exam.truth.width), exam.truth)
        oracle = rectified(exam.photo, exam.truth) if self._of_pictures else None
        records = []
        for name in names:
            answer = exam.ask(loaded(name))
            record: Record = {"suite": self.suite.name, "group": self.group, "photo": self.photo, "draw": self.draw}
            error = motion_error(answer.motion, exam.truth)
            record |= {"estimator": name, **vars(error), "epe_nothing": nothing.epe, **answer.figures()}
            if oracle:
                record |= self._picture_scores(exam, answer, oracle)
            records.append(record)
        return records

    def show(self, names: list[str], loaded: Loaded) -> Example:
        """Returns the pictures and curves behind the records."""
        exam = self.exam()
        curves = {name: exam.ask(loaded(name)).motion for name in names}
        errors = {name: motion_error(motion, exam.truth).epe for name, motion in curves.items()}
        nothing = motion_error(RowMotion.zero(exam.truth.height, exam.truth.width), exam.truth).epe
        pictures = [(f"input {nothing:.1f} px", in_8_bits(exam.photo))]
        for name in names:
            if name != NOTHING:
                pictures.append((f"{name} {errors[name]:.1f} px", rectified(exam.photo, curves[name])[0]))
        pictures.append(("truth", exam.gs))
        title = f"{self.group} {Path(self.photo).stem[-12:]}, {self.suite.name}, motion {self.draw + 1}"
        return Example(title, pictures, {"truth": exam.truth, **curves})

    @property
    def _of_pictures(self) -> bool:
        return self.suite.of_pictures and not self.suite.still

    @staticmethod
    def _picture_scores(exam: Exam, answer: Answer, oracle: tuple[np.ndarray, np.ndarray]) -> Record:
        picture, mask = rectified(exam.photo, answer.motion)
        pictures = {"": picture, "input": in_8_bits(exam.photo), "oracle": oracle[0]}
        return picture_scores(pictures, exam.gs, mask & oracle[1])

    def exam(self) -> Exam:
        """Returns the picture, synthesised again at every call."""
        pixels, digest, focal, known = _photo(self.path)
        shown_px = round(min(pixels.shape[:2]) / _CANVAS)  # px of the photo across the picture
        pixels = np.ascontiguousarray(np.rot90(pixels, self.suite.turned))
        sequence = np.random.SeedSequence([self.seed, digest], spawn_key=(self.draw,))
        rng = np.random.default_rng(sequence)
        drawn, exposure_s = self._drawn(rng), self.suite.exposure_s
        readout_s = self.suite.readout_s or _READOUT_S
        exposure = (exposure_s or 0.0) / readout_s
        if self.suite.rows is None:
            rs, gs, truth = synthesize_native(pixels, drawn, exposure)
        else:
            (rs, gs), truth = synthesize(pixels, drawn, exposure), drawn.crop
        if self.suite.still:
            rs, truth = gs, RowMotion.zero(*gs.shape[:2])
        if self.suite.disturbance:
            rs = DISTURBANCES[self.suite.disturbance](rs, rng)
        photo = replace(Photo.from_array(rs, exposure_s), orientation=self.suite.orientation)
        focal *= len(gs) / shown_px
        roll, tilt = self._attitude()
        readout_ms = None if exposure_s is None else 1000 * readout_s
        camera = Camera(focal_px=focal if known else None, roll_deg=roll, tilt_deg=tilt, readout_ms=readout_ms)
        return Exam(View(photo, camera, None if known else focal), gs, truth)

    def _attitude(self) -> tuple[float | None, float | None]:
        """Returns the attitude of the camera as given to estimators [degrees]."""
        most_off = self.suite.attitude_deg
        attitude = None if most_off is None else _true_attitude(self.path)
        if attitude is None or most_off is None:
            return None, None
        # separate random numbers, so that the motions equal those of the other suites
        sequence = np.random.SeedSequence([self.seed, _photo(self.path)[1]], spawn_key=(self.draw, 1))
        error = np.random.default_rng(sequence).uniform(-most_off, most_off, 2)
        limits = MOST_ROLL_DEG, MOST_TILT_DEG
        roll, tilt = (float(np.clip(a + e, -m, m)) for a, e, m in zip(attitude, error, limits, strict=True))
        return roll, tilt

    def _drawn(self, rng: np.random.Generator) -> DrawnMotion:
        rows = self.suite.rows or UNIT_ROWS
        canvas = rows + 2 * round((_CANVAS - 1) * rows / 2)
        if self.suite.readout_s is None:
            return draw_quadratic(rng, rows, canvas)
        log = _log(self.logs[int(rng.integers(len(self.logs)))])
        return draw_from_trajectory(rng, log, self.suite.readout_s, _FOCAL * rows, rows, canvas)


def _photo(path: Path) -> tuple[np.ndarray, int, float, bool]:
    """Returns uint8 [H, W, 3] of a photo, digest of its file, focal length [px], and whether EXIF gives it.

    Estimators are given the focal length that they would assume for the whole photo (EXIF's, or else the usual guess
    from its size), because a crop from the centre does not reveal it.
    """
    photo = Photo.open(path)
    pixels = in_8_bits(photo)
    digest = int(hashlib.sha256(path.read_bytes()).hexdigest(), 16)
    view = View(photo)
    return np.broadcast_to(pixels, (*pixels.shape[:2], 3)), digest, view.focal_px(), view.known_focal_px() is not None


@lru_cache(maxsize=16)
def _true_attitude(path: Path) -> tuple[float, float] | None:
    """Returns roll and tilt of a photo's camera [degrees], or None if they cannot be determined."""
    return true_attitude(View(Photo.open(path)))


@lru_cache(maxsize=16)
def _log(path: Path) -> RotationLog:
    return RotationLog.load(path)
