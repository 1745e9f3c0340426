import math

import numpy as np
import pytest

from unshutter import View
from unshutter.options import Camera
from unshutter.photo import Photo
from unshutter.single.likelihood import ManhattanLikelihood, likelihood_of, segments_of
from unshutter.single.prior import LOG_FOCAL, ROLL, TILT


def test_a_photo_smaller_than_wanted_is_enlarged_without_a_shift(facade: np.ndarray) -> None:
    """The same straight picture in two sizes: verticals stay vertical, and where they are."""
    segments, size = segments_of(View(Photo.from_array(facade)))
    assert size == (768, 1024)
    longest = segments[np.argsort(-np.abs(segments[:, 3] - segments[:, 1]))][:8]
    np.testing.assert_allclose(longest[:, 0], longest[:, 2], atol=1 / 420)
    left = segments[:, 0] < 0
    mirrored, _ = segments_of(View(Photo.from_array(facade[:, ::-1].copy())))
    assert left.sum() == pytest.approx((mirrored[:, 0] > 0).sum(), abs=10)


def test_what_the_user_knows_is_believed(facade: np.ndarray) -> None:
    def told(camera: Camera) -> ManhattanLikelihood:
        return likelihood_of(View(Photo.from_array(facade), camera), np.array([[0.0, -0.1, 0.0, 0.1]]), (768, 1024))

    expected = told(Camera(focal_px=840.0, roll_deg=3.0, tilt_deg=-10.0)).prior.mean
    # a camera turned clockwise sees the scene turned the other way; 840 px are twice the height
    found = expected[[LOG_FOCAL, ROLL, TILT]]
    np.testing.assert_allclose(found, (math.log(2), -math.radians(3), -math.radians(10)))
    assert told(Camera()).known.roll is None
    assert told(Camera("left-to-right")).known.up == (1, 0)
