"""Candidates side by side, on the page in a real browser: the photo as it is, and what else it could be."""

import json
import re
import zipfile
from pathlib import Path

from playwright.sync_api import Page, expect

from support import clips
from support.batches import rectified
from support.browser import drop, saved, wait_for
from support.motion_photos import item, motion_photo, packet
from unshutter import RowMotion
from unshutter.motion.warp import distort_pixels
from unshutter.photo import Photo

STILL = "as it is"
SAID = "#panel .said"


def _drawn(page: Page, number: int) -> bool:
    """Whether the small picture of a candidate, from 1, has more than one colour."""
    return page.locator(f"#candidates button:nth-child({number}) canvas").evaluate(
        """canvas => {
            const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
            return canvas.width > 40 && new Set(data.filter((_, k) => k % 4 === 0)).size > 8;
        }"""
    )


def test_one_click_takes_a_candidate_and_saving_takes_it_too(street: Page, photo: Path, tmp_path: Path) -> None:
    shown = street.locator("#candidates button")
    assert shown.count() > 1  # already, so that the picture does not move any more
    expect(shown.first).to_contain_text("as it is")
    expect(shown.nth(1)).to_contain_text("uneven motion")
    expect(shown.nth(1)).to_contain_text(" px · ")
    expect(street.locator("#candidates [aria-pressed=true]")).to_have_count(1)
    street.wait_for_function(
        "() => [...document.querySelectorAll('#candidates canvas')].every(node => node.width > 40)"
    )
    assert all(_drawn(street, number) for number in (1, 2))
    listed = street.evaluate("() => [...document.querySelectorAll('#candidates button')].map(node => node.textContent)")
    with street.expect_response("**/after?*candidate=*") as response:
        street.get_by_role("button", name=STILL).click()
    number = int(response.value.url.partition("candidate=")[2].partition("&")[0])
    wait_for(street, "alone")
    expect(street.locator(SAID)).to_contain_text("Left unchanged, as you asked.")
    expect(street.locator("#advice")).to_be_hidden()
    expect(street.get_by_role("button", name=STILL)).to_have_attribute("aria-pressed", "true")
    street.keyboard.press("2")
    wait_for(street, "changed")
    expect(shown.nth(1)).to_have_attribute("aria-pressed", "true")
    assert number <= len(listed)
    street.locator("#edges").select_option("keep")
    expect(street.locator(SAID)).to_contain_text("stay empty")
    wait_for(street)
    assert saved(street) == rectified(photo, "--edges", "keep")


def test_a_candidate_that_the_program_would_not_take(page: Page, tmp_path: Path, facade) -> None:
    """What is taken is straightened however unsure, and saved as the command line saves it."""
    photo, number = tmp_path / "leaning.png", 2
    sheared = distort_pixels(facade, RowMotion.from_polynomials([0, 6], [0], 420, 560))
    Photo.from_array(sheared[:, 40:-40].copy()).save(photo)
    drop(page, photo)
    wait_for(page, "alone")
    button = page.locator("#candidates button").nth(1)
    expect(button).to_be_visible()
    with page.expect_response(f"**/after?*candidate={number}*"):
        button.click()
    expect(button).to_have_attribute("aria-pressed", "true")
    wait_for(page, "changed")
    expect(page.locator(".sureness")).to_have_count(0)  # a person has said it
    assert saved(page) == rectified(photo, "--candidate", str(number))
    page.get_by_role("button", name="Reset").click()
    expect(button).to_have_attribute("aria-pressed", "false")


def test_all_photos_get_the_settings_but_not_the_candidate(page: Page, photo: Path, tmp_path: Path) -> None:
    (tmp_path / "other.jpg").write_bytes(photo.read_bytes())
    drop(page, photo, tmp_path / "other.jpg")
    wait_for(page, number=1)
    wait_for(page, number=2)
    page.get_by_role("button", name=STILL).click()
    wait_for(page, "alone")
    page.get_by_role("button", name="Use these settings for all photos").click()
    wait_for(page, "changed", number=2)
    with page.expect_download() as download:
        page.get_by_role("button", name="Save all (zip)").click()
        page.get_by_role("button", name="All, unchanged ones as they are").click()
    packed = zipfile.ZipFile(download.value.path())
    assert packed.read("street.jpg") == photo.read_bytes()
    assert packed.read("other.rectified.jpg") != photo.read_bytes()


def test_as_it_is_leaves_the_photo_alone_until_its_motion_is_found_another_way(street: Page) -> None:
    street.get_by_role("button", name=STILL).click()
    wait_for(street, "alone")
    alone = street.get_by_label("Leave this photo alone")
    expect(alone).to_be_checked()
    alone.uncheck()
    wait_for(street, "changed")
    expect(street.get_by_role("button", name=STILL)).to_have_attribute("aria-pressed", "false")
    street.get_by_role("button", name=STILL).click()
    wait_for(street, "alone")
    with street.expect_response("**/candidates?*moving=yes*") as response:
        street.get_by_label("The camera was moving").select_option("yes")
    assert "candidate=" not in response.value.url
    assert json.loads(response.value.text())[0]["taken"] in (True, False)
    wait_for(street, "changed")


def test_a_chance_in_words_and_not_next_to_unsure_in_per_cent(street: Page) -> None:
    """The likeliest motion may still be inexact: what is uncertain is explained, and the figure is a tooltip."""
    shown = street.locator("#candidates button")
    expect(shown.filter(has_text="likeliest")).to_have_count(1)
    expect(street.locator("#candidates")).not_to_contain_text("%")
    chances = street.locator("#candidates meter").evaluate_all("nodes => nodes.map(node => node.value)")
    assert len(chances) > 1 and 0 < max(chances) <= 1
    widths = street.locator("#candidates meter").evaluate_all("nodes => nodes.map(node => node.clientWidth)")
    assert max(widths) - min(widths) <= 1  # one scale for all bars
    expect(shown.nth(1)).to_have_attribute("title", re.compile(r"[Ii]t helps with a probability of .* %"))
    line = street.evaluate("async () => (await import('/page/words.js')).words.doubtedHelp")
    doubted = street.locator("[data-sure=tentative].sureness, [data-sure=doubtful].sureness").count()
    expect(street.locator("#panel .said").get_by_text(line)).to_have_count(doubted)
    street.get_by_label("The camera was moving").select_option("yes")  # then the chance of standing still says nothing
    expect(street.locator("#candidates")).not_to_contain_text("likeliest")
    expect(street.locator("#candidates meter")).to_have_count(0)


def test_why_the_video_inside_a_photo_says_nothing(page: Page, facade, tmp_path: Path) -> None:
    video = clips.write(tmp_path / "video.mp4", clips.standing(3)).read_bytes()
    said = packet(item("Primary", 0) + item("MotionPhoto", len(video), "video/mp4"), 'Cam:MotionPhoto="1"')
    (tmp_path / "live.jpg").write_bytes(motion_photo(facade, said, video))
    drop(page, tmp_path / "live.jpg")
    wait_for(page, "alone")
    line = "Judged by the photo alone, since the video inside it is too short."
    expect(page.locator(SAID)).to_contain_text(line)
    page.locator("#advanced summary").click()
    page.get_by_label("Do not use the video inside the photo").check()
    expect(page.locator(SAID)).not_to_contain_text(line)
