"""How long a camera takes to read out a frame: the time, how sure it is, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from unshutter.reasons import Reason


@dataclass(frozen=True)
class ReadoutTime:
    """The time from the first row of a frame to the last.

    It is counted in frame intervals wherever there are frames, since only that matters for their motion; otherwise in
    seconds.
    """

    value: float  # of frames: in frame intervals, 0 ... 1; of a photo, or of a camera in a list: in seconds
    error: float  # its standard deviation
    source: str  # the evidence it was derived from; of a photo: the kind of its camera or shutter
    camera: str = ""  # name of the camera, or of the cameras for which it is typical; empty if that says nothing
    instead_of: Reason | None = None  # why a clip does not reveal its own time, if a usual one was used
    plausible: tuple[float, float] | None = None  # least and greatest plausible value; None if the time is known
    declined: Reason | None = None  # why a clip's frames must not be straightened with it; None if they may
    unit_s: float | None = None  # the frame interval [s], None if it is unknown; 1 for a time in seconds

    @classmethod
    def of_ms(
        cls, ms: float, source: str, camera: str = "", plausible_ms: tuple[float, float] | None = None
    ) -> ReadoutTime:
        """Returns a time in seconds."""
        plausible = None if plausible_ms is None else (plausible_ms[0] / 1000, plausible_ms[1] / 1000)
        return cls(ms / 1000, 0.0, source, camera, plausible=plausible, unit_s=1.0)

    def in_frames(self, interval_s: float) -> ReadoutTime:
        """Returns the time in intervals of frames that are so far apart; no frame takes longer than one."""
        if self.unit_s in (None, interval_s):
            return replace(self, unit_s=interval_s)
        unit_s = self.unit_s or 1.0
        times = (self.value, self.error, *(self.plausible or ()))
        value, error, *bounds = (min(each * unit_s / interval_s, 1.0) for each in times)
        plausible = (bounds[0], bounds[1]) if bounds else None
        return replace(self, value=value, error=error, plausible=plausible, unit_s=interval_s)

    @property
    def ms(self) -> float:
        """The time [ms]; like all of these, only if the unit is known."""
        return self._unit_ms * self.value

    @property
    def error_ms(self) -> float:
        """Its standard deviation [ms]."""
        return self._unit_ms * self.error

    @property
    def plausible_ms(self) -> tuple[float, float] | None:
        """The least and greatest plausible time [ms]; None if the time is known."""
        return self.plausible and (self._unit_ms * self.plausible[0], self._unit_ms * self.plausible[1])

    @property
    def _unit_ms(self) -> float:
        assert self.unit_s is not None
        return 1000 * self.unit_s

    @property
    def typical_s(self) -> float:
        """The time [s]: if it is not known, the usual one."""
        return self.value * (self.unit_s or 1.0)

    @property
    def longest_s(self) -> float:
        """The longest plausible time [s]; equal to the usual one if that is known."""
        return (self.plausible[1] if self.plausible else self.value) * (self.unit_s or 1.0)

    def as_json(self) -> dict[str, Any]:
        """Returns all fields, ready for JSON, as read by :meth:`from_json`."""
        return {
            "value": self.value,
            "error": self.error,
            "source": self.source,
            "camera": self.camera,
            "instead_of": self.instead_of and self.instead_of.as_json(),
            "plausible": self.plausible and [*self.plausible, self.camera],
            "declined": self.declined and self.declined.as_json(),
            "unit_s": self.unit_s,
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ReadoutTime:
        """Reads the data written by :meth:`as_json`; earlier versions wrote no unit."""
        instead_of, declined = (data[name] and Reason.from_json(data[name]) for name in ("instead_of", "declined"))
        *bounds, camera = data["plausible"] or (data["camera"],)
        plausible = (bounds[0], bounds[1]) if bounds else None
        own = data["value"], data["error"], data["source"], camera
        return cls(*own, instead_of, plausible, declined, data.get("unit_s"))

    def __str__(self) -> str:
        return f"{self.value:.3f} +- {self.error:.3f} (from {self.source})"
