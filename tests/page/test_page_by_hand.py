"""By hand, on the page in a real browser: lines that are drawn, sliders, and what a declined photo offers."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, Route, expect

from support.browser import drop, enter, wait_for
from support.covering import thorough
from support.frame_pairs import Scene
from support.tagged_files import exif_blob
from unshutter.photo import Photo

SAID = "#panel .said"


@pytest.fixture
def grey(tmp_path: Path) -> Path:
    """A photo that shows nothing."""
    Photo.from_array(np.full((420, 560, 3), 128, np.uint8)).save(tmp_path / "grey.png")
    return tmp_path / "grey.png"


@pytest.fixture
def declined(page: Page, grey: Path) -> Page:
    """The page with that photo."""
    drop(page, grey)
    wait_for(page, "alone")
    return page


@pytest.fixture
def still_facade(tmp_path: Path, facade_canvas: np.ndarray) -> Path:
    """A photo of straight lines, by a camera that stood still."""
    Photo.from_array(facade_canvas[120:480, 120:620].copy()).save(tmp_path / "facade.png")
    return tmp_path / "facade.png"


def _drag(page: Page, start: tuple[float, float], end: tuple[float, float]) -> None:
    """With the mouse, between two places of the picture, as shares of its sides."""
    box = page.locator(".compare").bounding_box()
    assert box is not None
    at = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in (start, end)]
    page.mouse.move(*at[0])
    page.mouse.down()
    page.mouse.move(*at[1], steps=3)
    page.mouse.up()


def _draw(page: Page, kind: str) -> None:
    if not page.locator("#by-hand").evaluate("node => node.open"):
        page.locator("#by-hand summary").click()
    with page.expect_response("**/segments*"):
        page.locator(f"#tool-{kind}").click()


def _lines(page: Page) -> list[list[float]]:
    """The points of the lines that are drawn."""
    texts = page.locator(".drawn polyline:not(.edge)").evaluate_all(
        "nodes => nodes.map(node => node.getAttribute('points'))"
    )
    return [[float(value) for value in text.replace(" ", ",").split(",")] for text in texts]


# ---- a declined photo ------------------------------------------------------------------------------------


def test_a_declined_photo_says_why_and_offers_next_steps(declined: Page) -> None:
    expect(declined.locator(SAID)).to_contain_text("Left unchanged: only 0 straight lines were found.")
    expect(declined.locator("#advice")).not_to_contain_text("straight lines")  # the reason is said once
    expect(declined.locator("#advice")).to_contain_text("may be perspective")
    expect(declined.locator(".handle")).to_be_hidden()  # there are no two halves
    expect(declined.get_by_role("button", name="Save this photo")).to_be_disabled()
    expect(declined.get_by_text("There is nothing to save: the photo is unchanged.")).to_be_visible()
    expect(declined.get_by_role("button", name="It moved somehow")).to_have_count(0)
    declined.get_by_role("button", name="Add the frame before or after").click()
    expect(declined.get_by_text("Taken before…")).to_be_visible()
    declined.get_by_role("button", name="By hand…").click()
    expect(declined.locator("#tool-lean")).to_be_focused()
    expect(declined.locator("#tool-lean")).to_have_attribute("aria-pressed", "true")  # the simplest tool is in the hand


def test_a_photo_with_lines_can_be_tried_as_if_the_camera_moved(page: Page, still_facade: Path) -> None:
    drop(page, still_facade)
    wait_for(page, "alone")
    with page.expect_response("**/after?*moving=yes*"):
        page.get_by_role("button", name="It moved somehow").click()
    wait_for(page, "alone")
    expect(page.get_by_role("button", name="It moved somehow")).to_have_count(0)
    expect(page.locator("#advice")).to_contain_text(
        "Tried as if the camera moved: the photo still does not show it clearly."
    )


def test_an_answer_that_comes_while_an_offer_is_pressed_does_not_lose_the_click(page: Page, still_facade: Path) -> None:
    drop(page, still_facade)
    wait_for(page, "alone")
    page.get_by_role("button", name="It moved somehow").hover()
    page.mouse.down()
    with page.expect_response("**/after?*strength=0.9*"):
        page.locator("#strength-number").evaluate("n => { n.value = 90; n.dispatchEvent(new Event('change')) }")
    page.wait_for_timeout(300)  # until the answer has been read and shown
    with page.expect_request("**/after?*moving=yes*"):
        page.mouse.up()


def test_a_wrong_neighbour_leaves_the_photo_usable(street: Page, photo: Path, tmp_path: Path) -> None:
    Photo.from_array(Scene().frame(0, 0.8)).save(tmp_path / "other.png")  # of another size
    street.set_input_files("#choose-after", tmp_path / "other.png")
    expect(street.locator("#advice")).to_contain_text(
        re.compile(r"The neighbour frame cannot be used: it has \d+ × \d+ px and the photo \d+ × \d+ px")
    )
    wait_for(street, "changed")
    expect(street.locator(SAID)).to_contain_text("Straightened: some places moved by up to")
    street.get_by_role("button", name="Leave them out").click()
    expect(street.locator("#advice")).to_be_hidden()
    wait_for(street, "changed")


# ---- lines -----------------------------------------------------------------------------------------------


def test_upright_lines_straighten_what_the_program_declines(declined: Page) -> None:
    _draw(declined, "upright")
    before = declined.locator(".compare").bounding_box()
    for x in (0.2, 0.7):
        with declined.expect_response("**/after?*lines=*"):
            _drag(declined, (x, 0.1), (x + 0.06, 0.9))
    assert np.allclose(_lines(declined), [[0.2, 0.1, 0.26, 0.9], [0.7, 0.1, 0.76, 0.9]], atol=0.01)
    wait_for(declined, "changed")
    expect(declined.locator(SAID)).to_contain_text("Straightened by hand")
    expect(declined.locator(".thumbnail .state")).to_have_text("straightened by hand")
    declined.wait_for_function(
        "() => Number(document.querySelector('#lean-number').value) > 2"
    )  # the answer to both lines
    assert declined.locator(".compare").bounding_box() == before  # the picture does not move under the pointer
    declined.keyboard.press("Escape")
    expect(declined.locator(".handle")).to_be_visible()  # before and after, side by side again
    declined.get_by_role("button", name="Remove upright line 1").click()
    declined.get_by_role("button", name="Remove upright line 1").click()
    wait_for(declined, "alone")


def test_a_line_is_moved_by_its_ends_with_mouse_and_keys(declined: Page) -> None:
    _draw(declined, "level")
    _drag(declined, (0.1, 0.5), (0.9, 0.5))
    expect(declined.locator(".end")).to_have_count(2)
    end = declined.get_by_role("button", name="Point 2 of line 1, level line")
    end.hover()  # once it no longer moves
    box = end.bounding_box()
    assert box is not None
    declined.mouse.down()
    declined.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2 + 40, steps=3)
    declined.mouse.up()
    dragged = _lines(declined)[0][3]
    assert dragged > 0.53
    end.press("ArrowUp")
    assert _lines(declined)[0][3] == pytest.approx(dragged - 0.002, abs=1e-6)
    expect(end).to_be_focused()
    end.press("Delete")
    expect(declined.locator(".end")).to_have_count(0)
    declined.locator("#tool-straight").focus()
    declined.keyboard.press("Enter")  # without a mouse, a line is put in the middle
    expect(declined.locator(".end")).to_have_count(3)


def test_an_answer_that_comes_while_an_end_is_dragged_does_not_drop_it(declined: Page) -> None:
    _draw(declined, "level")
    late: list[Route] = []
    declined.route("**/after?*lines=*", lambda route: late.append(route))
    with declined.expect_request("**/after?*lines=*"):
        _drag(declined, (0.1, 0.5), (0.9, 0.5))
    end = declined.get_by_role("button", name="Point 2 of line 1, level line")
    end.hover()
    box = end.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    declined.mouse.down()
    declined.mouse.move(x, y + 20, steps=2)
    with declined.expect_response("**/after?*lines=*"):
        late.pop(0).continue_()
    wait_for(declined, "alone")
    declined.unroute("**/after?*lines=*")
    declined.mouse.move(x, y + 60, steps=3)
    declined.mouse.up()
    assert _lines(declined)[0][3] > 0.55


def test_ends_snap_to_segments(street: Page) -> None:
    with street.expect_response("**/segments*") as response:
        street.locator("#by-hand summary").click()
        street.locator("#tool-upright").click()
    segments = response.value.json()["before"]
    x1, y1, x2, y2 = max(segments, key=lambda s: abs(s[3] - s[1]) - abs(s[2] - s[0]))  # the longest upright one
    response.value.finished()
    street.evaluate(
        "() => new Promise((done) => setTimeout(done, 300))"
    )  # on the page's clock: the answer has been read
    x, y, slope = (x1 + x2) / 2, (y1 + y2) / 2, (x2 - x1) / (y2 - y1)
    _drag(street, (x - 0.03 * slope + 0.004, y - 0.03), (x + 0.03 * slope + 0.004, y + 0.03))
    drawn = _lines(street)[0]
    off = [at[0] - (x + slope * (at[1] - y)) for at in (drawn[:2], drawn[2:])]
    assert off == pytest.approx([0, 0], abs=5e-4)


def test_by_touch(declined: Page) -> None:
    _draw(declined, "upright")
    box = declined.locator(".compare").bounding_box()
    assert box is not None
    touch = declined.context.new_cdp_session(declined)
    for kind, points in (
        ("touchStart", [(0.3, 0.2)]),
        ("touchMove", [(0.32, 0.5)]),
        ("touchMove", [(0.34, 0.8)]),
        ("touchEnd", []),
    ):
        at = [{"x": box["x"] + x * box["width"], "y": box["y"] + y * box["height"]} for x, y in points]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": at})
    expect(declined.locator(".end")).to_have_count(2)
    assert np.allclose(_lines(declined)[0], [0.3, 0.2, 0.34, 0.8], atol=0.02)


def test_the_result_and_a_loupe_are_shown_while_an_end_is_dragged(declined: Page) -> None:
    _draw(declined, "upright")
    with declined.expect_response("**/after?*lines=*"):
        _drag(declined, (0.3, 0.1), (0.36, 0.9))
    wait_for(declined, "changed")
    inset, picture = declined.locator(".layer.after"), declined.locator(".compare")
    assert 0.2 < inset.bounding_box()["width"] / picture.bounding_box()["width"] < 0.4  # type: ignore[index]
    end = declined.get_by_role("button", name="Point 2 of line 1, upright line")
    end.hover()
    box = end.bounding_box()
    assert box is not None
    declined.mouse.down()
    with declined.expect_response("**/after?*lines=*draft=1*"):
        declined.mouse.move(box["x"] - 30, box["y"], steps=3)
    expect(declined.locator(".loupe")).to_be_visible()
    assert "blob:" in declined.locator(".loupe").evaluate("node => node.style.backgroundImage")
    declined.mouse.up()
    expect(declined.locator(".loupe")).to_be_hidden()
    wait_for(declined, "changed")


# ---- pulled ----------------------------------------------------------------------------------------------


@pytest.fixture
def pole(tmp_path: Path) -> Path:
    """A photo of a white pole that stands upright."""
    pixels = np.full((420, 560, 3), 90, np.uint8)
    pixels[:, 276:284] = 255
    Photo.from_array(pixels).save(tmp_path / "pole.png")
    return tmp_path / "pole.png"


def _pole(page: Page, turned: bool = False) -> tuple[float, float]:
    """Where the pole is in the first and in the last rows of the result, as shares of its width; or in its columns."""
    first, last = page.locator(".layer.after img").evaluate(
        """async (image, turned) => {
            await image.decode();
            const canvas = new OffscreenCanvas(280, 210), context = canvas.getContext("2d");
            if (turned) context.transform(0, 210 / 280, 280 / 210, 0, 0, 0);
            context.drawImage(image, 0, 0, 280, 210);
            const at = (row) => {
                const { data } = context.getImageData(0, row, 280, 1);
                return [...Array(280).keys()].reduce((best, x) => (data[4 * x] > data[4 * best] ? x : best), 0) / 280;
            };
            return [at(3), at(206)];
        }""",
        turned,
    )
    return first, last


@pytest.mark.parametrize("at", [0.2, thorough(0.8)])
def test_the_photo_leans_as_it_is_pulled(page: Page, pole: Path, at: float) -> None:
    """What is under the pointer goes with it: at once, and in the answer."""
    drop(page, pole)
    wait_for(page, "alone")
    page.locator("#by-hand summary").click()
    page.locator("#tool-lean").click()
    expect(page.locator(".grid")).to_be_visible()
    box = page.locator(".compare").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + at * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.54, box["y"] + at * box["height"], steps=3)
    assert "matrix" in page.locator(".layer.after img").evaluate("node => node.style.transform")  # no answer is needed
    page.mouse.up()
    wait_for(page, "changed")
    expect(page.locator(SAID)).to_contain_text("Straightened by hand")
    assert page.locator(".layer.after img").evaluate("node => node.style.transform") == ""
    first, last = _pole(page)
    assert (first - last if at < 0.5 else last - first) > 0.04
    lean = page.locator("#lean-number")
    found = float(lean.input_value())
    page.keyboard.press("ArrowRight")
    expect(lean).to_have_value(f"{found + 0.1:.1f}")
    page.keyboard.press("Control+z")
    expect(lean).to_have_value(f"{found:.1f}")
    page.get_by_role("button", name="Done").click()
    expect(page.locator(".handle")).to_be_visible()


@pytest.mark.parametrize("orientation", [thorough(3), thorough(5), 6, thorough(8)])
def test_a_photo_that_is_stored_on_its_side_leans_the_way_it_is_pulled(
    page: Page, tmp_path: Path, orientation: int
) -> None:
    """A pole along the readout: its end that is pulled down, or to the right, goes there."""
    pixels = np.full((420, 560, 3), 90, np.uint8)
    pixels[:, 276:284] = 255
    Image.fromarray(pixels).save(tmp_path / "pole.jpg", exif=exif_blob(orientation))
    drop(page, tmp_path / "pole.jpg")
    wait_for(page, "alone")
    page.locator("#by-hand summary").click()
    page.locator("#tool-lean").click()
    turned = orientation > 4
    _drag(page, (0.1, 0.5) if turned else (0.5, 0.1), (0.1, 0.54) if turned else (0.54, 0.1))
    wait_for(page, "changed")
    pulled, other = _pole(page, turned)
    assert pulled - other > 0.04


def test_bend_and_turn_are_pulled_too(page: Page, pole: Path) -> None:
    drop(page, pole)
    wait_for(page, "alone")
    page.locator("#by-hand summary").click()
    for name in ("bend", "turn"):
        page.locator(f"#tool-{name}").click()
        with page.expect_response("**/after?*draft=1*"):
            _drag(page, (0.5, 0.4), (0.53, 0.4))
        wait_for(page, "changed")
        assert abs(float(page.locator(f"#{name}-number").input_value())) > 1


# ---- numbers ---------------------------------------------------------------------------------------------


def test_numbers_start_at_what_was_found(street: Page) -> None:
    street.locator("#by-hand summary").click()
    lean = street.locator("#lean-number")
    found = float(lean.input_value())
    assert found != 0
    lean.fill("3")
    lean.press("Enter")
    expect(street.locator(SAID)).to_contain_text("Straightened by hand")
    expect(lean).to_have_value("3")
    enter(street, "#turn-number", "1.5")
    street.get_by_role("button", name="Remove all of it").click()
    expect(lean).to_have_value(f"{found:.1f}")
    expect(street.locator(SAID)).to_contain_text("Straightened: some places")


def test_straighten_it_even_if_that_is_not_sure(page: Page, server, tmp_path: Path, basilica) -> None:
    """What the tick box asks for is done, and the numbers show it."""
    Photo.from_array(basilica[0]).save(tmp_path / "basilica.png")
    drop(page, tmp_path / "basilica.png")
    wait_for(page, "changed|alone")
    with page.expect_response("**/after?*min-confidence=0*") as response:
        page.get_by_label("Straighten it even if unsure").check()
    assert json.loads(response.value.headers["unshutter-result"])["changed"]
    wait_for(page, "changed")


def test_steps_by_hand_are_undone_one_by_one(declined: Page) -> None:
    undo = declined.get_by_role("button", name="Undo", exact=True)
    _draw(declined, "upright")
    expect(undo).to_be_disabled()
    for x in (0.2, 0.7):
        with declined.expect_response("**/after?*lines=*"):
            _drag(declined, (x, 0.1), (x + 0.06, 0.9))
    declined.get_by_role("button", name="Done").click()
    expect(declined.locator(".handle")).to_be_visible()  # before and after again
    enter(declined, "#lean-number", "4")
    declined.get_by_role("button", name="Remove all of it").click()
    wait_for(declined, "alone")
    for lines, lean in ((2, True), (2, False), (1, False)):
        declined.locator("#stage").focus()
        declined.keyboard.press("Control+z")
        expect(declined.locator(".lines-list li")).to_have_count(lines)
        number = expect(declined.locator("#lean-number"))
        number.to_have_value("4.0") if lean else number.not_to_have_value("4.0")
        wait_for(declined, "changed")
    undo.click()
    wait_for(declined, "alone")
    expect(undo).to_be_disabled()
