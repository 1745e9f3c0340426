"""What a motion tells beside its rows: how far it reaches, and what was known of the photo when it was found."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

import unshutter
from support.drawn_photos import drawn, encoded
from support.maker_notes import apple
from support.tagged_files import EXIF
from unshutter import Finding, RowMotion, UnshutterError
from unshutter.motion import RotationMotion
from unshutter.motion.upright import Angle

_KNOWN = {"roll": Angle(1.5), "attitude_from": "level gauge (Acme)", "exposure_s": 0.004}


def _finding(**known) -> Finding:
    return Finding(RowMotion.from_polynomials([0, 3], [0, 0.01], 60, 80), **known)


def test_what_was_known_goes_through_the_file() -> None:
    finding = _finding(**_KNOWN)
    data = json.loads(finding.to_json())
    assert data["attitude"] == {"roll_deg": 1.5, "tilt_deg": None, "from": "level gauge (Acme)"}
    assert data["exposure_s"] == 0.004
    assert Finding.from_json(finding.to_json()) == finding == pickle.loads(pickle.dumps(finding))
    assert finding != _finding()
    assert finding.resized(120, 160).rereferenced("last").exposure_s == 0.004


def test_files_that_know_nothing_are_read() -> None:
    data = json.loads(_finding().to_json())
    assert "attitude" not in data and "exposure_s" not in data
    del data["largest_px"]
    assert Finding.from_json(json.dumps(data)) == _finding()


@pytest.mark.parametrize(
    "wrong",
    [
        {"attitude": 5},
        {"attitude": "up"},
        {"attitude": {"roll_deg": "up"}},
        {"attitude": {"stated": 3}},
        {"exposure_s": float("nan")},
    ],
)
def test_files_that_know_nonsense_are_refused(wrong: dict) -> None:
    data = json.loads(_finding().to_json()) | wrong
    with pytest.raises(UnshutterError):
        Finding.from_json(json.dumps(data))


def test_the_largest_displacement_is_that_of_the_farthest_corner() -> None:
    assert RowMotion.zero(60, 80).largest_px == 0
    assert RowMotion.from_polynomials([0, 3], [0], 60, 80).largest_px == pytest.approx(3)
    # the last row turns by 0.01 rad about the middle: its ends are hypot(39.5, 29.5) px away from that
    turned = RowMotion.from_polynomials([0], [0, 0.01], 60, 80)
    assert turned.largest_px == pytest.approx(0.01 * np.hypot(39.5, 29.5), rel=1e-4)
    assert json.loads(turned.to_json())["largest_px"] == pytest.approx(turned.largest_px, abs=1e-3)
    assert turned.scaled(0.5).largest_px == pytest.approx(turned.largest_px / 2, rel=1e-3)


def test_the_largest_displacement_of_rotations() -> None:
    turning = np.zeros((60, 3))
    turning[:, 1] = np.linspace(0, 0.02, 60)
    motion = RotationMotion(width=81, rotations=turning, focal_px=100)
    # of the last row, the end that it moves towards: tan(atan(40 / 100) + .02) in its own plane
    reach = 100 * np.tan(np.arctan(0.4) + 0.02) - 40
    assert motion.largest_px == pytest.approx(reach, rel=0.1)


def test_an_estimate_says_what_was_known_of_the_photo() -> None:
    tags = Image.Exif()
    tags.update({0x010F: "Apple", 0x0112: 1})
    tags.get_ifd(EXIF).update({0x829A: IFDRational(1, 250), 0x927C: apple((-1, 0, 0))})
    photo = encoded(drawn(96, 128), "JPEG", exif=tags.tobytes())
    found = unshutter.estimate(photo, estimator="none")
    assert (found.roll, found.tilt, found.attitude_from) == (Angle(0), Angle(0), "accelerometer (Apple)")
    assert found.exposure_s == pytest.approx(0.004)
    given = unshutter.estimate(photo, estimator="none", roll_deg=2, exposure_s=0.1)
    assert (given.roll, given.tilt, given.exposure_s) == (Angle(2, stated=True), Angle(0), 0.1)
    assert given.attitude_from == "given; accelerometer (Apple)"
    data = json.loads(given.to_json())
    assert data["attitude"]["stated"] == {"roll": True, "tilt": False}
    assert Finding.from_json(given.to_json()).roll == given.roll
    del data["attitude"]["stated"]  # as earlier versions wrote it
    assert Finding.from_json(json.dumps(data)).roll == Angle(2)
    bare = unshutter.estimate(drawn(96, 128), estimator="none")
    assert bare == replace(bare, roll=None, tilt=None, attitude_from="", exposure_s=None)
