"""The benchmark that needs no data set: photos, pairs of frames and clips of places, with exactly known motion.

Everything about a picture follows from the seed, the name of the place and the number of the draw: the camera is the
same in all suites, and so is the shake of the hand, for the length of the readout.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from unshutter.motion import RowMotion
from unshutter.options import Camera as Stated
from unshutter.photo import Photo
from unshutter.readout_time import ReadoutRatio
from unshutter.single.estimator import View
from unshutter_lab.evaluation.case import Case, Record
from unshutter_lab.evaluation.clip_cases import RATIO_KNOWN, RotatingClip
from unshutter_lab.evaluation.exam import Exam, ExamCase
from unshutter_lab.synthesis.handheld import draw_camera, draw_hand, draw_pan
from unshutter_lab.synthesis.panorama import Camera, Place
from unshutter_lab.synthesis.place_photos import Moving, Quadratic, Rotating, take_photo, with_noise
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera
from unshutter_lab.synthesis.streets import Passing, draw_street, nearest_motion

_SIZE = (300, 400)  # rows and columns of a photo [px], about as fine as the places are
_UPRIGHT = 4  # the second of every four photos is taller than wide
_FOCAL_STATED = 2  # every second photo states its focal length
_NOISE, _QUALITY = 2.0, 90  # standard deviation [levels of 255], and quality of the JPEG
_LONGEST_S = 0.3  # of a drawn hand: all readouts, and the exposures around them
_CAMERA, _MOTION, _GRAIN, _STREET = range(4)  # streams of random numbers
_FINER = 2  # times the size at which streets are rendered

_WALK, _RIDE = (0.5, 1.1), (3.0, 8.0)  # units of synthesis/streets.py per second: on foot, and in a car or tram

Kind = Literal["still", "hand", "pan", "quadratic", "walk", "ride"]


@dataclass(frozen=True)
class PlaceSuite:
    """The specification of a suite's pictures."""

    name: str  # as in the tables
    kind: Kind
    readout_s: float = 0.0  # of all but still cameras and quadratics
    exposure_s: float = 0.0  # of every row; estimators are not given it
    frames: int = 1  # 2 for pairs, more for clips
    readout_ratio: float = 0.6  # of pairs and clips: readout time / frame interval


@dataclass(frozen=True)
class _Drawn:
    """The common part of all cases of places."""

    suite: PlaceSuite
    group: str  # name of the folder of places in the tables
    path: Path  # folder of the place
    draw: int  # number of the photo, among those of the place
    seed: int  # seed of the run

    @property
    def key(self) -> str:
        """Suite, group, place and number of the photo."""
        return f"{self.suite.name}|{self.group}|{self.path.name}|{self.draw}"

    @property
    def place(self) -> Record:
        """Suite, group, place and number of the photo."""
        return {"suite": self.suite.name, "group": self.group, "photo": self.path.name, "draw": self.draw}

    @property
    def title(self) -> str:
        """Place, suite and number of the photo."""
        return f"{self.path.name}, {self.suite.name}, photo {self.draw + 1}"

    def camera(self) -> Camera:
        """Returns the camera at the moment of the first row."""
        upright = self.draw % _UPRIGHT == 1
        return draw_camera(self.dice(_CAMERA), *(_SIZE[::-1] if upright else _SIZE))

    def log(self, seconds: float) -> RotationLog:
        """Returns the drawn rotation of the camera."""
        draw = draw_pan if self.suite.kind == "pan" else draw_hand
        return draw(self.dice(_MOTION), seconds)

    def dice(self, stream: int) -> np.random.Generator:
        """Returns one of the photo's own streams of random numbers."""
        number = zlib.crc32(self.path.name.encode())
        return np.random.default_rng(np.random.SeedSequence([self.seed, number], spawn_key=(self.draw, stream)))


@dataclass(frozen=True)
class PlaceCase(_Drawn, ExamCase):
    """One photo of a place."""

    def exam(self) -> Exam:
        """See :class:`ExamCase`."""
        camera, place = self.camera(), _place(self.path)
        moving = self._moving(camera)
        readout_s = self.suite.readout_s or 1.0
        exposed = self.suite.exposure_s / readout_s * camera.height
        rs = with_noise(take_photo(place, camera, moving, exposed), _NOISE, self.dice(_GRAIN))
        truth = RowMotion.zero(camera.height, camera.width) if moving is None else moving.motion()
        photo = Photo.from_bytes(Photo.from_array(rs).to_bytes("jpeg", _QUALITY))
        focal = camera.focal_px if self.draw % _FOCAL_STATED == 0 else None
        return Exam(View(replace(photo, path=self.file), Stated(focal_px=focal)), place.seen(camera), truth)

    def _moving(self, camera: Camera) -> Moving | None:
        if self.suite.kind == "still":
            return None
        if self.suite.kind == "quadratic":
            return Quadratic.drawn(self.dice(_MOTION), camera)
        return Rotating(camera, self.log(_LONGEST_S), self.suite.readout_s)


@dataclass(frozen=True)
class StreetCase(_Drawn, ExamCase):
    """One photo of drawn houses before a place, by a camera that walks or rides past in any direction."""

    def exam(self) -> Exam:
        """See :class:`ExamCase`. Its motion is that of rows which comes nearest to how far each pixel moves."""
        camera, dice = self.camera(), self.dice(_STREET)
        way = dice.uniform(*(_WALK if self.suite.kind == "walk" else _RIDE)) * np.exp(1j * dice.uniform(0, 2 * np.pi))
        passing = Passing(camera, self.log(_LONGEST_S), self.suite.readout_s, (way.real, way.imag))
        street = draw_street(dice, _place(self.path), camera)
        rs = with_noise(street.seen(passing, _FINER), _NOISE, self.dice(_GRAIN))
        moved = street.moved(passing)
        photo = Photo.from_bytes(Photo.from_array(rs).to_bytes("jpeg", _QUALITY))
        focal = camera.focal_px if self.draw % _FOCAL_STATED == 0 else None
        view = View(replace(photo, path=self.file), Stated(focal_px=focal))
        return Exam(view, street.seen(passing, _FINER, is_global=True), nearest_motion(moved), moved)


_FPS = 30.0


@dataclass(frozen=True)
class PlaceClip(_Drawn, RotatingClip):
    """A few consecutive frames of a place; methods that see one photo get the middle one."""

    shown = RATIO_KNOWN

    @property
    def singles(self) -> tuple[int]:
        """The middle frame."""
        return (self.suite.frames // 2,)

    def camera_and_frames(self) -> tuple[RotatingCamera, list[np.ndarray]]:
        """See :class:`RotatingClip`. The camera has the drawn attitude in the middle of the clip."""
        held, frames = self.camera(), self.suite.frames
        log = self.log(RotatingCamera.duration_s(frames, _FPS))
        size = {"height": held.height, "width": held.width, "focal_px": held.focal_px}
        camera = RotatingCamera(log, 0.0, frames, _FPS, self.suite.readout_ratio, **size)
        place, rng = _place(self.path), self.dice(_GRAIN)
        rotations = [camera.rotations(camera.row_times(frame)).transpose(0, 2, 1) for frame in range(frames)]
        return camera, [with_noise(place.seen(held, each), _NOISE, rng) for each in rotations]

    def view(self) -> View:
        """See :class:`Case`."""
        camera, frames = self.camera_and_frames()
        return self.view_of(frames[self.suite.frames // 2], camera)

    def view_of(self, frame: np.ndarray, camera: RotatingCamera) -> View:
        """See :class:`RotatingClip`."""
        return View(replace(Photo.from_array(frame), path=self.file), Stated(focal_px=camera.focal_px))

    def more_figures(self, name: str, errors: list[float], ratio: ReadoutRatio | None) -> Record:
        """See :class:`RotatingClip`; there are none."""
        return {}


@lru_cache(maxsize=16)
def _place(path: Path) -> Place:
    return Place.load(path)


SUITES = (
    PlaceSuite("still", "still"),
    *(PlaceSuite(f"hand {ms} ms", "hand", ms / 1000) for ms in (20, 50, 100)),
    PlaceSuite("pan 50 ms", "pan", 0.05),
    PlaceSuite("quadratic", "quadratic"),
    PlaceSuite("hand 50 ms, exposed 1/60 s", "hand", 0.05, exposure_s=1 / 60),
    PlaceSuite("street, walking, 50 ms", "walk", 0.05),
    PlaceSuite("street, riding, 30 ms", "ride", 0.03),
    PlaceSuite("pair", "hand", frames=2),
    PlaceSuite("clip", "hand", frames=16),
    PlaceSuite("clip, pan", "pan", frames=16),
)


def place_cases(group: str, folders: list[Path], per_place: int, seed: int) -> list[Case]:
    """Returns all cases of some places; pairs and clips of the first photos only, since they have many frames."""
    return [
        _kind_of(suite)(suite, group, folder, draw, seed)
        for suite in SUITES
        for folder in folders
        for draw in range(per_place if suite.frames == 1 else 1)
    ]


def _kind_of(suite: PlaceSuite) -> type[PlaceCase | StreetCase | PlaceClip]:
    if suite.kind in ("walk", "ride"):
        return StreetCase
    return PlaceCase if suite.frames == 1 else PlaceClip
