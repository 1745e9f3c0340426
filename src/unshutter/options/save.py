"""How a picture is written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from unshutter.errors import UsageError
from unshutter.options.description import option

PictureFormat = Literal["jpeg", "png", "webp", "tiff", "avif"]
Subsampling = Literal["4:4:4", "4:2:0"]


@dataclass(frozen=True)
class Save:
    """How a picture is written.

    Attributes:
        format: of the file; None: the photo's own, AVIF for HEIC, 16-bit TIFF for raw files.
        quality: of JPEG, WebP and AVIF, 1 to 100; None: like the original.
        subsampling: of the chroma of JPEG and AVIF; None: like the original.
        keep_times: whether the file gets the access and modification time of the original.
        only_changed: photos that are left as they are are not written.
        keep_names: results get the names of their photos; only into another folder.

    Raises:
        UsageError: a value that is none of its choices.
    """

    format: PictureFormat | None = option(
        None, "Format of the results. Default: the photo's own; AVIF for HEIC, 16-bit TIFF for raw files."
    )
    quality: int | None = option(None, "Quality of JPEG, WebP and AVIF, 1 to 100. Default: like the original.")
    subsampling: Subsampling | None = option(
        None, "Colour at full (4:4:4) or half (4:2:0) resolution in JPEG and AVIF. Default: like the original."
    )
    keep_times: bool = option(False, "Give each result the access and modification time of its photo.", page=False)
    only_changed: bool = option(False, "Write only photos that change. Default: copy the others.", page=False)
    keep_names: bool = option(
        False, "Give results the names of their photos, in the folder that --output names.", page=False
    )

    def __post_init__(self) -> None:
        if self.quality is not None and not 1 <= self.quality <= 100:
            raise UsageError(f"quality must lie between 1 and 100, got {self.quality}")
        if self.subsampling not in (None, *get_args(Subsampling)):
            choices = ", ".join(get_args(Subsampling))
            raise UsageError(f"unknown subsampling '{self.subsampling}': choose one of {choices}")
        if self.format not in (None, *get_args(PictureFormat)):
            choices = ", ".join(get_args(PictureFormat))
            raise UsageError(f"unknown picture format '{self.format}': choose one of {choices}")
