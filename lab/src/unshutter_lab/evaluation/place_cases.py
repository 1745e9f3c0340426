"""Photos, pairs of frames and clips of places, with exactly known motion: the benchmark that anyone can repeat.

Everything about a picture follows from the seed, the name of the place and the number of the draw: the camera is the
same in all suites, and a hand shakes alike in all of them, for as long as the readout takes.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from unshutter.frames.sequence import CameraMotion
from unshutter.motion import RowMotion
from unshutter.options import Camera as Stated
from unshutter.photo import Photo
from unshutter.readout_time import ReadoutRatio
from unshutter.single.estimator import View
from unshutter_lab.evaluation.case import Answer, Case, Example, Loaded, Record, ask, compared
from unshutter_lab.evaluation.exam import Exam, ExamCase
from unshutter_lab.evaluation.metrics import epe_of_nothing, motion_error
from unshutter_lab.synthesis.handheld import draw_camera, draw_hand, draw_pan
from unshutter_lab.synthesis.panorama import Camera, Place
from unshutter_lab.synthesis.place_photos import Moving, Quadratic, Turning, take_photo, with_noise
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import TurningCamera

_SIZE = (300, 400)  # rows and columns of a photo [px], about as fine as the places are
_UPRIGHT = 4  # the second of every four photos is taller than wide
_TOLD = 2  # every second one states its focal length
_NOISE, _QUALITY = 2.0, 90  # standard deviation [levels of 255], and quality of the JPEG
_LONGEST_S = 0.3  # of a drawn hand: all readouts, and the exposures around them
_CAMERA, _MOTION, _GRAIN = range(3)  # streams of random numbers

Kind = Literal["still", "hand", "pan", "quadratic"]


@dataclass(frozen=True)
class PlaceSuite:
    """The specification of a suite's pictures."""

    name: str  # as in the tables
    kind: Kind
    readout_s: float = 0.0  # of hands and pans
    exposure_s: float = 0.0  # of every row, told to nobody
    frames: int = 1  # 2 for pairs, more for clips
    readout_ratio: float = 0.6  # of pairs and clips: readout time / frame interval


@dataclass(frozen=True)
class _Drawn:
    """What all cases of places have in common."""

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
        focal = camera.focal_px if self.draw % _TOLD == 0 else None
        return Exam(View(replace(photo, path=self.file), Stated(focal_px=focal)), place.seen(camera), truth)

    def _moving(self, camera: Camera) -> Moving | None:
        if self.suite.kind == "still":
            return None
        if self.suite.kind == "quadratic":
            return Quadratic.drawn(self.dice(_MOTION), camera)
        return Turning(camera, self.log(_LONGEST_S), self.suite.readout_s)


ALL_FRAMES, RATIO_KNOWN = "frames-camera", "frames-camera, ratio given"
_FPS = 30.0


@dataclass(frozen=True)
class PlaceClip(_Drawn, Case):
    """A few consecutive frames of a place; methods that see one photo get the middle one."""

    @property
    def oracles(self) -> tuple[str, ...]:
        """The methods that see all frames, with and without the readout ratio."""
        return (ALL_FRAMES, RATIO_KNOWN)

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns one record per name."""
        turning, frames = self._turning(), list(self.frames())
        return [self._record(name, turning, frames, loaded) for name in names]

    def show(self, names: list[str], loaded: Loaded) -> Example:
        """Returns the pictures and curves of the middle frame."""
        turning, frames = self._turning(), list(self.frames())
        middle = self.suite.frames // 2
        curves = {name: self._answers(name, turning, frames, loaded)[middle].motion for name in [*names, RATIO_KNOWN]}
        truth = turning.motion(middle)
        pictures = compared(Photo.from_array(frames[middle]), {**curves, "true motion": truth})
        return Example(self.title, pictures, {"truth": truth, **curves})

    def frames(self) -> Iterator[np.ndarray]:
        """Yields the frames, uint8 [H, W, 3]."""
        turning, camera, place, rng = self._turning(), self.camera(), _place(self.path), self.dice(_GRAIN)
        for frame in range(self.suite.frames):
            rotations = turning.rotations(turning.row_times(frame))
            yield with_noise(place.seen(camera, rotations.transpose(0, 2, 1)), _NOISE, rng)

    def _turning(self) -> TurningCamera:
        """Returns the moving camera, which has the drawn attitude in the middle of the clip."""
        camera, frames = self.camera(), self.suite.frames
        log = self.log(TurningCamera.duration_s(frames, _FPS))
        size = {"height": camera.height, "width": camera.width, "focal_px": camera.focal_px}
        return TurningCamera(log, 0.0, frames, _FPS, self.suite.readout_ratio, **size)

    def _record(self, name: str, turning: TurningCamera, frames: list[np.ndarray], loaded: Loaded) -> Record:
        answers = self._answers(name, turning, frames, loaded)
        truths = {k: turning.motion(k) for k in answers}
        errors = [motion_error(answer.motion, truths[k]).epe for k, answer in answers.items()]
        nothing = float(np.mean([epe_of_nothing(truth) for truth in truths.values()]))
        record = self.place | {"estimator": name, **answers[self.suite.frames // 2].figures()}
        return record | {"epe": float(np.mean(errors)), "epe_nothing": nothing}

    def _answers(
        self, name: str, turning: TurningCamera, frames: list[np.ndarray], loaded: Loaded
    ) -> dict[int, Answer]:
        """Returns answers by the number of the frame: of all frames, or of the middle one."""
        if name in self.oracles:
            known = ReadoutRatio(turning.readout_ratio) if name == RATIO_KNOWN else None
            answers = [frame.finding() for frame in CameraMotion(known).frames(frames)]
            return {k: Answer(found, declined=str(found.reason or "")) for k, found in enumerate(answers)}
        middle = self.suite.frames // 2
        return {middle: ask(loaded(name), self._view(frames[middle], turning.focal_px))}

    def view(self) -> View:
        """See :class:`Case`."""
        frames = list(self.frames())
        return self._view(frames[self.suite.frames // 2], self._turning().focal_px)

    def _view(self, frame: np.ndarray, focal_px: float) -> View:
        return View(replace(Photo.from_array(frame), path=self.file), Stated(focal_px=focal_px))


@lru_cache(maxsize=16)
def _place(path: Path) -> Place:
    return Place.load(path)


SUITES = (
    PlaceSuite("still", "still"),
    *(PlaceSuite(f"hand {ms} ms", "hand", ms / 1000) for ms in (20, 50, 100)),
    PlaceSuite("pan 50 ms", "pan", 0.05),
    PlaceSuite("quadratic", "quadratic"),
    PlaceSuite("hand 50 ms, exposed 1/60 s", "hand", 0.05, exposure_s=1 / 60),
    PlaceSuite("pair", "hand", frames=2),
    PlaceSuite("clip", "hand", frames=16),
    PlaceSuite("clip, pan", "pan", frames=16),
)


def place_cases(group: str, folders: list[Path], per_place: int, seed: int) -> list[Case]:
    """Returns all cases of some places; pairs and clips of the first photos only, since they have many frames."""
    return [
        (PlaceCase if suite.frames == 1 else PlaceClip)(suite, group, folder, draw, seed)
        for suite in SUITES
        for folder in folders
        for draw in range(per_place if suite.frames == 1 else 1)
    ]
