"""Options as frozen dataclasses, one for each subject, validated on creation.

The Python API, the command line, batches and their workers pass these values on unchanged. A field's ``help`` is shown
by ``unshutter COMMAND --help``; its flag is its name with dashes. To add an option, add a field here and use it
where the work is done.

Nothing here imports NumPy, because the photo starts being decoded before that.
"""

from unshutter.options.camera import (
    DEFAULT_ESTIMATOR,
    MOST_ROLL_DEG,
    MOST_TILT_DEG,
    Camera,
    CameraKeywords,
    Find,
    check_focal,
)
from unshutter.options.description import Names, check_time, option
from unshutter.options.neighbours import Clock, ClockKeywords, FrameModel, Neighbours, check_ratio, model_for
from unshutter.options.picture import (
    MIN_CONFIDENCE,
    MOST_STRENGTH,
    Edges,
    PictureFormat,
    Reference,
    Save,
    Subsampling,
    Undo,
    UndoKeywords,
    check_edges,
    check_strength,
)
from unshutter.options.rectify import Rectify
from unshutter.options.run import MAX_PIXELS, Run

__all__ = [
    "DEFAULT_ESTIMATOR",
    "MAX_PIXELS",
    "MIN_CONFIDENCE",
    "MOST_ROLL_DEG",
    "MOST_STRENGTH",
    "MOST_TILT_DEG",
    "Camera",
    "CameraKeywords",
    "Clock",
    "ClockKeywords",
    "Edges",
    "Find",
    "FrameModel",
    "Names",
    "Neighbours",
    "PictureFormat",
    "Rectify",
    "Reference",
    "Run",
    "Save",
    "Subsampling",
    "Undo",
    "UndoKeywords",
    "check_edges",
    "check_focal",
    "check_ratio",
    "check_strength",
    "check_time",
    "model_for",
    "option",
]
