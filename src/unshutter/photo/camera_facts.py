"""What a photo's metadata say about its camera: focal length, exposure, time, readout, attitude."""

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
    """What the metadata of a photo say about its camera."""

    height: int
    width: int
    orientation: int
    _metadata: Metadata

    def focal_px(self) -> float | None:
        """Focal length in pixels of the stored picture, from EXIF's 35 mm equivalent; None where it is not known."""
        return exif.focal_px(self._metadata.exif, self.height, self.width)

    def exposure_s(self) -> float | None:
        """How long the photo was exposed [s], from EXIF; None where it is not known."""
        from unshutter.photo.tags import exposure  # here, as below: not before the photo is being decoded

        return exposure.time_s(self._metadata.exif)

    def taken(self) -> datetime | None:
        """When it was taken, by EXIF, in the camera's time zone; None where it is not known."""
        from unshutter.photo.tags import exposure

        return exposure.taken(self._metadata.exif)

    def is_merged(self) -> bool:
        """Whether it was put together from several exposures (HDR), by EXIF: its exposure time is that of one."""
        from unshutter.photo.tags import exposure

        return exposure.is_merged(self._metadata.exif)

    def readout_time(self) -> ReadoutTime:
        """How long its readout may have taken, by the kind of camera that EXIF names."""
        from unshutter.photo.tags import readout_time

        return readout_time.of_exif(self._metadata.exif)

    @cached_property
    def attitude(self) -> Attitude | None:
        """How the camera was held, as an accelerometer, level gauge or gimbal wrote it; None where it is not known."""
        from unshutter.photo.tags import attitude

        metadata = self._metadata
        return attitude.of_photo(metadata.exif, metadata.xmp, Orientation(self.orientation), self.height, self.width)

    @cached_property
    def flight(self) -> Flight | None:
        """How the drone flew that took it; None where it is not known, or no drone did."""
        from unshutter.photo.tags import flight

        return flight.of_xmp(self._metadata.xmp)
