"""Several photos on the page: a burst is used as one, what was straightened is said, the photo comes first."""

from pathlib import Path

from playwright.sync_api import Page, expect

from support.batches import rectified
from support.browser import drop, enter, saved, wait_for
from support.frame_pairs import Scene
from unshutter.photo import Photo

SAID = "#panel .said"
TALL = "node => node.getBoundingClientRect().height"


def _burst(folder: Path, count: int = 3) -> list[Path]:
    scene = Scene(speed=(20, 3))
    photos = [folder / f"{number}.png" for number in range(count)]
    for number, photo in enumerate(photos):
        Photo.from_array(scene.frame(number, 0.8)).save(photo)
    return photos


def test_a_burst_is_used_together(page: Page, tmp_path: Path) -> None:
    photos = _burst(tmp_path)
    drop(page, *photos)
    expect(page.locator("#advice")).to_contain_text("These three look like a burst")
    page.locator(".thumbnail").nth(1).click()
    page.get_by_role("button", name="Use them together").click()
    expect(page.locator(SAID)).to_contain_text("with the help of its neighbours")
    expect(page.locator("#neighbours .neighbour")).to_have_text([r"Before: 0.png×", "After: 2.png×"])
    expect(page.locator("#ratio")).to_have_value("0.5")
    expect(page.get_by_role("button", name="Use them together")).to_be_hidden()
    for number in (1, 2, 3):
        wait_for(page, number=number)
    neighbours = ("--before", photos[0], "--after", photos[2])
    assert saved(page) == rectified(photos[1], *neighbours)
    expect(page.locator("#neighbours")).to_contain_text("this is a usual value")
    page.locator("#ratio").fill("0.8")  # that of all three
    expect(page.locator("#ratio-number")).to_have_value("0.8")
    expect(page.locator("#neighbours")).not_to_contain_text("this is a usual value")
    page.locator(".thumbnail").nth(0).click()
    expect(page.locator(SAID)).to_contain_text("with the help of its neighbours")
    expect(page.locator("#ratio")).to_have_value("0.8")


def test_other_photos_are_no_burst_and_what_was_straightened_is_said_and_shown(
    page: Page, photo: Path, tmp_path: Path
) -> None:
    with page.expect_response("**/api/bursts") as response:
        drop(page, _burst(tmp_path, 1)[0], photo)
        wait_for(page, number=2)
    assert response.value.json() == []
    expect(page.get_by_role("button", name="Use them together")).to_be_hidden()
    wait_for(page, "alone", number=1)
    page.get_by_role("button", name="1 of 2 was straightened: see it").click()
    expect(page.locator("#name")).to_have_text(photo.name)
    expect(page.locator("#thumbnails li:visible")).to_have_count(1)


def test_a_photo_that_was_only_levelled_is_levelled(street: Page, photo: Path) -> None:
    street.get_by_label("Leave this photo alone").check()
    wait_for(street, "alone")
    street.locator("#roll-deg").evaluate("node => { for (let at = node; at; at = at.parentElement) at.open = true; }")
    enter(street, "#roll-deg", "2")
    street.locator("#upright").select_option("level")
    expect(street.locator(SAID)).to_contain_text("Levelled by")
    wait_for(street, "changed")
    expect(street.locator(".thumbnail .state")).to_have_text("levelled")
    expect(street.locator(".thumbnail")).to_have_attribute("data-sure", "")


def test_the_photo_comes_first_and_saving_moves_nothing(page: Page, photo: Path, tmp_path: Path) -> None:
    page.set_viewport_size({"width": 1400, "height": 900})
    photos = _burst(tmp_path)
    drop(page, *photos, photo)
    expect(page.get_by_role("button", name="Use them together")).to_be_visible()
    wait_for(page, number=4)
    expect(page.locator("#thumbnails")).to_be_visible()
    assert page.locator("#stage").evaluate(TALL) >= 450
    save = page.get_by_role("button", name="Save this photo")
    place = save.bounding_box()
    page.locator(".thumbnail").nth(3).click()
    expect(page.locator("#candidates")).to_be_visible()
    assert save.bounding_box() == place
    box = page.locator("#stage").bounding_box()
    with page.expect_download():
        save.click()
    expect(page.locator("#notice")).to_be_visible()
    assert save.bounding_box() == place and page.locator("#stage").bounding_box() == box
