"""Synthesises pictures with known motion for each suite.

The motions of a photo depend only on the seed and the photo's own bytes, as in ``unshutter synthesize``.
"""

from __future__ import annotations

import hashlib
import zlib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from unshutter.motion import RowMotion
from unshutter.options import MOST_ROLL_DEG, MOST_TILT_DEG, Camera
from unshutter.photo import Photo
from unshutter.single.estimator import View
from unshutter_lab.evaluation.case import Disturbance, Record, disturbed, in_8_bits, true_attitude
from unshutter_lab.evaluation.exam import Exam, ExamCase
from unshutter_lab.evaluation.metrics import UNIT_ROWS
from unshutter_lab.synthesis.pairs import synthesize, synthesize_native
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.row_motions import DrawnMotion, draw_from_trajectory, draw_quadratic

_CANVAS = 356 / 256  # ratio of canvas rows to kept rows, as in the predecessor's generator
_READOUT_S = 0.03  # of drawn motions with an exposure: typical of phones
_LONGEST_SIDE = 900  # of a crop [px]
_FOCAL = 1.0  # of recorded motions: focal length in picture sides (53 degrees across)


@dataclass(frozen=True)
class Suite:
    """The specification of a suite's pictures."""

    name: str  # as in the tables
    rows: int | None = 256  # side of the pictures [px]; None for the photo's own size
    readout_s: float | None = None  # readout time for recorded motions [s]; None for drawn quadratics
    still: bool = False  # no motion at all
    disturbance: Disturbance | None = None  # of the rolling-shutter picture
    turned: int = 0  # counter-clockwise quarter turns of the scene before the motion is applied
    orientation: int = 1  # EXIF orientation of the picture
    cropped: bool = False  # of a crop of the photo, off its centre and askew (:func:`crop_of`)
    of_pictures: bool = True  # whether PSNR and SSIM are computed
    # exposure time of each row [s], which blurs it by the motion; estimators are given the exposure and a readout of
    # 30 ms; None for sharp rows, with neither given
    exposure_s: float | None = None
    # largest error of the attitude given to estimators, uniform [degrees]; None if not given
    attitude_deg: float | None = None


@dataclass(frozen=True)
class SyntheticCase(ExamCase):
    """One picture with known motion."""

    suite: Suite  # the picture's specification
    group: str  # name of the photo's folder in the tables
    photo: str  # name of the photo in that folder
    path: Path  # path of the photo
    draw: int  # number of the motion, among those of the photo
    seed: int  # seed of the run
    logs: tuple[Path, ...] = ()  # recorded camera motions, for suites with a readout time

    @property
    def key(self) -> str:
        """Suite, group, photo and number of the motion."""
        return f"{self.suite.name}|{self.group}|{self.photo}|{self.draw}"

    @property
    def place(self) -> Record:
        """Suite, group, photo and number of the motion."""
        return {"suite": self.suite.name, "group": self.group, "photo": self.photo, "draw": self.draw}

    @property
    def title(self) -> str:
        """Photo, suite and motion."""
        return f"{self.group} {Path(self.photo).stem[-12:]}, {self.suite.name}, motion {self.draw + 1}"

    @property
    def compares_pictures(self) -> bool:
        """Whether the suite does."""
        return self.suite.of_pictures and not self.suite.still

    def exam(self) -> Exam:
        """Returns the picture, synthesised again at every call."""
        pixels, digest, focal, known = _photo(self.path, self.seed if self.suite.cropped else None)
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
            rs = disturbed(rs, self.suite.disturbance, rng)
        photo = replace(Photo.from_array(rs, exposure_s), orientation=self.suite.orientation, path=self.file)
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


def _photo(path: Path, crop: int | None = None) -> tuple[np.ndarray, int, float, bool]:
    """Returns uint8 [H, W, 3] of a photo or one of its crops, its digest, focal length [px], and whether EXIF gives it.

    Estimators are given the focal length that they would assume for the whole photo (EXIF's, or else the usual guess
    from its size), because a crop from the centre does not reveal it.
    """
    photo = Photo.open(path)
    photo = photo if crop is None else crop_of(photo, path.name, crop)
    pixels = in_8_bits(photo)
    digest = int(hashlib.sha256(path.read_bytes()).hexdigest(), 16)
    view = View(photo)
    return np.broadcast_to(pixels, (*pixels.shape[:2], 3)), digest, view.focal_px(), view.known_focal_px() is not None


def crop_of(photo: Photo, name: str, number: int) -> Photo:
    """Returns a crop of a photo as another camera might have seen it, held slightly askew."""
    rows, columns = photo.height, photo.width
    pixels = np.broadcast_to(in_8_bits(photo), (rows, columns, 3))
    rng = np.random.default_rng([zlib.crc32(name.encode()), number])
    share, roll_deg = rng.uniform(0.55, 0.85), rng.normal(0, 3)
    height, width = int(rows * share), int(columns * share)
    scale = min(1, _LONGEST_SIDE / max(height, width))
    right, down = rng.uniform(-0.3, 0.3, 2)
    middle = (columns / 2 + right * (columns - width), rows / 2 + down * (rows - height))
    size = (int(width * scale), int(height * scale))
    matrix = cv2.getRotationMatrix2D(middle, roll_deg, scale)
    matrix[:, 2] += np.array(size) / 2 - middle
    small = cv2.GaussianBlur(pixels, (0, 0), 0.5 / scale) if scale < 1 else pixels
    crop = cv2.warpAffine(small, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    crop = crop[:, ::-1] if rng.random() < 0.5 else crop
    return replace(Photo.from_array(np.ascontiguousarray(crop)), orientation=photo.orientation)


@lru_cache(maxsize=16)
def _true_attitude(path: Path) -> tuple[float, float] | None:
    """Returns roll and tilt of a photo's camera [degrees], or None if they cannot be determined."""
    return true_attitude(View(Photo.open(path)))


@lru_cache(maxsize=16)
def _log(path: Path) -> RotationLog:
    return RotationLog.load(path)
