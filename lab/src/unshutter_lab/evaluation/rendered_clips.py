"""Scores ``unshutter video`` on rendered clips, whose global-shutter frames and exact map are known.

The clip that is straightened is encoded (H.264, 4:4:4). The bound is the exact map applied to its decoded frames and
encoded with the same encoder at the same quality, so that neither the codec nor the interpolation counts as a loss.
"""

from __future__ import annotations

import json
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from unshutter.frames.pyav import av
from unshutter.motion.lens import Lens
from unshutter.motion.shapes import UInt8
from unshutter.reasons import JsonObject
from unshutter_lab.evaluation.case import NOTHING, Case, Example, Loaded, Record
from unshutter_lab.evaluation.metrics import psnr
from unshutter_lab.evaluation.real_clips import OURS, outcome_of, straighten
from unshutter_lab.synthesis.panorama import Place
from unshutter_lab.synthesis.place_photos import with_noise
from unshutter_lab.synthesis.rendered_places import ClipSettings, RenderedPlace

GIVEN, EXACT = "unshutter-given", "exact-map"
RENDERED_METHODS = (NOTHING, OURS, GIVEN, EXACT)
_ENDING, _FORMAT, _CRF = ".mkv", "yuv444p", "18"
_LOSSLESS = "12"  # the CRF at which our clips look like the original
_BORDER = 0.06  # of the height, without which pictures are compared
_BENT = (0.10, -0.06, 0.02, -0.003)  # a lens that one number for its bend does not describe
CLIPS = (
    ClipSettings("hand, 24 frames/s", 24, 20, 5, 48),
    ClipSettings("hand, 60 frames/s", 60, 12, 3, 120),
    ClipSettings("wide lens", 30, 24, 4, 60, degrees=122, k=_BENT),
    ClipSettings("walk, fence, people", 30, 20, 6, 60, walks=True, figures=2),
    ClipSettings("little light, people", 24, 25, 5, 48, figures=2, dark=True, noise=6),
    ClipSettings("fast, repeated frames", 30, 32, 10, 60, repeated=8),
    ClipSettings("drone, 23 Hz", 30, 24, 3, 60, vibration=(23, 0.12)),
)


@dataclass(frozen=True)
class RenderedClipCase(Case):
    """A rendered clip of a place."""

    settings: ClipSettings
    path: Path  # folder of the place
    seed: int  # seed of the run

    @property
    def key(self) -> str:
        """Name of the settings, and the place."""
        return f"{self.settings.name}|{self.path.name}"

    @property
    def place(self) -> Record:
        """Name of the settings, and the place."""
        return {"suite": "rendered", "group": self.path.name, "photo": self.settings.name, "draw": 0}

    def judge(self, names: list[str], loaded: Loaded) -> list[Record]:
        """Returns one record per method."""
        dice = np.random.default_rng([self.seed, zlib.crc32(self.key.encode())])
        scene = RenderedPlace(self.settings, Place.load(self.path), dice)
        truth = list(scene.pictures(is_global=True))
        maps = [scene.exact_map(scene.shown(frame)) for frame in range(self.settings.frames)]
        border = round(_BORDER * self.settings.height)
        inner = np.zeros((self.settings.height, self.settings.width), bool)
        inner[border:-border, border:-border] = True
        still = [inner & each for _, each in maps]
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            clip = folder / f"clip{_ENDING}"
            _write(clip, _noisy(scene, dice), self.settings.fps, {"crf": _CRF})
            exact = folder / f"exact{_ENDING}"
            undone = (
                cv2.remap(frame, at[..., 0], at[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
                for frame, (at, _) in zip(_frames(clip), maps, strict=True)
            )
            _write(exact, undone, self.settings.fps, {"crf": _LOSSLESS})
            scores = {NOTHING: _scores(clip, truth, still, inner), EXACT: _scores(exact, truth, still, inner)}
            records = []
            for method in names:
                said: Record = {}
                if method not in scores:
                    output = folder / f"{method}{_ENDING}"
                    given = _given(scene, folder) if method == GIVEN else ()
                    outcome = straighten(clip, output, "--edges", "fill", *given)  # the truth is not enlarged
                    scores[method] = _scores(output, truth, still, inner)
                    said = outcome_of(outcome) | {"corner_px": _corner_error(scene, outcome)}
                about = {"shift_px": scene.shift_px, "true_ms": self.settings.readout_ms}
                figures = _figures(scores[method], scores[NOTHING], scores[EXACT])
                records.append({**self.place, "estimator": method, **about, **figures, **said})
        return records

    def show(self, names: list[str], loaded: Loaded) -> Example | None:
        """Returns None: a picture does not show a wobble."""
        return None


@dataclass(frozen=True)
class _Scores:
    """PSNR of each frame [dB]: where the same still surface is seen, and of whole pictures."""

    still: np.ndarray
    whole: np.ndarray


def _figures(after: _Scores, before: _Scores, exact: _Scores) -> Record:
    """Returns the figures of a method."""
    gains = after.still - before.still
    return {
        "psnr": float(after.still.mean()),
        "psnr_input": float(before.still.mean()),
        "least": float(gains.min()),
        "share": _share(after.still, before.still, exact.still),
        "psnr_whole": float(after.whole.mean()),
        "share_whole": _share(after.whole, before.whole, exact.whole),
    }


def _share(after: np.ndarray, before: np.ndarray, exact: np.ndarray) -> float | None:
    """Returns the gain as a share of the exact map's; None if that gains nothing."""
    most = float(exact.mean() - before.mean())
    return float(after.mean() - before.mean()) / most if most > 0 else None


def _noisy(scene: RenderedPlace, dice: np.random.Generator) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    """Yields the rolling-shutter frames as the camera records them; a repeated one has its predecessor's noise."""
    picture = None
    for number, clean in enumerate(scene.pictures(is_global=False)):
        if picture is None or scene.shown(number) == number:
            picture = with_noise(clean, scene.settings.noise, dice)
        yield picture


def _write(path: Path, frames: Iterator[np.ndarray], fps: float, options: dict[str, str]) -> None:
    with av().open(str(path), "w") as out:
        video = None
        for pixels in frames:
            if video is None:
                video = out.add_stream("libx264", rate=round(fps), options=options)
                video.height, video.width, video.pix_fmt = *pixels.shape[:2], _FORMAT
            frame = av().VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
            out.mux(video.encode(frame.reformat(format=_FORMAT)))
        if video is not None:
            out.mux(video.encode(None))


def _frames(path: Path) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    with av().open(str(path)) as clip:
        for frame in clip.decode(video=0):
            yield frame.to_ndarray(format="rgb24")


def _scores(path: Path, truth: list[np.ndarray], still: list[np.ndarray], inner: np.ndarray) -> _Scores:
    frames = list(zip(_frames(path), truth, still, strict=True))
    alone = np.array([psnr(frame, true, mask) for frame, true, mask in frames])
    return _Scores(alone, np.array([psnr(frame, true, inner) for frame, true, _ in frames]))


def _given(scene: RenderedPlace, folder: Path) -> list[str]:
    """Returns the options that give the readout ratio and the lens, or the focal length."""
    ratio = ["--readout-ratio", str(scene.camera.readout_ratio)]
    focal = scene.focal_px
    if scene.lens is None:
        return [*ratio, "--focal-px", str(focal)]
    width = scene.settings.width
    height = scene.settings.height
    matrix = [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]]
    fisheye = {"camera_matrix": matrix, "distortion_coeffs": list(scene.lens.k)}
    path = folder / "lens.json"
    path.write_text(json.dumps({"calib_dimension": {"w": width, "h": height}, "fisheye_params": fisheye}))
    return [*ratio, "--lens", str(path)]


def _corner_error(scene: RenderedPlace, outcome: JsonObject) -> float | None:
    """Returns how far from the corner the lens found shows the corner's direction [px]; None without a lens."""
    if scene.lens is None or not outcome.get("lens"):
        return None
    height = scene.settings.height
    corner = float(np.hypot(1, scene.settings.width / height)) / 2
    found = Lens.of_json(outcome["lens"])
    angle = scene.lens.angle(corner / scene.lens.focal)
    return (float(found.distance(angle)) * found.focal - corner) * height
