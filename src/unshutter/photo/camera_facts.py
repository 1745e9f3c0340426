"""Facts about the camera from a photo's metadata: focal length, exposure, time, readout, attitude."""

from __future__ import annotations

from abc import ABC
from functools import cached_property
from typing import TYPE_CHECKING

from unshutter.geometry.readout import Orientation
from unshutter.photo.metadata import Metadata
from unshutter.photo.tags import exif

if TYPE_CHECKING:
    from datetime import datetime

    from unshutter.photo.tags.attitude import Attitude
    from unshutter.photo.tags.flight import Flight
    from unshutter.photo.tags.readout_time import ReadoutTime


class CameraFacts(ABC):
    """Facts about the camera from the metadata of a photo."""

    height: int
    width: int
    orientation: int
    _metadata: Metadata

    def focal_px(self) -> float | None:
        """Returns the focal length in pixels of the stored picture from EXIF's 35 mm equivalent; None if unknown."""
        return exif.focal_px(self._metadata.exif, self.height, self.width)

    def exposure_s(self) -> float | None:
        """Returns the exposure time [s] from EXIF; None if unknown."""
        from unshutter.photo.tags import exposure  # imported here, as below, so that decoding can start first

        return exposure.time_s(self._metadata.exif)

    def taken(self) -> datetime | None:
        """Returns the time at which the photo was taken, from EXIF, in the camera's time zone; None if unknown."""
        from unshutter.photo.tags import exposure

        return exposure.taken(self._metadata.exif)

    def is_merged(self) -> bool:
        """Whether EXIF marks the photo as merged from several exposures (HDR); its exposure time is one of theirs."""
        from unshutter.photo.tags import exposure

        return exposure.is_merged(self._metadata.exif)

    def readout_time(self) -> ReadoutTime:
        """Returns the likely readout time for the kind of camera named in EXIF."""
        from unshutter.photo.tags import readout_time

        return readout_time.of_exif(self._metadata.exif)

    @cached_property
    def attitude(self) -> Attitude | None:
        """The camera's attitude, as recorded by an accelerometer, level gauge or gimbal; None if unknown."""
        from unshutter.photo.tags import attitude

        metadata = self._metadata
        return attitude.of_photo(metadata.exif, metadata.xmp, Orientation(self.orientation), self.height, self.width)

    @cached_property
    def flight(self) -> Flight | None:
        """The flight of the drone that took the photo; None if unknown or not taken by a drone."""
        from unshutter.photo.tags import flight

        return flight.of_xmp(self._metadata.xmp)
