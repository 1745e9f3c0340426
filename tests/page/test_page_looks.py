"""The page as people look at it, in a real browser: empty, zoomed, on a phone, and when it is left."""

import json
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Dialog, Page, expect

from support.batches import rectified
from support.browser import drop, enter, saved, wait_for
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


def test_saving_says_what_is_not_kept(page: Page, photo: Path, tmp_path: Path) -> None:
    data = photo.read_bytes()
    segment = b"of a program"
    file = tmp_path / "street.jpg"
    file.write_bytes(data[:2] + b"\xff\xe5\0" + bytes([2 + len(segment)]) + segment + data[2:])
    drop(page, file)
    expect(page.get_by_role("button", name="Save this photo")).to_be_enabled()
    with page.expect_download():
        page.get_by_role("button", name="Save this photo").click()
    expect(page.locator("#notice")).to_have_text(
        "street.rectified.jpg: saved to the downloads of your browser. Not kept: other data."
    )


def test_saving_says_what_was_saved_and_where(street: Page, photo: Path) -> None:
    before = street.locator(".compare").bounding_box()
    with street.expect_download():
        street.get_by_role("button", name="Save this photo").click()
    expect(street.locator("#notice")).to_have_text("street.rectified.jpg: saved to the downloads of your browser.")
    assert street.locator(".compare").bounding_box() == before  # the notice does not move the picture
    expect(street.locator(".thumbnail .state")).to_contain_text("saved")
    street.locator("#strength").fill("50")
    expect(street.locator(".thumbnail .state")).not_to_contain_text("saved")


def test_before_and_after_in_the_frame_of_the_crop(street: Page) -> None:
    """The divider compares the same pixels; a tool and nothing else lifts the crop."""
    expect(street.locator("#panel .said")).to_contain_text("Cut down to")
    boxes = (".compare", ".before .whole", ".after .whole")
    frame, before, after = (street.locator(each).evaluate(BOX) for each in boxes)
    assert before == after and frame["width"] < before["width"] - 5 and frame["height"] < before["height"] - 5
    assert before["left"] <= frame["left"] and frame["right"] <= before["right"]
    tag = street.locator(".tag.after").evaluate(BOX)
    assert frame["left"] < tag["left"] and tag["right"] < frame["right"]
    shape = frame["width"] / frame["height"]
    for canvas in (".thumbnail canvas", "#candidates [aria-pressed=true] canvas"):
        street.wait_for_function("canvas => document.querySelector(canvas).width > 40", arg=canvas)
        small = street.locator(canvas).evaluate("node => node.width / node.height")
        assert small == pytest.approx(shape, rel=0.02)
    street.locator("#by-hand summary").click()
    street.locator("#tool-upright").click()
    street.wait_for_function(
        """places => {
            const [frame, before] = places.map((place) => document.querySelector(place).getBoundingClientRect().width);
            return Math.abs(frame - before) < 1;
        }""",
        arg=list(boxes[:2]),
    )


def test_automatic_corners_are_neither_black_nor_invented(street: Page, photo: Path, tmp_path: Path) -> None:
    """They are cut off, however much that is; this is said, and saved."""
    street.locator("#by-hand summary").click()
    enter(street, "#lean-number", "25")
    enter(street, "#turn-number", "1.5")
    enter(street, "#strength-number", "80")
    expect(street.locator("#panel .said")).to_contain_text("Cut down to")
    wait_for(street)
    street.locator("#advanced summary").click()
    (tmp_path / "motion.json").write_bytes(saved(street, "Save motion"))
    assert json.loads((tmp_path / "motion.json").read_text())["estimator"] == "by-hand"
    assert saved(street) == rectified(photo, "--motion", tmp_path / "motion.json", "--strength", "0.8")


def test_thumbnails_from_two_photos_on_are_filtered_and_counted(street: Page, facade, tmp_path: Path) -> None:
    expect(street.locator("#strip")).to_be_hidden()
    expect(street.get_by_role("button", name="Use these settings for all photos")).to_be_hidden()
    straight, bad = tmp_path / "straight.png", tmp_path / "bad.jpg"
    Photo.from_array(facade).save(straight)
    bad.write_bytes(b"no picture")
    drop(street, straight, bad)
    expect(street.locator("#name")).to_have_text("straight.png")  # what was added last
    for number, state in enumerate(("changed", "alone", "failed"), start=1):
        wait_for(street, state, number)
    shown = street.locator("#thumbnails li:visible")
    expect(shown).to_have_count(3)
    expect(street.locator("#strip-bar progress")).to_be_hidden()  # all are looked through
    street.get_by_role("button", name="Straightened 1").click()
    expect(shown).to_have_count(1)
    expect(shown).to_contain_text("street.jpg")
    street.get_by_title("street.jpg").click()
    street.keyboard.press("j")  # nothing else is shown
    expect(street.locator("#name")).to_have_text("street.jpg")
    street.get_by_role("button", name="Left unchanged 1").click()
    expect(shown).to_contain_text("straight.png")
    street.get_by_role("button", name="Failed 1").click()
    expect(shown).to_contain_text("bad.jpg")
    street.get_by_role("button", name="Close bad.jpg").click()
    expect(shown).to_have_count(2)  # the filter has nothing left to show
    expect(street.get_by_role("button", name="All 2")).to_have_attribute("aria-pressed", "true")
    for _ in range(2):
        street.get_by_role("button", name="Close this photo or clip").click()
    expect(street.locator("#empty")).to_be_visible()


def test_zoom_by_wheel_keys_and_pinch(street: Page, photo: Path) -> None:
    fitting = _width(street)
    box = street.locator(".compare").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 4, box["y"] + box["height"] / 4
    street.mouse.move(x, y)
    street.mouse.wheel(0, -400)
    street.wait_for_function("width => document.querySelector('.compare').offsetWidth > width * 1.5", arg=fitting)
    zoomed = street.locator(".compare").bounding_box()
    assert zoomed is not None
    place = (x - zoomed["x"]) / zoomed["width"], (y - zoomed["y"]) / zoomed["height"]
    assert place == pytest.approx((0.25, 0.25), abs=0.01)  # what was under the pointer has stayed there
    street.mouse.down()
    street.mouse.move(x + 30, y + 20, steps=3)
    street.mouse.up()
    moved = street.locator(".compare").bounding_box()
    assert moved is not None and (moved["x"] - zoomed["x"], moved["y"] - zoomed["y"]) == pytest.approx((30, 20), abs=1)
    shown = street.locator("#zoom option:checked")
    expect(shown).to_have_text(f"{round(100 * _whole(street) / 560)} %")
    street.locator("#zoom").select_option("100 %")
    expect(shown).to_have_text("100 %")
    assert _whole(street) == pytest.approx(560, abs=0.5)  # one pixel of the screen for each of the photo
    street.locator("#zoom").select_option("200 %")
    assert _whole(street) == pytest.approx(1120, abs=1)
    street.locator("#zoom").select_option("Fit")
    street.mouse.move(x, y)
    street.keyboard.down("Control")
    street.mouse.wheel(0, -100)  # one notch
    street.keyboard.up("Control")
    street.wait_for_function("width => document.querySelector('.compare').offsetWidth > width * 1.1", arg=fitting)
    assert _width(street) < 1.5 * fitting
    street.keyboard.press("0")
    assert _width(street) == pytest.approx(fitting, abs=1)
    street.keyboard.press("+")
    assert _width(street) == pytest.approx(1.25 * fitting, abs=2)
    street.keyboard.press("-")
    assert _width(street) == pytest.approx(fitting, abs=1)
    touch = street.context.new_cdp_session(street)
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for kind, apart in (("touchStart", 50), ("touchMove", 75), ("touchMove", 100), ("touchEnd", 0)):
        points = [{"x": middle[0] + side * apart, "y": middle[1], "id": side} for side in (-1, 1)] if apart else []
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    assert _width(street) == pytest.approx(2 * fitting, rel=0.05)


def test_a_grid_the_original_and_no_box_around_the_divider(street: Page) -> None:
    grid, after, handle = (street.locator(each) for each in (".grid", ".layer.after", ".handle"))
    expect(grid).to_be_hidden()
    street.keyboard.press("g")
    expect(grid).to_be_visible()
    expect(street.locator(".grid line")).to_have_count(22)
    street.get_by_role("button", name="Grid (key G)").click()
    expect(grid).to_be_hidden()
    street.keyboard.down("o")
    expect(after).to_be_hidden()
    street.keyboard.up("o")
    expect(after).to_be_visible()
    street.locator("#original").hover()
    street.mouse.down()
    expect(after).to_be_hidden()
    street.mouse.up()
    expect(after).to_be_visible()
    box = handle.evaluate(BOX)
    street.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    street.mouse.down()
    street.mouse.move(box["x"] + 90, box["y"] + 60, steps=3)
    street.mouse.up()
    outline = "node => [node, node.firstElementChild].map(each => getComputedStyle(each).outlineStyle)"
    assert handle.evaluate(outline) == ["none", "none"]
    street.keyboard.press("ArrowRight")
    expect(handle).to_be_focused()


def test_leaving_asks_when_something_is_unsaved(street: Page) -> None:
    leaves = "() => dispatchEvent(new Event('beforeunload', { cancelable: true }))"
    asked: list[str] = []

    def stay(dialog: Dialog) -> None:
        asked.append(dialog.type)
        dialog.dismiss()

    street.on("dialog", stay)
    assert street.evaluate(leaves)  # it was only looked at
    enter(street, "#strength-number", "80")
    wait_for(street)
    street.locator("#name").click()  # browsers ask only those who have touched the page
    with street.expect_event("dialog"):
        street.close(run_before_unload=True)
    assert asked == ["beforeunload"]
    assert saved(street)
    expect(street.locator("#working")).to_be_empty()
    assert street.evaluate(leaves)


def test_a_phone_shows_the_picture_first_and_has_large_targets(phone: Page, photo: Path) -> None:
    drop(phone, photo)
    wait_for(phone)
    stage, panel, save = (phone.locator(each).bounding_box() for each in ("#stage", "#panel", "#saveOne"))
    assert stage is not None and panel is not None and save is not None
    shown = phone.locator(".compare").bounding_box()
    assert shown is not None and abs(shown["width"] - 390) < 1 and abs(shown["height"] - stage["height"]) < 1  # no bars
    assert stage["y"] < 150 and panel["y"] >= stage["y"] + stage["height"]
    phone.evaluate("scrollTo(0, 500)")
    expect(phone.get_by_role("button", name="Grid")).to_be_in_viewport(ratio=1)
    expect(phone.get_by_label("Zoom", exact=True)).to_be_in_viewport(ratio=1)
    phone.evaluate("scrollTo(0, 0)")
    phone.locator("#by-hand summary").click()
    phone.locator("#turn-number").scroll_into_view_if_needed()
    picture, number = phone.locator("#stage").bounding_box(), phone.locator("#turn-number").bounding_box()
    assert picture is not None and number is not None  # what the numbers do is seen while they are changed
    assert picture["y"] >= 0 and picture["y"] + picture["height"] <= number["y"]
    expect(phone.get_by_role("button", name="Save this photo")).to_be_in_viewport(ratio=1)
    phone.locator("#tool-upright").click()
    done = phone.get_by_role("button", name="Done")
    expect(done).to_be_in_viewport()
    done.click()
    sizes = phone.evaluate(
        """() => [...document.querySelectorAll("button, select, summary, input:not([type=checkbox]), label.check")]
            .filter(node => node.checkVisibility() && !node.closest(".compare, .away, label.arrow"))
            .map(node => [node.id || node.textContent, node.getBoundingClientRect().height])"""
    )
    assert len(sizes) > 12 and [each for each in sizes if each[1] < 43.9] == []
    assert phone.evaluate("document.documentElement.scrollWidth") <= 390
    drop(phone, photo)  # a second one: buttons for both, each still in one row, below the name
    expect(phone.get_by_role("button", name="Save all (zip)")).to_be_visible()
    header, bar = (phone.locator(each).evaluate(BOX)["height"] for each in ("header", "#bar"))
    assert header < 66 and bar < 88


def test_on_a_phone_the_verdict_is_seen_and_the_next_photo_starts_at_its_top(
    phone: Page, photo: Path, tmp_path: Path
) -> None:
    long = tmp_path / f"{'summer in Trier ' * 5}IMG_1234.jpg"
    for path in (long, tmp_path / "b.jpg"):
        path.write_bytes(photo.read_bytes())
    (tmp_path / "empty.jpg").write_bytes(b"")
    drop(phone, long, tmp_path / "b.jpg", tmp_path / "empty.jpg")
    for number, state in enumerate(("changed", "changed", "failed"), start=1):
        wait_for(phone, state, number)
    names = ("#panel .said p:first-child", "#saveOne", "#name", "#name span:last-child")
    verdict, save, name, ending = (phone.locator(each).evaluate(BOX) for each in names)
    assert save["bottom"] <= verdict["top"] and verdict["bottom"] <= 844
    assert name["right"] >= ending["right"] - 1  # the end of the name is not cut off
    phone.evaluate("scrollTo(0, 500)")
    phone.locator("#next").dispatch_event("click")
    expect(phone.locator("#name")).to_have_text("b.jpg")
    assert phone.evaluate("scrollY") == 0
    with phone.expect_response("**/api/photos"):  # what is looked at is tried again
        phone.get_by_title("empty.jpg").click()
    wait_for(phone, "failed", 3)
    expect(phone.locator("#stage .message")).to_contain_text("empty.jpg is empty")
    phone.get_by_role("button", name="Remove all that failed").click()
    expect(phone.locator("#thumbnails li")).to_have_count(2)
    expect(phone.locator("#removeFailed")).to_be_hidden()


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
