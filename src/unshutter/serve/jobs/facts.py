"""What jobs report about photos and clips; workers send it as JSON, so that the server needs no NumPy."""

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
    """What a photo's file says.

    Attributes:
        format: of the file.
        height, width: of the upright photo [px].
        focal_px: focal length, or a guess.
        exposure_s: exposure time; None: unknown.
        arrows: readout direction -> where it points in the upright photo.
        attitude: how the camera was held; None: unknown.
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
    """What would be done to a photo.

    Attributes:
        verdict: whether it is changed, and why not.
        motion: the motion of the camera alone, as it would be undone.
        shape: the motion that the page's sliders start at.
        readout: direction in which the sensor was read.
        neighbours: whether its neighbours say how things moved, in which case there is no ``motion``.
        edges: what happens to places that the photo did not see; None where it is not changed.
        whole: share of the photo's area that a crop leaves; None where no crop was looked for.
        crop: (left, top, right, bottom) of the part that a crop leaves, as shares of the upright photo.
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
        """The verdict, the motion's curves at a few rows, and what happens to edges."""
        about = _motion_json(self.motion) if self.motion is not None else {"neighbours": self.neighbours}
        edges = {"edges": self.edges, "whole": self.whole, "crop": self.crop}
        shape = {name: round(value, 3) for name, value in vars(self.shape).items()} if self.shape else None
        return {**self.verdict.as_json(), **about, "shape": shape, "readout": self.readout, **edges}


@dataclass(frozen=True)
class CandidateFacts:
    """One of the motions that fit a photo, for the page to offer.

    Attributes:
        candidate: the motion, and what is known of it.
        largest_px: the farthest that anything would be moved, with the strength that is asked for.
        taken: whether it is the one that counts where nobody chooses.
    """

    candidate: Candidate
    largest_px: float
    taken: bool

    def as_json(self) -> dict[str, Any]:
        """What a person compares: kind, direction of a pan, description, px and probability."""
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
    """A photo that was written.

    Attributes:
        verdict: whether it was changed, and why not.
        note: what the user should know of it, one line; empty: nothing.
    """

    verdict: Verdict | None
    note: str = ""

    def as_json(self) -> dict[str, Any]:
        """The verdict and the note, for programs."""
        verdict = self.verdict.as_json() if self.verdict else {}
        return {**verdict, "note": self.note} if self.note else verdict


@dataclass(frozen=True)
class ClipFacts:
    """What a clip's file says.

    Attributes:
        height, width: of an upright frame [px].
        duration_s: of the clip.
        fps: frames per second.
        frames: number of frames, as far as the file says.
        moments_s: when the moments are that the page shows.
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
    """What would be done to a frame of a clip.

    Attributes:
        changed: whether it is changed.
        reason: why not; None: it is, or nothing moves.
        largest_px: the farthest that anything would be moved.
        tiny: whether that is too little to be seen.
        edges: what happens to places that the frame did not see.
        at_s: when the frame is shown.
    """

    changed: bool
    reason: Reason | None
    largest_px: float
    tiny: bool
    edges: str
    at_s: float

    def as_json(self) -> dict[str, Any]:
        """Its fields by name; of the reason, the sentence, the code and the figures."""
        reason: dict[str, Any] = {"reason": ""}
        if self.reason is not None:
            about = self.reason.as_json()
            reason = {"reason": about["sentence"], "code": about["code"], "figures": about["figures"]}
        return {**vars(self), **reason}


@dataclass(frozen=True)
class ReadoutTime:
    """The readout time of a clip's camera.

    Attributes:
        ratio, ratio_sd: readout time / time from frame to frame, and its standard deviation.
        ms, ms_sd: readout time [ms], and its standard deviation.
        found_by: where it comes from.
        cameras: the cameras that a usual or listed time is of; empty: those of no others.
        plausible_ms: range of a usual time [ms]; None where the time is known.
        reason: why a usual time is taken; empty where the time is known.
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
    """A clip that was written.

    Attributes:
        outcome: the record of the run.
    """

    outcome: ClipOutcome

    def as_json(self) -> dict[str, Any]:
        """What the page reports of it."""
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
