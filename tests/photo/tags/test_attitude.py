"""How the camera was held, as a drone's gimbal wrote it."""

import pytest

from support.drawn_photos import drawn
from support.tagged_files import ATTRIBUTES, ELEMENTS, jpeg_of_drone
from unshutter.estimators.base import View
from unshutter.options import Camera
from unshutter.photo import Photo


@pytest.mark.parametrize(
    ("roll", "tilt", "form", "known"),
    [
        ("+4.00", "-0.10", ATTRIBUTES, (4.0, -0.1)),
        ("-0.50", "-90.00", ELEMENTS, (-0.5, -90.0)),
        ("+180.00", "-90.00", ATTRIBUTES, (0.0, -90.0)),
        ("+70.00", "0", ATTRIBUTES, None),
        ("up", "0", ATTRIBUTES, None),
    ],
)
def test_a_drone_says_how_its_camera_was_held(
    roll: str, tilt: str, form: str, known: tuple[float, float] | None
) -> None:
    photo = Photo.from_bytes(jpeg_of_drone(drawn(), roll, tilt, form))
    assert photo.attitude_deg() == known
    assert View(photo).attitude_deg() == (known or (None, None))
    assert View(photo, Camera(tilt_deg=3.0)).attitude_deg() == (known[0] if known else None, 3.0)


def test_a_photo_without_xmp_says_nothing() -> None:
    assert Photo.from_array(drawn()).attitude_deg() is None
