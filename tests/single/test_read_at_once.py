"""Photos by cameras that expose all rows at once are left unchanged for that reason, whatever their pixels show."""

from io import BytesIO
from pathlib import Path

import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

import unshutter
from support.tagged_files import EXIF
from unshutter.cli import main
from unshutter.page.sentences import verdict_json
from unshutter.photo import Photo
from unshutter.reasons import Cause, Code

DEMO = Path(__file__).parents[2] / "examples" / "demo.jpg"  # distorted clearly
A70 = ("Canon", "Canon PowerShot A70")
SAID = "a Canon PowerShot A70 exposes all rows at once"


def photo_by(make: str, model: str, exposure: bool = True) -> bytes:
    """The distorted photo, as if that camera had taken it."""
    tags = Image.Exif()
    tags.update({0x010F: make, 0x0110: model})
    if exposure:
        tags.get_ifd(EXIF).update({0x829A: IFDRational(1, 30)})
    file = BytesIO()
    Image.open(DEMO).save(file, "JPEG", quality=95, exif=tags.tobytes())
    return file.getvalue()


@pytest.mark.parametrize("exposure", [True, False])
def test_the_certain_reason_comes_first(exposure: bool) -> None:
    result = unshutter.rectify(photo_by(*A70, exposure))
    assert not result.changed and str(result.reason) == SAID
    assert result.verdict.cause is Cause.NO_ROLLING_SHUTTER
    assert result.verdict.confidence is None and result.verdict.certainty is None
    shown = verdict_json(result.verdict)
    assert shown["reason"] == SAID and set(shown["advice"]) <= {"adviceLevel"}
    assert (shown["code"], shown["figures"]) == (Code.NO_ROLLING_SHUTTER, {"camera": "a Canon PowerShot A70"})


@pytest.mark.parametrize(("make", "model"), [("Apple", "iPhone 5s"), ("Acme", "One"), ("Canon", "Canon EOS D60")])
def test_the_same_photo_by_another_camera_is_judged_by_its_pixels(make: str, model: str) -> None:
    reason = unshutter.estimate(photo_by(make, model)).reason
    assert reason is None or reason.code is not Code.NO_ROLLING_SHUTTER
    assert unshutter.rectify(photo_by(make, model, exposure=False)).changed


def test_a_stated_readout_time_overrules_the_table() -> None:
    assert unshutter.rectify(photo_by(*A70, exposure=False), readout_ms=30).changed


@pytest.mark.parametrize(
    "asked", [{"moving": "yes"}, {"min_confidence": 0}, {"estimator": "manhattan"}, {"candidate": 2}]
)
def test_without_an_exposure_time_whoever_insists_gets_a_motion(asked: dict) -> None:
    assert unshutter.rectify(photo_by(*A70, exposure=False), **asked).changed
    if "candidate" not in asked:
        assert str(unshutter.rectify(photo_by(*A70), **asked).reason) == SAID


@pytest.mark.parametrize(
    ("make", "model", "named"),
    [
        (*A70, "a Canon PowerShot A70"),
        ("OLYMPUS OPTICAL CO.,LTD", "C720UZ", "an OLYMPUS C720UZ"),
        ("EASTMAN KODAK COMPANY", "KODAK DC3400 ZOOM DIGITAL CAMERA", "a KODAK DC3400 ZOOM DIGITAL CAMERA"),
        ("NIKON", "E990", "a NIKON E990"),
        ("Acme", "One\x1b[2J", "an Acme One\\x1b[2J"),
    ],
)
def test_cameras_have_names_for_a_sentence(make: str, model: str, named: str) -> None:
    assert Photo.from_bytes(photo_by(make, model)).camera_in_words() == named


def test_commands_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo = tmp_path / "a.jpg"
    photo.write_bytes(photo_by(*A70))
    out = tmp_path / "out.jpg"
    assert main(["rectify", str(photo), "-o", str(out)]) == 0
    assert capsys.readouterr().err.splitlines() == [f"{photo} left unchanged ({SAID})"]
    assert not out.exists() or out.read_bytes() == photo.read_bytes()
    assert main(["estimate", str(photo)]) == 0
    assert f"{photo}: no motion ({SAID})" in capsys.readouterr().out
