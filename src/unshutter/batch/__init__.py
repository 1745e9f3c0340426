"""The same job for many files: which files, where the results go, what went wrong, how far it is."""

from unshutter.batch.estimating import estimate_files
from unshutter.batch.inputs import PHOTO_SUFFIXES, RECTIFIED, find_photos
from unshutter.batch.rectifying import BatchOptions, rectify_files
from unshutter.batch.synthesizing import synthesize_files
from unshutter.batch.work import RectifyOptions

__all__ = [
    "PHOTO_SUFFIXES",
    "RECTIFIED",
    "BatchOptions",
    "RectifyOptions",
    "estimate_files",
    "find_photos",
    "rectify_files",
    "synthesize_files",
]
