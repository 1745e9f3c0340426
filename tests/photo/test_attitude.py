"""How the camera was held, as phones, gimbals and programs wrote it."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.camera_files import dng, heic, linear, soft
from support.drawn_photos import drawn
from support.fuzzing import damaged, thorough
from support.maker_notes import apple, exif_with_note, photo_with_note
from support.tagged_files import ATTRIBUTES, ELEMENTS, jpeg_of_drone
from unshutter.options import Camera
from unshutter.orientation import Orientation, ScanDirection
from unshutter.photo import Photo, exposure, readout_times
from unshutter.photo.attitude import Attitude, attitude_of_xmp, of_photo
from unshutter.photo.exif import add_to_tiff
from unshutter.single.estimator import View

_QUARTERS = {1: 0, 8: 1, 3: 2, 6: 3}  # counter-clockwise turns that set stored pixels upright, by orientation


def _vector(roll: float, tilt: float, orientation: int) -> tuple[float, float, float]:
    """Apple's vector for a camera held so, worked out from the picture: gravity there, turned back into the sensor."""
    r, t = np.radians([roll, tilt])
    # a camera turned clockwise sees what hangs swing counter-clockwise, to the right; one that looks up has it behind
    right, down, forward = np.sin(r) * np.cos(t), np.cos(r) * np.cos(t), -np.sin(t)
    for _ in range(_QUARTERS[orientation]):  # undo a counter-clockwise turn: clockwise
        right, down = -down, right
    return -down, -right, -forward


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
@pytest.mark.parametrize(("roll", "tilt"), [(0, 0), (10, 0), (-7, 20), (3, -40)])
def test_apples_vector_tells_roll_and_tilt_in_every_orientation(roll: float, tilt: float, orientation: int) -> None:
    photo = photo_with_note(apple(_vector(roll, tilt, orientation)), "Apple", orientation)
    held = View(photo).attitude()
    assert held.source == "accelerometer (Apple)"
    assert (held.roll_deg, held.tilt_deg) == (pytest.approx(roll, abs=0.01), pytest.approx(tilt, abs=0.01))
    assert View(photo).scan_direction is ScanDirection.TOP_TO_BOTTOM


def test_a_real_vector_of_a_phone_held_upright() -> None:
    """Of an iPhone XR, orientation 6; the columns of a church in the picture stand as it says."""
    held = photo_with_note(apple((-0.017941, -1.010896, -0.067160)), "Apple", 6).attitude
    assert held is not None
    assert held.roll_deg == pytest.approx(-1.02, abs=0.01) and held.tilt_deg == pytest.approx(-3.80, abs=0.01)


@pytest.mark.parametrize(("held_as", "readout"), [(6, "right-to-left"), (8, "left-to-right")])
def test_pixels_that_software_has_set_upright_were_read_sideways(held_as: int, readout: str) -> None:
    photo = photo_with_note(apple(_vector(4, -20, held_as)), "Apple", 1, height=160, width=120)
    view = View(photo)
    assert view.scan_direction == readout
    assert view.attitude_deg() == (pytest.approx(4, abs=0.01), pytest.approx(-20, abs=0.01))
    # the scene's top is where it is in the pixels as the sensor had them
    assert view.up == View(photo_with_note(apple(_vector(4, -20, held_as)), "Apple", held_as)).up
    assert View(photo, Camera(readout="top-to-bottom")).scan_direction is ScanDirection.TOP_TO_BOTTOM


@pytest.mark.parametrize(
    ("vector", "orientation", "lens", "size"),
    [
        ((-1.57, 0, 0), 1, "", (120, 160)),  # no gravity
        ((0, 0, 0), 1, "", (120, 160)),
        ((1, 0, 0), 1, "", (120, 160)),  # upside down, and the tag does not say so
        ((0, -1, 0), 1, "", (120, 160)),  # upright phone, picture that lies across
        ((0, -1, 0), 1, "", (120, 120)),  # a square shows nothing
        ((-0.6, -0.8, 0), 1, "", (160, 120)),  # in between
        ((0, -0.4, 0.9165), 1, "", (160, 120)),  # mostly down: which way up is not clear
        ((-1, 0, 0), 2, "", (120, 160)),  # mirrored
        ((-1, 0, 0), 1, "iPhone 12 front camera 2.71mm f/2.2", (120, 160)),
    ],
)
def test_what_is_in_doubt_is_not_told(vector: tuple, orientation: int, lens: str, size: tuple[int, int]) -> None:
    photo = photo_with_note(apple(vector), "Apple", orientation, lens, *size)
    assert photo.attitude is None
    assert View(photo).scan_direction is ScanDirection.TOP_TO_BOTTOM and View(photo).attitude_deg() == (None, None)


def test_a_phone_that_looks_straight_down_tells_its_tilt_only() -> None:
    assert photo_with_note(apple((-0.05, 0.03, -1)), "Apple").attitude == Attitude(
        None, pytest.approx(-86.66, abs=0.02), "accelerometer (Apple)"
    )


@pytest.mark.parametrize("kind", ["heic", "dng"])
def test_phones_other_formats_tell_it_too(kind: str) -> None:
    blob = exif_with_note(apple(_vector(2, 5, 1)), "Apple")
    if kind == "heic":
        file = io.BytesIO(heic(soft(), exif=blob))
    else:
        file = io.BytesIO(dng(linear(soft())))
        assert add_to_tiff(file, blob, 120, 160)
    photo = Photo.from_bytes(file.getvalue())
    assert photo.format == ("heic" if kind == "heic" else "raw")
    held = photo.attitude
    assert held is not None
    assert (held.roll_deg, held.tilt_deg) == (pytest.approx(2, abs=0.01), pytest.approx(5, abs=0.01))


@pytest.mark.parametrize("cut", [15, 17, 20, 26, 30])
def test_a_note_that_is_cut_short_says_nothing(cut: int) -> None:
    assert photo_with_note(apple((-1, 0, 0))[:cut], "Apple").attitude is None


@thorough
@given(data=st.data())
def test_damaged_metadata_say_nothing_or_something(data: st.DataObject) -> None:
    """Whatever is wrong with EXIF or a maker's note: no error, and angles and times that can be."""
    whole = photo_with_note(apple((-1, 0, 0.1)), "Apple")._metadata.exif
    assert whole is not None
    blob = data.draw(st.composite(damaged)(whole))
    told = of_photo(blob, None, Orientation.NORMAL, 120, 160)
    assert told is None or (abs(told.roll_deg or 0) <= 45 and abs(told.tilt_deg or 0) <= 90)
    time = exposure.time_s(blob)
    assert time is None or 0 < time <= 3600
    exposure.is_merged(blob)
    assert readout_times.readout_time(blob).longest_s <= 0.3


# ---- XMP -------------------------------------------------------------------------------------------------


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
    assert photo.attitude == (known and Attitude(*known, "gimbal (DJI)"))
    assert View(photo).attitude_deg() == (known or (None, None))
    mixed = View(photo, Camera(tilt_deg=3.0)).attitude()
    assert (mixed.roll_deg, mixed.tilt_deg) == (known[0] if known else None, 3.0)
    assert mixed.source == ("given; gimbal (DJI)" if known else "given")


@pytest.mark.parametrize(
    ("packet", "held"),
    [
        (b'drone-parrot:CameraRollDegree="1.5" drone-parrot:CameraPitchDegree="-12"', (1.5, -12)),
        (b"<xmpDSA:RollAngle>-0.7</xmpDSA:RollAngle><xmpDSA:PitchAngle>2</xmpDSA:PitchAngle>", (-0.7, 2)),
        (b'GPano:PoseRollDegrees="3" GPano:PosePitchDegrees="4"', (3, 4)),
        (b'GPano:PoseRollDegrees="3" GPano:PosePitchDegrees="4" GPano:ProjectionType="equirectangular"', None),
        (b'Camera:Roll="0" Camera:Pitch="90"', (0, 0)),
        (b'Camera:Roll="0" Camera:Pitch="60"', (0, -30)),
        (b'Camera:Roll="5" Camera:Pitch="0"', (None, -85)),
        (b'Camera:Roll="5"', None),
        (b"", None),
    ],
)
def test_other_programs_xmp_is_read(packet: bytes, held: tuple | None) -> None:
    told = attitude_of_xmp(packet)
    expected = held and tuple(angle if angle is None else pytest.approx(angle) for angle in held)
    assert (told and (told.roll_deg, told.tilt_deg)) == expected


def test_a_photo_without_metadata_says_nothing() -> None:
    assert Photo.from_array(drawn()).attitude is None
    assert View(Photo.from_array(drawn())).attitude() == Attitude(None, None, "")
