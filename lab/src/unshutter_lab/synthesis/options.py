"""Options for synthesising rolling-shutter pictures and clips."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from unshutter.errors import UsageError
from unshutter.options.fields import check_time, option


@dataclass(frozen=True)
class Synthesize:
    """How rolling-shutter pictures are made from undistorted photos."""

    per_photo: int = option(1, "Pictures made from each photo. Default: 1.")
    seed: int = option(0, "Same seed, same pictures. Default: 0.")
    motion: Literal["quadratic", "trajectory"] = option(
        "quadratic",
        "quadratic: the random motions of Rengarajan 2017. trajectory: windows of a recorded camera motion.",
    )
    trajectory: Path | None = option(
        None,
        "NPZ file with t_s and gyro_rad_s, or t_s, position_m and quaternion_wxyz.",
        metavar="FILE",
        names="input",
    )
    readout_ms: float | None = option(
        None, "Time from the first to the last row, for trajectories and exposures.", metavar="MS"
    )
    exposure_s: float | None = option(
        None,
        "Exposure time of each row, which its own motion blurs; written into EXIF. Default: sharp.",
        metavar="SECONDS",
    )
    focal_px: float | None = option(None, "Focal length in px of the finished picture, for trajectories.", metavar="PX")
    size: int = option(256, "Side of the finished pictures in px. Default: 256.", metavar="PX")
    canvas: int = option(
        356, "Side in px of the picture that is distorted; its middle is cut out. Default: 356.", metavar="PX"
    )

    def __post_init__(self) -> None:
        if self.per_photo < 1 or self.seed < 0:
            raise UsageError(
                f"--per-photo must be at least 1 and --seed at least 0, got {self.per_photo} and {self.seed}"
            )
        for name, time, unit in (("exposure-s", self.exposure_s, "s"), ("readout-ms", self.readout_ms, "ms")):
            check_time(name, time, unit)
        if self.exposure_s is not None and self.readout_ms is None:
            raise UsageError("--exposure-s needs --readout-ms: the blur of a row depends on both")
        if self.motion == "quadratic" and not (self.trajectory is self.focal_px is None):
            raise UsageError("--trajectory and --focal-px are for --motion trajectory only")
        if self.motion == "quadratic" and self.exposure_s is None and self.readout_ms is not None:
            raise UsageError("--readout-ms is for --motion trajectory and --exposure-s only")
        if self.motion == "trajectory" and None in (self.trajectory, self.readout_ms, self.focal_px):
            raise UsageError("--motion trajectory needs --trajectory, --readout-ms and --focal-px")
        if self.motion not in ("quadratic", "trajectory"):
            raise UsageError(f"unknown motion '{self.motion}': choose quadratic or trajectory")

    @property
    def exposure(self) -> float:
        """Exposure time of a row, in readout times; 0 without an exposure."""
        if self.exposure_s is None or self.readout_ms is None:
            return 0.0
        return 1000 * self.exposure_s / self.readout_ms


@dataclass(frozen=True)
class SynthesizeClip:
    """What kind of clip is made from a photo."""

    video: bool = option(False, "Make a clip with sound instead of pictures: rs.mp4, and the undistorted gs.mp4.")
    seconds: float = option(5.0, "Length of the clip in seconds. Default: 5.", metavar="S")
    fps: float = option(30.0, "Frames per second. Default: 30.", metavar="N")
    frame: str = option(
        "1920x1080", "Width and height of the clip in px. Default: 1920x1080.", metavar="WxH", names="word"
    )

    def __post_init__(self) -> None:
        width, height = self.size
        if not (0 < self.seconds <= 3600 and 0 < self.fps <= 1000 and 64 <= min(width, height) <= max(width, height)):
            raise UsageError("a clip needs a length and a rate above 0, and frames of at least 64x64 px")
        if width % 2 or height % 2:
            raise UsageError(f"frames of a clip have an even width and height, got {self.frame}")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        parts = self.frame.lower().split("x")
        if len(parts) != 2 or not all(part.isdigit() and len(part) < 6 for part in parts):
            raise UsageError(f"write the frame size as 1920x1080, not '{self.frame}'")
        return int(parts[0]), int(parts[1])
