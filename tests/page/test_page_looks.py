"""The page as people look at it, in a real browser: empty, zoomed, on a phone, and when it is left."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser, Dialog, Page, expect

from support.batches import rectify
from support.browser import SLOW_MS, drop, wait_for
from support.covering import thorough
from support.page_server import Server
from unshutter.photo import Photo

BOX = "node => node.getBoundingClientRect().toJSON()"


def _width(page: Page) -> float:
    return page.locator(".compare").evaluate("node => node.offsetWidth")


def _whole(page: Page) -> float:
    """The width that all of the photo has on the screen, cropped or not."""
    return page.locator(".before .whole").evaluate("node => node.getBoundingClientRect().width")


def test_the_empty_page_is_one_large_button(page: Page, photo: Path) -> None:
    box = page.locator("#drop-area").bounding_box()
    assert box is not None and box["width"] > 1200 and box["height"] > 650
    with page.expect_file_chooser() as chooser:
        page.locator("#drop-area").click(position={"x": 40, "y": 40})
    chooser.value.set_files(photo)
    wait_for(page)


def test_the_sample_photo(page: Page) -> None:
    page.get_by_role("button", name="Try a sample photo").click()
    wait_for(page, "changed")
    expect(page.locator("#name")).to_have_text("sample.jpg")
    expect(page.locator(".sureness")).to_have_text("sure")  # in words, not per cent
    expect(page.locator("#panel .said")).not_to_contain_text("%.")
    expect(page.locator("#panel .said")).to_contain_text("Cut down to 8")
    assert _black_at_the_rim(page) == 0
    page.locator("#edges").select_option("keep")
    expect(page.locator("#panel .said")).to_contain_text("stay empty")
    wait_for(page, "changed")
    assert _black_at_the_rim(page) > 100


def _black_at_the_rim(page: Page) -> int:
    """How many pixels are black, of those of the picture after that lie within 2 px of the border of what is shown."""
    return page.locator(".layer.after img").evaluate(
        """async image => {
            await image.decode();
            const frame = document.querySelector(".compare").getBoundingClientRect();
            const all = image.getBoundingClientRect(), scale = image.naturalWidth / all.width;
            const [left, right] = [frame.left - all.left, frame.right - all.left].map((px) => Math.round(px * scale));
            const [top, bottom] = [frame.top - all.top, frame.bottom - all.top].map((px) => Math.round(px * scale));
            const context = new OffscreenCanvas(image.naturalWidth, image.naturalHeight).getContext("2d");
            context.drawImage(image, 0, 0);
            const sides = [[left - 1, top - 1, right - left + 2, 3], [left - 1, bottom - 2, right - left + 2, 3],
                [left - 1, top - 1, 3, bottom - top + 2], [right - 2, top - 1, 3, bottom - top + 2]];
            const black = (side) => {
                const { data } = context.getImageData(...side);
                const dark = (k) => data[k + 3] && data[k] + data[k + 1] + data[k + 2] < 3;
                return data.filter((_, k) => k % 4 === 0 && dark(k)).length;
            };
            return sides.reduce((sum, side) => sum + black(side), 0);
        }"""
    )


def test_saving_says_what_was_saved_and_where(page: Page, photo: Path) -> None:
    drop(page, photo)
    wait_for(page)
    before = page.locator(".compare").bounding_box()
    with page.expect_download():
        page.get_by_role("button", name="Save this photo").click()
    expect(page.locator("#notice")).to_have_text("street.rectified.jpg: saved to the downloads of your browser.")
    assert page.locator(".compare").bounding_box() == before  # the notice does not move the picture
    expect(page.locator(".thumbnail .state")).to_contain_text("saved")
    page.locator("#strength").fill("50")
    expect(page.locator(".thumbnail .state")).not_to_contain_text("saved")


def test_what_was_added_last_is_shown(page: Page, photo: Path, tmp_path: Path) -> None:
    others = [tmp_path / "one.jpg", tmp_path / "two.jpg"]
    for other in others:
        other.write_bytes(photo.read_bytes())
    drop(page, photo)
    wait_for(page)
    drop(page, *others)
    expect(page.locator("#name")).to_have_text("one.jpg")


def test_before_and_after_in_the_frame_of_the_crop(page: Page, photo: Path) -> None:
    """The divider compares the same pixels; a tool and nothing else lifts the crop."""
    drop(page, photo)
    wait_for(page)
    expect(page.locator("#panel .said")).to_contain_text("Cut down to")
    boxes = (".compare", ".before .whole", ".after .whole")
    frame, before, after = (page.locator(each).evaluate(BOX) for each in boxes)
    assert before == after and frame["width"] < before["width"] - 5 and frame["height"] < before["height"] - 5
    assert before["left"] <= frame["left"] and frame["right"] <= before["right"]
    tag = page.locator(".tag.after").evaluate(BOX)
    assert frame["left"] < tag["left"] and tag["right"] < frame["right"]
    shape = frame["width"] / frame["height"]
    for canvas in (".thumbnail canvas", "#candidates [aria-pressed=true] canvas"):
        page.wait_for_function("canvas => document.querySelector(canvas).width > 40", arg=canvas)
        small = page.locator(canvas).evaluate("node => node.width / node.height")
        assert small == pytest.approx(shape, rel=0.02)
    page.locator("#by-hand summary").click()
    page.locator("#tool-upright").click()
    page.wait_for_function(
        """places => {
            const [frame, before] = places.map((place) => document.querySelector(place).getBoundingClientRect().width);
            return Math.abs(frame - before) < 1;
        }""",
        arg=list(boxes[:2]),
    )


def test_automatic_corners_are_neither_black_nor_invented(page: Page, photo: Path, tmp_path: Path) -> None:
    """They are cut off, however much that is; this is said, and saved."""
    drop(page, photo)
    wait_for(page)
    page.locator("#by-hand summary").click()
    page.locator("#lean-number").fill("25")
    page.locator("#lean-number").press("Enter")
    expect(page.locator("#panel .said")).to_contain_text("Cut down to")
    wait_for(page)
    page.locator("#advanced summary").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Save motion").click()
    (tmp_path / "motion.json").write_bytes(Path(download.value.path()).read_bytes())
    with page.expect_download() as download:
        page.get_by_role("button", name="Save this photo").click()
    flags = ["--motion", tmp_path / "motion.json"]
    assert rectify(photo, "-o", tmp_path / "expected.jpg", *flags) == 0
    assert Path(download.value.path()).read_bytes() == (tmp_path / "expected.jpg").read_bytes()


def test_thumbnails_from_two_photos_on(page: Page, photo: Path, tmp_path: Path) -> None:
    drop(page, photo)
    wait_for(page)
    expect(page.locator("#strip")).to_be_hidden()
    expect(page.get_by_role("button", name="Use these settings for all photos")).to_be_hidden()
    (tmp_path / "other.jpg").write_bytes(photo.read_bytes())
    drop(page, tmp_path / "other.jpg")
    expect(page.locator("#strip")).to_be_visible()
    wait_for(page, number=2)
    page.get_by_role("button", name="Close this photo or clip").click()
    page.get_by_role("button", name="Close this photo or clip").click()
    expect(page.locator("#empty")).to_be_visible()


def test_thumbnails_are_filtered_and_counted(page: Page, photo: Path, facade, tmp_path: Path) -> None:
    straight, bad = tmp_path / "straight.png", tmp_path / "bad.jpg"
    Photo.from_array(facade).save(straight)
    bad.write_bytes(b"no picture")
    drop(page, photo, straight, bad)
    for number, state in enumerate(("changed", "alone", "failed"), start=1):
        wait_for(page, state, number)
    shown = page.locator("#thumbnails li:visible")
    expect(shown).to_have_count(3)
    expect(page.locator("#strip-bar progress")).to_be_hidden()  # all are looked through
    page.get_by_role("button", name="Straightened 1").click()
    expect(shown).to_have_count(1)
    expect(shown).to_contain_text("street.jpg")
    page.keyboard.press("j")  # nothing else is shown
    expect(page.locator("#name")).to_have_text("street.jpg")
    page.get_by_role("button", name="Left unchanged 1").click()
    expect(shown).to_contain_text("straight.png")
    page.get_by_role("button", name="Failed 1").click()
    expect(shown).to_contain_text("bad.jpg")
    page.get_by_role("button", name="Close bad.jpg").click()
    expect(shown).to_have_count(2)  # the filter has nothing left to show
    expect(page.get_by_role("button", name="All 2")).to_have_attribute("aria-pressed", "true")


def test_a_grid_to_compare_with(page: Page, photo: Path) -> None:
    drop(page, photo)
    wait_for(page)
    grid, lines = page.locator(".grid"), page.locator(".grid line")
    expect(grid).to_be_hidden()
    page.keyboard.press("g")
    expect(grid).to_be_visible()
    expect(lines).to_have_count(22)
    page.get_by_role("button", name="Grid (key G)").click()
    expect(grid).to_be_hidden()


def test_zoom_by_wheel_keys_and_pinch(page: Page, photo: Path) -> None:
    drop(page, photo)
    wait_for(page)
    fitting = _width(page)
    box = page.locator(".compare").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 4, box["y"] + box["height"] / 4
    page.mouse.move(x, y)
    page.mouse.wheel(0, -400)
    page.wait_for_function("width => document.querySelector('.compare').offsetWidth > width * 1.5", arg=fitting)
    zoomed = page.locator(".compare").bounding_box()
    assert zoomed is not None
    place = (x - zoomed["x"]) / zoomed["width"], (y - zoomed["y"]) / zoomed["height"]
    assert place == pytest.approx((0.25, 0.25), abs=0.01)  # what was under the pointer has stayed there
    page.mouse.down()
    page.mouse.move(x + 30, y + 20, steps=3)
    page.mouse.up()
    moved = page.locator(".compare").bounding_box()
    assert moved is not None and (moved["x"] - zoomed["x"], moved["y"] - zoomed["y"]) == pytest.approx((30, 20), abs=1)
    shown = page.locator("#zoom option:checked")
    expect(shown).to_have_text(f"{round(100 * _whole(page) / 560)} %")
    page.locator("#zoom").select_option("100 %")
    expect(shown).to_have_text("100 %")
    assert _whole(page) == pytest.approx(560, abs=0.5)  # one pixel of the screen for each of the photo
    page.locator("#zoom").select_option("200 %")
    assert _whole(page) == pytest.approx(1120, abs=1)
    page.locator("#zoom").select_option("Fit")
    page.mouse.move(x, y)
    page.keyboard.down("Control")
    page.mouse.wheel(0, -100)  # one notch
    page.keyboard.up("Control")
    page.wait_for_function("width => document.querySelector('.compare').offsetWidth > width * 1.1", arg=fitting)
    assert _width(page) < 1.5 * fitting
    page.keyboard.press("0")
    assert _width(page) == pytest.approx(fitting, abs=1)
    page.keyboard.press("+")
    assert _width(page) == pytest.approx(1.25 * fitting, abs=2)
    page.keyboard.press("-")
    assert _width(page) == pytest.approx(fitting, abs=1)
    touch = page.context.new_cdp_session(page)
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for kind, apart in (("touchStart", 50), ("touchMove", 75), ("touchMove", 100), ("touchEnd", 0)):
        points = [{"x": middle[0] + side * apart, "y": middle[1], "id": side} for side in (-1, 1)] if apart else []
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    assert _width(page) == pytest.approx(2 * fitting, rel=0.05)


def test_hold_to_see_the_original(page: Page, photo: Path) -> None:
    drop(page, photo)
    wait_for(page)
    after = page.locator(".layer.after")
    page.keyboard.down("o")
    expect(after).to_be_hidden()
    page.keyboard.up("o")
    expect(after).to_be_visible()
    box = page.locator("#original").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    page.mouse.down()
    expect(after).to_be_hidden()
    page.mouse.up()
    expect(after).to_be_visible()


def test_no_focus_box_after_a_drag_with_the_mouse(page: Page, photo: Path) -> None:
    drop(page, photo)
    wait_for(page)
    box = page.locator(".handle").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 90, box["y"] + 60, steps=3)
    page.mouse.up()
    outline = "node => [node, node.firstElementChild].map(each => getComputedStyle(each).outlineStyle)"
    assert page.locator(".handle").evaluate(outline) == ["none", "none"]
    page.keyboard.press("ArrowRight")
    expect(page.locator(".handle")).to_be_focused()


def test_leaving_asks_when_something_is_unsaved(page: Page, photo: Path) -> None:
    leaves = "() => dispatchEvent(new Event('beforeunload', { cancelable: true }))"
    asked: list[str] = []

    def stay(dialog: Dialog) -> None:
        asked.append(dialog.type)
        dialog.dismiss()

    page.on("dialog", stay)
    drop(page, photo)
    wait_for(page)
    assert page.evaluate(leaves)  # it was only looked at
    page.locator("#strength-number").fill("80")
    page.locator("#strength-number").press("Enter")
    wait_for(page)
    page.locator("#name").click()  # browsers ask only those who have touched the page
    with page.expect_event("dialog"):
        page.close(run_before_unload=True)
    assert asked == ["beforeunload"]
    with page.expect_download():
        page.get_by_role("button", name="Save this photo").click()
    expect(page.locator("#working")).to_be_empty()
    assert page.evaluate(leaves)


def test_a_phone_shows_the_picture_first_and_has_large_targets(chromium: Browser, server: Server, photo: Path) -> None:
    context = chromium.new_context(viewport={"width": 390, "height": 844}, has_touch=True)
    context.set_default_timeout(SLOW_MS)
    page = context.new_page()
    page.goto(server.link)
    drop(page, photo)
    wait_for(page)
    stage, panel, save = (page.locator(each).bounding_box() for each in ("#stage", "#panel", "#saveOne"))
    assert stage is not None and panel is not None and save is not None
    shown = page.locator(".compare").bounding_box()
    assert shown is not None and abs(shown["width"] - 390) < 1 and abs(shown["height"] - stage["height"]) < 1  # no bars
    assert stage["y"] < 150 and panel["y"] >= stage["y"] + stage["height"]
    page.evaluate("scrollTo(0, 500)")
    expect(page.get_by_role("button", name="Grid")).to_be_in_viewport(ratio=1)
    expect(page.get_by_label("Zoom", exact=True)).to_be_in_viewport(ratio=1)
    page.evaluate("scrollTo(0, 0)")
    page.locator("#by-hand summary").click()
    page.locator("#turn-number").scroll_into_view_if_needed()
    picture, number = page.locator("#stage").bounding_box(), page.locator("#turn-number").bounding_box()
    assert picture is not None and number is not None  # what the numbers do is seen while they are changed
    assert picture["y"] >= 0 and picture["y"] + picture["height"] <= number["y"]
    expect(page.get_by_role("button", name="Save this photo")).to_be_in_viewport(ratio=1)
    page.locator("#tool-upright").click()
    done = page.get_by_role("button", name="Done")
    expect(done).to_be_in_viewport()
    done.click()
    sizes = page.evaluate(
        """() => [...document.querySelectorAll("button, select, summary, input:not([type=checkbox]), label.check")]
            .filter(node => node.checkVisibility() && !node.closest(".compare, .away, label.arrow"))
            .map(node => [node.id || node.textContent, node.getBoundingClientRect().height])"""
    )
    assert len(sizes) > 12 and [each for each in sizes if each[1] < 43.9] == []
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    drop(page, photo)  # a second one: buttons for both, each still in one row, below the name
    expect(page.get_by_role("button", name="Save all (zip)")).to_be_visible()
    header, bar = (page.locator(each).evaluate(BOX)["height"] for each in ("header", "#bar"))
    assert header < 66 and bar < 88
    context.close()


def test_on_a_phone_the_verdict_is_seen_and_the_next_photo_starts_at_its_top(
    chromium: Browser, server: Server, photo: Path, tmp_path: Path
) -> None:
    long = tmp_path / f"{'summer in Trier ' * 5}IMG_1234.jpg"
    for path in (long, tmp_path / "b.jpg"):
        path.write_bytes(photo.read_bytes())
    (tmp_path / "empty.jpg").write_bytes(b"")
    page = chromium.new_page(viewport={"width": 390, "height": 844}, has_touch=True)
    page.goto(server.link)
    drop(page, long, tmp_path / "b.jpg", tmp_path / "empty.jpg")
    for number, state in enumerate(("changed", "changed", "failed"), start=1):
        wait_for(page, state, number)
    names = ("#panel .said p:first-child", "#saveOne", "#name", "#name span:last-child")
    verdict, save, name, ending = (page.locator(each).evaluate(BOX) for each in names)
    assert save["bottom"] <= verdict["top"] and verdict["bottom"] <= 844
    assert name["right"] >= ending["right"] - 1  # the end of the name is not cut off
    page.evaluate("scrollTo(0, 500)")
    page.locator("#next").dispatch_event("click")
    expect(page.locator("#name")).to_have_text("b.jpg")
    assert page.evaluate("scrollY") == 0
    with page.expect_response("**/api/photos"):  # what is looked at is tried again
        page.get_by_title("empty.jpg").click()
    wait_for(page, "failed", 3)
    expect(page.locator("#stage .message")).to_contain_text("empty.jpg is empty")
    page.get_by_role("button", name="Remove all that failed").click()
    expect(page.locator("#thumbnails li")).to_have_count(2)
    expect(page.locator("#removeFailed")).to_be_hidden()
    page.close()


@pytest.mark.parametrize(("width", "height", "font"), [thorough(844, 390, 15), thorough(1400, 900, 32), (390, 844, 32)])
def test_a_phone_on_its_side_and_large_text(
    chromium: Browser, server: Server, photo: Path, width: int, height: int, font: int
) -> None:
    page = chromium.new_page(viewport={"width": width, "height": height})
    page.goto(server.link)
    page.evaluate("size => (document.documentElement.style.fontSize = `${size}px`)", font)
    drop(page, photo)
    wait_for(page)
    stage = page.locator("#stage").evaluate(BOX)
    assert stage["height"] >= 0.4 * height and stage["width"] >= 0.4 * width
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    overlapping = page.evaluate(
        """() => {
            const shown = [...document.querySelectorAll("#bar > *, #panel .field > *, #panel .said p, #saveOne")]
                .filter((node) => node.checkVisibility() && node.getBoundingClientRect().width);
            const boxes = shown.map((node) => node.getBoundingClientRect());
            const meet = (one, other) => one.left < other.right - 1 && other.left < one.right - 1
                && one.top < other.bottom - 1 && other.top < one.bottom - 1;
            return shown.filter((node, k) => boxes.slice(0, k).some((box) => meet(box, boxes[k])))
                .map((node) => node.id || node.textContent);
        }"""
    )
    assert overlapping == []
    for edge in ("#name", "#zoom", "#grid"):
        assert page.locator(edge).evaluate(BOX)["right"] <= stage["right"]
    page.close()
