"""What the page offers for photos that lean, and for those of which a crop leaves little."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from support.browser import drop, enter, wait_for
from support.tagged_files import exif_blob
from unshutter.photo import Photo

SAID = "#panel .said"


@pytest.fixture
def askew(tmp_path: Path, facade: np.ndarray) -> Path:
    """A photo by a camera held askew."""
    height, width = facade.shape[:2]
    turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), 3, 1.15)  # larger, so that no corner is empty
    Photo.from_array(cv2.warpAffine(facade, turn, (width, height))).save(tmp_path / "askew.png")
    return tmp_path / "askew.png"


def test_a_photo_that_leans_is_levelled_by_as_much_as_is_offered(page: Page, askew: Path) -> None:
    drop(page, askew)
    wait_for(page, "alone")
    offer = page.locator("#adviceLevel")
    said = re.fullmatch(r"Level it: turn it by (\d\.\d°) ± \d\.\d°", offer.text_content() or "")
    assert said is not None
    angle = said[1]
    offer.click()
    wait_for(page, "changed")
    expect(page.locator(SAID)).to_contain_text(f"Levelled by {angle}.")
    expect(page.locator("#upright")).to_have_value("level")


def test_a_leaning_photo_by_a_camera_without_rolling_shutter_is_only_levelled(page: Page, askew: Path) -> None:
    """Nothing is asked that could not change it, and nothing else is said than what is offered."""
    camera = exif_blob(1, **{"271": "Canon", "272": "Canon PowerShot A70"})
    Image.open(askew).save(askew.with_suffix(".jpg"), exif=camera, quality=95)
    drop(page, askew.with_suffix(".jpg"))
    wait_for(page, "alone")
    expect(page.locator(SAID)).to_contain_text("a Canon PowerShot A70 exposes all rows at once")
    expect(page.locator("#advice p")).to_have_text("The camera seems to have been held askew.")
    expect(page.locator("#advice button")).to_have_text(re.compile("Level it"))


def test_a_crop_that_leaves_little_asks_to_look(street: Page) -> None:
    street.locator("#by-hand summary").click()
    for tool, value, little in (("lean", "10", False), ("lean", "30", False), ("bend", "20", True)):
        enter(street, f"#{tool}-number", value)
        left = "[1-5]" if little else "[6-9]"
        expect(street.locator(SAID)).to_contain_text(re.compile(rf"Cut down to {left}\d %"))
        look = expect(street.locator(SAID))
        look.to_contain_text("Please look: much is cut off") if little else look.not_to_contain_text("Please look")
    street.locator("#edges").select_option("keep")
    expect(street.locator(SAID)).not_to_contain_text("Please look")
