"""The time in which a camera reads out a frame: its value, its error and its source."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from unshutter.reasons import Reason

_DIGITS = 12  # after the point, so that a ratio is still the same after it was a time


class ReadoutSource(StrEnum):
    """The evidence for a readout time."""

    GIVEN = "given"  # by the user
    TAG = "the clip's file"
    GYRO_LOG = "gyro log"  # which states it
    GYRO = "gyro"  # compared with the frames
    FRAMES = "motion"  # at which time the camera's path is smoothest
    REGRESSION = "regression"  # of how frames are skewed and stretched, on how the camera's speed changes
    TABLE = "table of cameras"
    USUAL = "usual value"
    MOTION_FILE = "motion file"
    # of photos: the kind of their camera or shutter
    LEAF = "leaf shutter or CCD"
    GLOBAL = "global shutter"
    FOCAL_PLANE = "focal-plane shutter"
    PHONE = "phone"
    DRONE = "drone or action camera"
    EITHER = "mechanical or electronic shutter"
    ELECTRONIC = "electronic shutter"
    UNKNOWN = "unknown camera"

    @property
    def is_measured(self) -> bool:
        """Whether it was found in the frames, or by comparing them with a gyro log."""
        return self in (ReadoutSource.FRAMES, ReadoutSource.REGRESSION, ReadoutSource.GYRO)


@dataclass(frozen=True)
class ReadoutRatio:
    """The readout time of a frame as a share of the time between two frames: all that counts for their motion."""

    value: float  # 0 ... 1
    error: float = 0.0  # its standard deviation
    source: ReadoutSource = ReadoutSource.GIVEN

    def seconds(self, interval_s: float) -> ReadoutTime:
        """Returns the readout time for an interval between frames [s]."""
        return ReadoutTime(self.value * interval_s, self.error * interval_s, self.source)

    def __str__(self) -> str:
        return f"{self.value:.3f} +- {self.error:.3f} (from {self.source})"


@dataclass(frozen=True)
class ReadoutTime:
    """The time from the first row of a frame to the last."""

    seconds: float
    error_s: float = 0.0  # its standard deviation [s]
    source: ReadoutSource = ReadoutSource.GIVEN
    camera: str = ""  # name of the camera, or of the cameras for which it is typical; empty if that says nothing
    plausible_s: tuple[float, float] | None = None  # least and greatest plausible time [s]; None if the time is known
    instead_of: Reason | None = None  # why a clip does not reveal its own time, if a usual one was used
    # what the clip's frames show for certain, if that differs; below 0: from the bottom [s]
    shown_s: float | None = None

    @classmethod
    def of_ms(
        cls, ms: float, source: ReadoutSource, camera: str = "", plausible_ms: tuple[float, float] | None = None
    ) -> ReadoutTime:
        """Returns a time given in milliseconds."""
        plausible_s = None if plausible_ms is None else (plausible_ms[0] / 1000, plausible_ms[1] / 1000)
        return cls(ms / 1000, source=source, camera=camera, plausible_s=plausible_s)

    def ratio(self, interval_s: float) -> ReadoutRatio:
        """Returns the time as a share of the time between frames [s], of which none takes longer to be read out."""
        value = self.seconds / interval_s
        error = self.error_s / interval_s
        return ReadoutRatio(min(round(value, _DIGITS), 1.0), min(round(error, _DIGITS), 1.0), self.source)

    @property
    def ms(self) -> float:
        """The time [ms]."""
        return 1000 * self.seconds

    @property
    def error_ms(self) -> float:
        """Its standard deviation [ms]."""
        return 1000 * self.error_s

    @property
    def plausible_ms(self) -> tuple[float, float] | None:
        """The least and greatest plausible time [ms]; None if the time is known."""
        return self.plausible_s and (1000 * self.plausible_s[0], 1000 * self.plausible_s[1])

    @property
    def longest_s(self) -> float:
        """The longest plausible time [s]; equal to the usual one if that is known."""
        return self.plausible_s[1] if self.plausible_s else self.seconds
