"""Results that jobs report about photos and clips, sent as JSON so that the server does not need NumPy."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from unshutter.motion import Motion
    from unshutter.motion.candidate import Candidate
    from unshutter.motion.verdict import Verdict
    from unshutter.photo.tags.attitude import Attitude
    from unshutter.reasons import Reason
    from unshutter.serve.jobs.by_hand import Shape
    from unshutter.video.outcome import ClipOutcome

_CURVE_POINTS = 41


@dataclass(frozen=True)
class PhotoFacts:
    """Metadata from a photo's file.

    Attributes:
        format: file format.
        height, width: size of the upright photo [px].
        focal_px: focal length, or a guess.
        exposure_s: exposure time, or None if unknown.
        arrows: readout direction -> the direction in which it points in the upright photo.
        attitude: orientation of the camera in space, or None if unknown.
    """

    format: str
    height: int
    width: int
    focal_px: float
    exposure_s: float | None
    arrows: dict[str, str]
    attitude: Attitude | None

    def as_json(self) -> dict[str, Any]:
        """Its fields by name."""
        held = self.attitude
        attitude = held and {"roll_deg": held.roll_deg, "tilt_deg": held.tilt_deg, "from": held.source}
        return {**vars(self), "attitude": attitude}


@dataclass(frozen=True)
class PhotoResult:
    """Preview result for a photo.

    Attributes:
        verdict: whether the photo is changed, and if not, why.
        motion: the camera motion that would be undone.
        shape: the motion at which the page's sliders start.
        readout: direction in which the sensor was read.
        neighbours: whether motion was estimated from neighbouring photos, in which case ``motion`` is None.
        edges: treatment of areas that the photo does not cover, or None if the photo is not changed.
        whole: share of the photo's area that a crop leaves, or None if no crop was computed.
        crop: (left, top, right, bottom) of the area that a crop leaves, as shares of the upright photo.
    """

    verdict: Verdict
    motion: Motion | None
    shape: Shape | None
    readout: str
    neighbours: bool = False
    edges: str | None = None
    whole: float | None = None
    crop: list[float] | None = None

    def as_json(self) -> dict[str, Any]:
        """Returns the verdict, the motion's curves at a few rows, and the treatment of edges."""
        about = _motion_json(self.motion) if self.motion is not None else {"neighbours": self.neighbours}
        edges = {"edges": self.edges, "whole": self.whole, "crop": self.crop}
        shape = {name: round(value, 3) for name, value in vars(self.shape).items()} if self.shape else None
        return {**self.verdict.as_json(), **about, "shape": shape, "readout": self.readout, **edges}


@dataclass(frozen=True)
class CandidateFacts:
    """One of the motions that fit a photo, for the page to offer.

    Attributes:
        candidate: the motion and its description.
        largest_px: largest displacement at the requested strength.
        taken: whether this motion is used unless the user chooses another.
    """

    candidate: Candidate
    largest_px: float
    taken: bool

    def as_json(self) -> dict[str, Any]:
        """Returns the facts that users compare: kind, pan direction, description, displacement and probability."""
        each = self.candidate
        probability = None if each.probability is None else round(each.probability, 4)
        return {
            "kind": each.kind,
            "direction": each.direction if each.kind == "pan" else None,
            "description": each.description,
            "largest_px": round(self.largest_px, 2),
            "probability": probability,
            "taken": self.taken,
        }


@dataclass(frozen=True)
class SavedPhoto:
    """Report on a photo that was written.

    Attributes:
        verdict: whether the photo was changed, and if not, why.
        note: one-line note for the user, or empty.
    """

    verdict: Verdict | None
    note: str = ""

    def as_json(self) -> dict[str, Any]:
        """Returns the verdict and the note."""
        verdict = self.verdict.as_json() if self.verdict else {}
        return {**verdict, "note": self.note} if self.note else verdict


@dataclass(frozen=True)
class ClipFacts:
    """Metadata from a clip's file.

    Attributes:
        height, width: size of an upright frame [px].
        duration_s: duration of the clip.
        fps: frames per second.
        frames: number of frames according to the file.
        moments_s: times of the moments that the page shows.
    """

    height: int
    width: int
    duration_s: float
    fps: float
    frames: int | None
    moments_s: list[float]

    def as_json(self) -> dict[str, Any]:
        """Its fields by name."""
        return asdict(self)


@dataclass(frozen=True)
class MomentResult:
    """Preview result for a frame of a clip.

    Attributes:
        changed: whether the frame is changed.
        reason: why the frame is not changed, or None if it is changed or nothing moves.
        largest_px: largest displacement.
        tiny: whether the displacement is too small to be seen.
        edges: treatment of areas that the frame does not cover.
        at_s: time of the frame in the clip.
    """

    changed: bool
    reason: Reason | None
    largest_px: float
    tiny: bool
    edges: str
    at_s: float

    def as_json(self) -> dict[str, Any]:
        """Returns the fields by name, with the reason as its sentence, code and figures."""
        reason: dict[str, Any] = {"reason": ""}
        if self.reason is not None:
            about = self.reason.as_json()
            reason = {"reason": about["sentence"], "code": about["code"], "figures": about["figures"]}
        return {**vars(self), **reason}


@dataclass(frozen=True)
class ReadoutTime:
    """The readout time of a clip's camera.

    Attributes:
        ratio, ratio_sd: readout time / frame interval, and its standard deviation.
        ms, ms_sd: readout time [ms], and its standard deviation.
        found_by: source of the readout time.
        cameras: cameras to which a typical or listed time applies; empty for other sources.
        plausible_ms: range of the typical time [ms], or None if the time is known.
        reason: why a typical time is used; empty if the time is known.
    """

    ratio: float
    ratio_sd: float
    ms: float
    ms_sd: float
    found_by: str
    cameras: str
    plausible_ms: tuple[float, float] | None
    reason: str

    def as_json(self) -> dict[str, Any]:
        """Its fields by name."""
        return asdict(self)


@dataclass(frozen=True)
class SavedClip:
    """Report on a clip that was written.

    Attributes:
        outcome: record of the run.
    """

    outcome: ClipOutcome

    def as_json(self) -> dict[str, Any]:
        """Returns the facts that the page reports about the clip."""
        record = self.outcome.as_json()
        return {name: record[name] for name in ("frames", "rectified", "left", "declined", "left_out", "readout_ms")}


def _motion_json(motion: Motion) -> dict[str, Any]:
    import numpy as np

    rows = np.linspace(0, motion.height - 1, _CURVE_POINTS).round().astype(int)
    return {
        "estimator": motion.estimator,
        "reference": motion.reference,
        "rows": motion.height,
        "attitude": {"roll_deg": motion.roll_deg, "tilt_deg": motion.tilt_deg, "from": motion.attitude_from},
        "exposure_s": motion.exposure_s,
        "film": motion.film.as_json() if motion.film else None,
        "tx_px": np.round(motion.tx_px[rows], 2).tolist(),
        "rz_deg": np.round(np.degrees(motion.rz_rad[rows]), 3).tolist(),
    }
