"""What is asked of several methods."""

import numpy as np

import unshutter
from unshutter import Motion, RowMotion
from unshutter_lab.evaluation.metrics import motion_error


def check_photo_is_rectified(name: str, picture: np.ndarray, truth: Motion) -> None:
    """Most of a strong motion is found, and the method says how sure it is."""
    found = unshutter.estimate(picture, estimator=name)
    nothing = motion_error(RowMotion.zero(truth.height, truth.width), truth).epe
    assert motion_error(found.motion, truth).epe < 0.4 * nothing
    assert found.confidence is not None
    assert 0 < found.confidence < 1
    assert found.motion.tx_px[0] == found.motion.rz_rad[0] == 0


def check_facade_is_left_alone(name: str, facade: np.ndarray) -> None:
    """A straight picture is seen to be straight."""
    found = unshutter.estimate(facade, estimator=name)
    assert np.abs(found.motion.tx_px).max() * 256 / found.motion.height < 1
