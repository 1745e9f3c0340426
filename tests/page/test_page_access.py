"""The page for those who hear it, use the keyboard alone, or a phone; and pictures before the program answers."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, Route, expect

from support import clips
from support.browser import SLOW_MS, drop, enter, wait_for
from support.covering import thorough
from support.page_server import Server
from unshutter.photo import Photo

AXE = Path(__file__).parents[2] / ".ci" / "script" / "node_modules" / "axe-core" / "axe.min.js"
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]
WINDOWS = {"wide": (1400, 900, "light"), "dark": (1400, 900, "dark"), "phone": (390, 844, "light")}


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Too short to show its readout time: nothing is searched for."""
    return clips.write(tmp_path_factory.mktemp("clips") / "walk.mp4", clips.moving(14)[1])


def _check(page: Page) -> list[str]:
    """What breaks the WCAG, A and AA, as far as axe-core sees it."""
    page.evaluate(AXE.read_text("utf-8"))
    found = page.evaluate("rules => axe.run({ runOnly: rules })", RULES)["violations"]
    return [f"{each['id']}: {node['target']} {node['failureSummary']}" for each in found for node in each["nodes"]]


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.skipif(not AXE.exists(), reason="axe-core is not installed: make script")
def test_nothing_breaks_the_wcag(
    chromium: Browser, server: Server, photo: Path, facade, walk, tmp_path, window
) -> None:
    width, height, scheme = WINDOWS[window]
    straight, bad = tmp_path / "straight.png", tmp_path / "bad.jpg"
    Photo.from_array(facade).save(straight)
    bad.write_bytes(b"no picture")
    size = {"width": width, "height": height}
    context = chromium.new_context(viewport=size, color_scheme=scheme, has_touch=width < 500)
    context.set_default_timeout(SLOW_MS)
    page = context.new_page()
    page.goto(server.link)
    found = {"empty": _check(page)}
    drop(page, photo, straight, bad, walk)
    for number, state in enumerate(("changed", "alone", "failed", "done"), start=1):
        wait_for(page, state, number)
    found["changed"] = _check(page)
    for section in ("#by-hand", "#neighbours", "#advanced"):
        page.locator(f"{section} summary").first.click()
    page.locator("#tool-upright").press("Enter")
    expect(page.locator(".end")).to_have_count(2)
    found["by hand"] = _check(page)
    page.keyboard.press("Escape")
    page.locator("#saveAll").click()
    found["dialog"] = _check(page)
    page.keyboard.press("Escape")
    for number, state in enumerate(("alone", "failed", "clip"), start=2):
        page.locator(f"#thumbnails li:nth-child({number}) .thumbnail").click()
        wait_for(page, "done" if state == "clip" else state, number)
        found[state] = _check(page)
    assert {state: faults for state, faults in found.items() if faults} == {}
    context.close()


def test_a_name_is_heard_in_one_piece_and_rows_of_thumbnails_keep_their_height(
    page: Page, photo: Path, tmp_path: Path
) -> None:
    long = tmp_path / "a_day_in_the_streets_of_york_10.jpg"
    long.write_bytes(photo.read_bytes())
    drop(page, photo, long)
    wait_for(page, "changed", 2)
    for name in ("street.jpg", long.name):
        heard = re.compile(f"^{re.escape(name)} straightened, \\w+$")
        expect(page.get_by_role("button", name=heard)).to_be_visible()
    height = "() => document.querySelector('#thumbnails').offsetHeight"
    before = page.evaluate(height)
    page.locator(".thumbnail .state").first.evaluate("node => node.textContent = 'saved · straightened, unsure · long'")
    assert page.evaluate(height) == before


def test_steps_by_hand_are_undone_and_done_again(street: Page) -> None:
    street.locator("#by-hand summary").click()
    lean, found = street.locator("#lean-number"), street.locator("#lean-number").input_value()
    redo = street.get_by_role("button", name="Redo", exact=True)
    for degrees in ("3.5", "-4.5"):
        lean.fill(degrees)
        lean.press("Enter")
    street.locator("#by-hand summary").focus()
    expect(redo).to_be_disabled()
    for key, shown in (("z", "3.5"), ("z", found), ("y", "3.5"), ("Shift+z", "-4.5"), ("y", "-4.5"), ("z", "3.5")):
        street.keyboard.press(f"Control+{key}")
        expect(lean).to_have_value(shown)
    redo.click()
    expect(lean).to_have_value("-4.5")
    street.keyboard.press("Control+z")
    lean.fill("7.0")  # another way than the step that was undone
    lean.press("Enter")
    expect(redo).to_be_disabled()


def test_a_strength_that_cannot_be_is_replaced(street: Page) -> None:
    number, slider = street.locator("#strength-number"), street.locator("#strength")
    for typed, taken, strength in (("500", "200", "2"), ("-20", "0", "0"), ("", "100", None)):
        enter(street, "#strength-number", "50")
        expect(slider).to_have_value("50")
        wait_for(street)
        number.fill(typed)
        with street.expect_request(lambda request: "/after?" in request.url and "later" not in request.url) as request:
            number.press("Enter")
        asked = dict(pair.split("=") for pair in request.value.url.split("?")[1].split("&"))
        assert asked.get("strength") == strength
        expect(number).to_have_value(taken)
        expect(slider).to_have_value(taken)


def test_the_keyboard_alone_does_all(page: Page, photo: Path) -> None:
    def tab_to(selector: str) -> None:
        for _ in range(60):
            if page.evaluate("selector => document.activeElement.matches(selector)", selector):
                return
            page.keyboard.press("Tab")
        raise AssertionError(f"{selector} is out of reach")

    tab_to("#sample")
    page.keyboard.press("Enter")
    wait_for(page)
    tab_to(".handle")
    for key, position in (("ArrowUp", "52"), ("ArrowRight", "54"), ("ArrowDown", "52"), ("ArrowLeft", "50")):
        page.keyboard.press(key)
        expect(page.get_by_role("slider", name="Divider")).to_have_attribute("aria-valuenow", position)
    page.evaluate("document.activeElement.blur()")
    for _ in range(5):
        page.keyboard.press("+")
    place = page.locator(".compare").bounding_box()
    for key in ("ArrowRight", "ArrowDown"):
        page.keyboard.press(key)
    moved = page.locator(".compare").bounding_box()
    assert place is not None and moved is not None
    assert (place["x"] - moved["x"], place["y"] - moved["y"]) == pytest.approx((60, 60), abs=1)
    page.keyboard.press("0")
    tab_to("#original")
    page.keyboard.down("Space")
    expect(page.locator(".layer.after")).to_be_hidden()
    page.keyboard.up("Space")
    expect(page.locator(".layer.after")).to_be_visible()
    tab_to("#candidates button")
    page.keyboard.press("Enter")
    expect(page.locator("#candidates button").first).to_have_attribute("aria-pressed", "true")
    tab_to("#by-hand summary")
    page.keyboard.press("Enter")
    tab_to("#tool-upright")
    page.keyboard.press("Enter")
    expect(page.locator(".end").first).to_be_focused()  # which the arrow keys move
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#saveOne")).to_be_enabled()  # the line leaned nowhere before, which changed nothing
    page.keyboard.press("Escape")
    tab_to("#saveOne")
    with page.expect_download():
        page.keyboard.press("Enter")


@pytest.mark.parametrize("width", [320, thorough(390)])
def test_a_phone_has_large_targets_in_straight_rows(chromium: Browser, server: Server, photo: Path, width: int) -> None:
    context = chromium.new_context(viewport={"width": width, "height": 700}, has_touch=True)
    context.set_default_timeout(SLOW_MS)
    page = context.new_page()
    page.goto(server.link)
    drop(page, photo, photo)
    wait_for(page, "changed", 2)
    page.locator("#advanced summary").click()

    def boxes(selector: str) -> list[dict[str, float]]:
        script = "nodes => nodes.map(node => node.getBoundingClientRect().toJSON())"
        return [box for box in page.locator(selector).evaluate_all(script) if box["height"]]

    assert all(box["height"] >= 44 for box in boxes("#strip-bar button"))
    assert len({box["top"] for box in boxes(".sensor")}) == 1 and len(boxes(".sensor")) == 5
    assert len({box["width"] for box in boxes("#candidates meter")}) == 1 < len(boxes("#candidates meter"))
    assert len({box["left"] for box in boxes("#panel .field select")}) <= 2  # of the panel, and of its sections
    assert len({box["height"] for box in boxes(".thumbnail")}) == 1
    assert page.evaluate("document.documentElement.scrollWidth") == width
    context.close()


def test_the_ways_a_camera_can_have_moved_stand_in_one_line(phone: Page, facade, tmp_path: Path) -> None:
    Photo.from_array(facade).save(tmp_path / "straight.png")
    drop(phone, tmp_path / "straight.png")
    wait_for(phone, "alone")
    ways = [phone.locator(f"#advice-{way}").evaluate("node => node.offsetTop") for way in ("left", "right", "yes")]
    assert ways[0] > 0 and len(set(ways)) == 1


def test_what_waits_has_a_picture(page: Page, facade, walk: Path, tmp_path: Path) -> None:
    """The browser draws what it can read, and the program the others: here a TIFF, as a HEIC elsewhere."""
    held: list[Route] = []
    page.route("**/after?*", lambda route: held.append(route))  # no answer comes
    page.route("**/readout?*", lambda route: held.append(route))
    names = ("one.png", "two.png", "three.png", "four.png", "five.tif")
    for name in names:
        Photo.from_array(facade).save(tmp_path / name)
    drop(page, *(tmp_path / name for name in names), walk)
    drawn = "() => [...document.querySelectorAll('.thumbnail canvas')].every(node => node.width !== node.height)"
    page.wait_for_function(drawn)
    for number in (4, 5, 6):
        expect(page.locator(f"#thumbnails li:nth-child({number}) .state")).to_have_text("waiting")


def test_a_clip_shows_a_picture_and_words_before_the_program_answers(page: Page, walk: Path) -> None:
    held: list[Route] = []
    page.route("**/before?*", lambda route: route.continue_() if held else held.append(route))
    with page.expect_request("**/before?*"):
        drop(page, walk)
    expect(page.locator("#player")).to_contain_text("opening the clip…")
    image = page.locator(".layer.before img")
    page.wait_for_function("() => document.querySelector('.layer.before img').naturalWidth > 40")
    expect(image).to_be_visible()
    expect(page.locator("#moments button")).to_have_count(5)
    stage = page.locator("#stage").bounding_box()
    held[0].continue_()
    wait_for(page, "done")
    assert page.locator("#stage").bounding_box() == stage  # nothing has moved


def test_all_are_saved_although_some_still_wait(page: Page, photo: Path, tmp_path: Path) -> None:
    held: list[Route] = []
    page.route("**/after?*", lambda route: held.append(route))
    names = [tmp_path / f"{number}.jpg" for number in range(5)]
    for name in names:
        name.write_bytes(photo.read_bytes())
    drop(page, *names)
    page.get_by_role("button", name="Save all (zip)").click()
    with page.expect_download() as download:
        page.locator("#save-which button[value=all]").click()
    expect(page.locator("#notice")).to_contain_text("5 files saved")
    assert download.value.suggested_filename.endswith(".zip")
