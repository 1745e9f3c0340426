"""What goes from a photo to its successors beside the pixels, whatever the file's format."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from unshutter.photo.libvips import field, libvips, set_blob

if TYPE_CHECKING:
    import pyvips

_TEXT = "png-comment-"


@dataclass(frozen=True)
class Metadata:
    """A photo's metadata.

    Attributes:
        exif: EXIF, with or without its prefix.
        icc: ICC profile.
        xmp: XMP packet.
        resources: Photoshop's image resources, with IPTC among them.
        resolution: across and down [px/mm].
        resolution_unit: in which a TIFF or JPEG said it.
        description: TIFF's ImageDescription.
        texts: of a PNG, by libvips's names.
    """

    exif: bytes | None = None
    icc: bytes | None = None
    xmp: bytes | None = None
    resources: bytes | None = None
    resolution: tuple[float, float] = (1.0, 1.0)
    resolution_unit: str | None = None
    description: str | None = None
    texts: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of_image(cls, image: pyvips.Image) -> Metadata:
        """What libvips found in a file."""
        return cls(
            exif=field(image, "exif-data"),
            icc=field(image, "icc-profile-data"),
            xmp=field(image, "xmp-data"),
            resources=field(image, "iptc-data"),
            resolution=(image.xres, image.yres),
            resolution_unit=field(image, "resolution-unit"),
            description=field(image, "image-description"),
            texts=tuple((name, field(image, name)) for name in image.get_fields() if name.startswith(_TEXT)),
        )

    def on(self, image: pyvips.Image) -> pyvips.Image:
        """The image with these metadata, where libvips looks for them when it writes a file."""
        image = image.copy(xres=self.resolution[0], yres=self.resolution[1])
        texts = (("resolution-unit", self.resolution_unit), ("image-description", self.description), *self.texts)
        for name, text in texts:
            if text is not None:
                image.set_type(libvips().GValue.refstr_type, name, text)
        blobs = {"icc-profile-data": self.icc, "xmp-data": self.xmp, "iptc-data": self.resources}
        for name, data in (blobs | {"exif-data": self.exif}).items():
            if data is not None:
                set_blob(image, name, data)
        return image
