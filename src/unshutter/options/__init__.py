"""Options as frozen dataclasses, one for each subject, validated on creation.

The Python API, the command line, batches and their workers pass these values on unchanged. A field's ``help`` is shown
by ``unshutter COMMAND --help``; its flag is its name with dashes. To add an option, add a field here and use it
where the work is done.

Nothing here imports NumPy, because the photo starts being decoded before that.
"""

# ruff: noqa: F401 (the room's face)

from unshutter.options.fields import Names, check_count, check_time, option
from unshutter.options.photo_options import (
    DEFAULT_ESTIMATOR,
    LEAST_GOOD_CROP,
    MIN_CONFIDENCE,
    MOST_ROLL_DEG,
    MOST_STRENGTH,
    MOST_TILT_DEG,
    USUAL_FOCAL,
    Camera,
    Clock,
    DecisionOptions,
    Edges,
    Find,
    FrameModel,
    Moving,
    Neighbours,
    PictureFormat,
    Reference,
    Save,
    Subsampling,
    Undo,
    Upright,
    check_edges,
    check_focal,
    check_ratio,
    check_strength,
    model_for,
)
from unshutter.options.rectify_options import MAX_PIXELS, Estimate, Rectify, Run
