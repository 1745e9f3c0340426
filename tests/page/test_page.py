"""The page in a real browser."""

import json
import zipfile
from pathlib import Path

from playwright.sync_api import Browser, Page, expect

from support.batches import rectified, rectify
from support.browser import SLOW_MS, drop, enter, saved, wait_for
from support.frame_pairs import Scene
from support.gain_maps import OF_MAP, STOPS, hdr_photo, pictures_of
from support.page_server import TOKEN, Server, served
from unshutter.photo import Photo


def _image(page: Page, which: str) -> list[int]:
    """The mean colour of what is shown."""
    return page.evaluate(
        """async which => {
            const image = document.querySelector(`.layer.${which} img`);
            while (await image.decode().then(() => false, () => true)); // another has just taken its place
            const canvas = new OffscreenCanvas(8, 8), context = canvas.getContext("2d");
            context.drawImage(image, 0, 0, 8, 8);
            return [...context.getImageData(0, 0, 8, 8).data];
        }""",
        which,
    )


def test_the_token_leaves_the_address_and_without_it_nothing_is_to_be_had(
    page: Page, chromium: Browser, server: Server
) -> None:
    assert TOKEN not in page.url
    expect(page.get_by_role("heading", name="Drop photos or clips here")).to_be_visible()
    page.reload()
    assert page.evaluate("fetch('/api/about').then(answer => answer.status)") == 401  # the page alone knows it
    expect(page.locator("#notice")).to_be_hidden()
    stranger = chromium.new_page()
    stranger.goto(f"{server.url}/")
    expect(stranger.locator("#notice")).to_contain_text("This link is not valid")
    stranger.close()


def test_drop_and_slider(street: Page) -> None:
    expect(street.locator("#panel .said")).to_contain_text("Straightened: some places moved by up to")
    assert _image(street, "before") != _image(street, "after")
    handle = street.get_by_role("slider", name="Divider between before and after")
    expect(handle).to_have_attribute("aria-valuenow", "50")
    handle.press("ArrowRight")
    expect(handle).to_have_attribute("aria-valuenow", "52")
    box = street.locator(".compare").bounding_box()
    assert box is not None
    street.mouse.move(box["x"] + box["width"] / 2, box["y"] + 100)
    street.mouse.down()
    street.mouse.move(box["x"] + box["width"] / 4, box["y"] + 100, steps=3)
    street.mouse.up()
    expect(handle).to_have_attribute("aria-valuenow", "25")
    street.keyboard.press("z")
    wide = street.locator(".whole").first.evaluate("node => node.getBoundingClientRect().width")
    assert round(wide) == 560  # its own pixels
    street.keyboard.press("l")
    expect(street.locator(".lines.before line").first).to_be_attached()


def test_controls_and_saving_to_the_byte(street: Page, photo: Path, tmp_path: Path) -> None:
    whole = _image(street, "after")
    street.locator("#strength").fill("50")
    street.locator("#edges").select_option("keep")
    street.locator("#advanced summary").click()
    street.locator("#panel").get_by_label("last", exact=True).check()
    expect(street.locator("#panel .said")).to_contain_text("stay empty")
    wait_for(street)
    assert _image(street, "after") != whole
    with street.expect_download() as download:
        street.get_by_role("button", name="Save this photo").click()
    assert download.value.suggested_filename == "street.rectified.jpg"
    flags = ["--strength", "0.5", "--edges", "keep", "--reference", "last"]
    assert rectify(photo, "-o", tmp_path / "expected.jpg", *flags) == 0
    assert Path(download.value.path()).read_bytes() == (tmp_path / "expected.jpg").read_bytes()
    with street.expect_download() as download:
        street.get_by_role("button", name="Save motion").click()
    assert json.loads(Path(download.value.path()).read_text())["format"] == "unshutter-motion/1"
    street.get_by_label("Leave this photo alone").check()
    expect(street.locator("#panel .said")).to_contain_text("Left unchanged, as you asked.")
    expect(street.locator(".thumbnail .state")).to_have_text("left unchanged")


def test_an_hdr_photo_is_shown_in_sdr_and_saved_in_hdr(page: Page, photo: Path) -> None:
    pixels = Photo.open(photo).to_array()
    height, width = pixels.shape[:2]
    photo.write_bytes(
        hdr_photo(height, width, (height // 4, width // 4), picture=(pixels, pixels[..., 0] / 255 * STOPS))
    )
    drop(page, photo)
    wait_for(page)
    expect(page.locator("#panel .said")).to_contain_text("HDR kept")
    with page.expect_download() as download:
        page.get_by_role("button", name="Save this photo").click()
    assert OF_MAP in pictures_of(Path(download.value.path()).read_bytes())[1]
    expect(page.locator("#notice")).not_to_contain_text("gain map")
    page.locator("#advanced summary").click()
    page.locator("#format").select_option("png")
    expect(page.locator("#panel .said")).not_to_contain_text("HDR kept")


def test_bad_files_and_many(page: Page, photo: Path, tmp_path: Path) -> None:
    """A file that is no picture, one of 100 MB, and good ones, saved together and cancelled once."""
    bad, large, other = tmp_path / "bad.jpg", tmp_path / "large.jpg", tmp_path / "other.jpg"
    bad.write_bytes(b"no picture")
    large.write_bytes(photo.read_bytes() + bytes(100_000_000))  # what follows a JPEG's end is nobody's
    other.write_bytes(photo.read_bytes())
    page.set_input_files("#choose", [bad, photo, large, other])
    for number, state in enumerate(("failed", "changed", "changed", "changed"), start=1):
        wait_for(page, state, number)
    expect(page.locator("#stage .message")).to_contain_text("is not a JPEG")
    page.get_by_title("other.jpg").click()
    page.get_by_label("Leave this photo alone").check()
    expect(page.locator("#thumbnails li:nth-child(4) .thumbnail")).to_have_attribute("data-state", "alone")
    with page.expect_download() as download:
        page.get_by_role("button", name="Save all (zip)").click()
        expect(page.get_by_role("dialog")).to_contain_text("2 of 3 were straightened.")
        expect(page.get_by_role("button", name="Only straightened ones")).to_be_focused()
        page.get_by_role("button", name="All, unchanged ones as they are").click()
    packed = zipfile.ZipFile(download.value.path())
    assert packed.namelist() == ["street.rectified.jpg", "large.rectified.jpg", "other.jpg"]
    assert packed.read("other.jpg") == other.read_bytes()
    with page.expect_download() as download:
        page.get_by_role("button", name="Save all (zip)").click()
        page.keyboard.press("Enter")
    assert zipfile.ZipFile(download.value.path()).namelist() == ["street.rectified.jpg", "large.rectified.jpg"]
    page.get_by_role("button", name="Straightened 2").click()
    with page.expect_download() as download:  # all that the filter shows are changed: there is nothing to ask
        page.get_by_role("button", name="Save these 2 (zip)").click()
    assert zipfile.ZipFile(download.value.path()).namelist() == ["street.rectified.jpg", "large.rectified.jpg"]
    page.evaluate("""() => new MutationObserver((_, observer) => {
        const box = document.getElementById('saving');
        if (!box.hidden) { observer.disconnect(); document.getElementById('stopSaving').click(); }
    }).observe(document.getElementById('saving'), { attributes: true })""")
    page.get_by_role("button", name="Save these 2 (zip)").click()
    expect(page.locator("#notice")).to_contain_text("Cancelled")
    page.get_by_role("button", name="All 4").click()
    page.get_by_role("button", name="Save all (zip)").click()
    page.get_by_role("dialog").get_by_role("button", name="Cancel").click()
    expect(page.locator("#saving")).to_be_hidden()
    page.get_by_role("button", name="Close bad.jpg").click()
    expect(page.locator("#thumbnails li")).to_have_count(3)


def test_two_tabs(page: Page, server: Server, photo: Path) -> None:
    other = page.context.new_page()
    other.goto(server.link)
    drop(page, photo)
    drop(other, photo)
    wait_for(page)
    wait_for(other)
    page.locator("#strength").fill("0")
    expect(page.locator("#panel .said")).to_contain_text("as you asked")
    expect(other.locator("#panel .said")).to_contain_text("Straightened")
    page.close()
    other.locator("#strength").fill("50")
    wait_for(other)


def test_a_server_that_is_killed_and_started_again(chromium: Browser, tmp_path: Path, photo: Path) -> None:
    page = chromium.new_page()
    page.set_default_timeout(SLOW_MS)
    with served(tmp_path / "home") as first:
        page.goto(first.link)
        drop(page, photo)
        wait_for(page)
        first.kill()
        page.locator("#strength").fill("0")
        expect(page.locator("#notice")).to_contain_text("does not answer")
    with served(tmp_path / "home", port=first.port):
        expect(page.locator("#notice")).to_be_hidden()
        expect(page.locator("#panel .said")).to_contain_text("as you asked")  # the photo was sent again
    with served(tmp_path / "home", port=first.port, token="another-token"):
        page.locator("#strength").fill("100")
        expect(page.locator("#notice")).to_contain_text("This link is not valid")
    page.close()


def test_a_frame_taken_after_and_the_moment_between(page: Page, tmp_path: Path) -> None:
    scene = Scene()
    frames = [tmp_path / f"frame{number}.png" for number in range(2)]
    for number, frame in enumerate(frames):
        Photo.from_array(scene.frame(number, 0.8)).save(frame)
    drop(page, frames[0])
    wait_for(page, "changed|alone")
    page.set_input_files("#choose-after", frames[1])
    enter(page, "#ratio", "0.8")
    expect(page.locator("#panel .said")).to_contain_text("with the help of its neighbours")
    page.locator("#edges").select_option("keep")
    expect(page.locator("#panel .said")).to_contain_text("stay empty")
    wait_for(page)
    flags = ["--after", frames[1], "--readout-ratio", "0.8", "--edges", "keep"]
    assert saved(page) == rectified(frames[0], *flags)
    page.get_by_label("Take it at another moment").check()
    expect(page.locator("output[for=at]")).to_have_text("50 % of the way to the frame after")
    page.locator("#at").fill("0.75")
    expect(page.locator("output[for=at]")).to_have_text("75 % of the way to the frame after")
    page.get_by_text("More", exact=True).click()
    page.locator("#model").select_option("dense")
    page.get_by_label("use the photo alone").check()
    expect(page.locator("#panel .said")).to_contain_text("with the help of its neighbours")
    wait_for(page)
    assert saved(page) == rectified(frames[0], *flags, "--at", "0.75", "--model", "dense", "--fallback")
