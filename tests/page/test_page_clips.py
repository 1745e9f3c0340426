"""Clips on the page, in a real browser."""

import re
from pathlib import Path

import av
import httpx
import pytest
from playwright.sync_api import Page, Route, expect

from support import clips
from support.browser import drop, enter, saved, wait_for
from support.page_server import Server, becomes, facts, opened, run_command
from unshutter import version

GREYS = clips.moving(24)[1]
FOUND_MS = 60_000  # a readout time may take so long to be found while others work


@pytest.fixture(scope="module")
def stroll(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Too short to show its readout time, for tests that state it: nothing is searched for."""
    return clips.write(tmp_path_factory.mktemp("clips") / "stroll.mp4", GREYS[:14])


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clips.write(tmp_path_factory.mktemp("clips") / "walk.mp4", GREYS[:14], sound=True)


def _give_readout(page: Page, value: str = "20") -> None:
    page.locator("#clip-readout-unit").select_option("ms")
    enter(page, "#clip-readout", value)


def _shown(page: Page) -> tuple[str, str]:
    """The addresses of the pictures before and after."""
    return tuple(page.locator(f".layer.{which} img").get_attribute("src") or "" for which in ("before", "after"))


def test_a_first_look_comes_before_the_readout_time_is_known_and_then_the_clip_can_be_saved(
    page: Page, walk: Path
) -> None:
    asked: list[Route] = []
    page.route("**/readout?*", lambda route: asked.append(route))  # which has no answer yet
    drop(page, walk)
    drawn = "() => [...document.querySelectorAll('#moments canvas')].filter(node => node.width > 40).length === 5"
    page.wait_for_function(drawn)
    expect(page.locator("#moments .coming")).to_have_count(5)
    expect(page.locator("#player")).to_contain_text("Finding the readout time and the motion")
    expect(page.locator("#clip-panel .said")).to_contain_text("This is a first look", timeout=FOUND_MS)
    first, after = _shown(page)
    assert first != after
    save = page.get_by_role("button", name="Save this clip")
    expect(save).to_be_disabled()
    expect(page.get_by_text("There is nothing to save until the readout time of the clip is known.")).to_be_visible()
    assert len(asked) == 1
    asked[0].continue_()
    page.unroute("**/readout?*")
    _give_readout(page)
    wait_for(page, "done", 1)
    expect(save).to_be_enabled()


def test_dropped_looked_at_and_saved(page: Page, tmp_path: Path, photo: Path) -> None:
    walk = clips.write(tmp_path / "walk.mp4", GREYS, sound=True)
    drop(page, photo, walk)
    wait_for(page, "changed", 1)
    wait_for(page, "done", 2)  # after the photos, although nobody looks at it
    state = page.locator("#thumbnails li:nth-child(2) .state")
    assert saved(page, "Save all")
    expect(state).to_have_text("saved")
    page.get_by_title("walk.mp4").click()
    expect(page.locator("#panel")).to_be_hidden()
    _give_readout(page)
    wait_for(page, "done", 2)
    expect(page.locator("#clip-panel .said")).to_contain_text("some places moved by up to")
    before, after = _shown(page)
    assert before != after
    expect(page.locator("#moments button")).to_have_count(5)
    page.get_by_role("button", name="The clip at 0:00.1").click()
    expect(page.locator("#moments [aria-pressed=true]")).to_contain_text("0:00.1")
    wait_for(page, "done", 2)
    assert _shown(page)[0] != before
    page.locator("#clip-strength").fill("0")
    expect(page.locator("#clip-panel .said")).to_contain_text("as you asked")
    page.locator("#clip-strength").fill("100")
    wait_for(page, "done", 2)
    with page.expect_download(timeout=FOUND_MS) as download:
        page.keyboard.press("s")
    assert download.value.suggested_filename == "walk.rectified.mp4"
    assert len(clips.luma(download.value.path())) == 24
    expect(page.locator("#notice")).to_contain_text("24 of 24 frames straightened")
    listed = page.locator("#notice").get_attribute("title") or ""
    assert {"replaced: track 1 ('vide', 'avc1')", "carried: track 2 ('soun', 'mp4a')"} <= {*listed.splitlines()}
    page.get_by_title("street.jpg").click()
    expect(page.locator("#clip-panel")).to_be_hidden()
    expect(page.locator("#moments")).to_be_hidden()


def test_the_usual_readout_time_is_taken_where_a_clip_does_not_show_its_own(page: Page, tmp_path: Path) -> None:
    drop(page, clips.write(tmp_path / "still.mp4", clips.standing(30)))
    state = page.locator("#thumbnails li .thumbnail")
    expect(state).to_have_attribute("data-state", "done", timeout=FOUND_MS)
    usual = "15.8 ms is used. That is usual for cameras and phones (anything from 4.7 to 32.3 ms)"
    expect(page.locator("#clip-panel")).to_contain_text(usual)
    _give_readout(page, "400")
    expect(page.locator("#clip-panel .said")).to_contain_text("33.33 ms apart")
    expect(page.locator("#working")).to_be_empty()  # said once
    expect(page.locator("#clip-panel .said")).to_contain_text("If you know how long your camera takes")
    expect(page.get_by_role("button", name="Save this clip")).to_be_disabled()
    _give_readout(page, "20")
    wait_for(page, "done")
    expect(page.locator("#clip-panel .said")).to_contain_text("left unchanged: the camera stood still")
    page.get_by_role("button", name="Save this clip").click()
    unchanged = "still.mp4: nothing was saved, since no frame was straightened: the camera stood still."
    expect(page.locator("#notice")).to_have_text(unchanged, timeout=FOUND_MS)


def test_the_readout_time_is_found(page: Page, tmp_path: Path) -> None:
    with page.expect_response("**/readout?*", timeout=FOUND_MS) as response:
        drop(page, clips.write(tmp_path / "long.mp4", clips.moving(40)[1]))
    wobble_px = response.value.json()["wobble_px"]
    expect(page.locator("#thumbnails li .thumbnail")).to_have_attribute("data-state", "done", timeout=FOUND_MS)
    expect(page.locator("#clip-panel")).to_contain_text(re.compile(r"Found: (19|20|21)\.\d ± [01]\.\d ms"))
    assert wobble_px > 0.1
    digits = 2 if wobble_px < 1 else 1
    expect(page.locator("#clip-panel")).to_contain_text(f"wobbles by {wobble_px:.{digits}f} px from frame")


def test_progress_and_cancelling(page: Page, tmp_path: Path) -> None:
    drop(page, clips.write(tmp_path / "long.mp4", GREYS * 20, options={"preset": "ultrafast", "crf": "30"}))
    _give_readout(page)
    page.locator("#clip-edges").select_option("keep")  # which needs no look at all frames first
    wait_for(page, "done", timeout=FOUND_MS)
    page.get_by_role("button", name="Save this clip").click()
    expect(page.locator("#saving-words")).to_have_text(re.compile(r"long\.mp4: frame \d+ of 480"), timeout=FOUND_MS)
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator("#notice")).to_have_text("Cancelled.", timeout=FOUND_MS)
    expect(page.locator("#saving")).to_be_hidden()
    page.locator("#clip-strength").fill("50")  # it goes on as before
    wait_for(page, "done", timeout=FOUND_MS)


def test_a_search_that_is_cancelled_waits_for_the_user(page: Page, tmp_path: Path) -> None:
    drop(page, clips.write(tmp_path / "long.mp4", clips.moving(60)[1]))
    page.locator("#player").get_by_role("button", name="Cancel").click()
    wait_for(page, "asking")
    expect(page.locator("#clip-panel .said")).to_contain_text("The search for the readout time was cancelled.")
    page.locator("#clip-strength").fill("50")  # does not begin it again
    expect(page.get_by_role("button", name="Save this clip")).to_be_disabled()
    wait_for(page, "asking")


@pytest.mark.thorough
def test_a_search_that_was_cancelled_is_begun_again(page: Page, tmp_path: Path) -> None:
    drop(page, clips.write(tmp_path / "long.mp4", clips.moving(60)[1]))
    page.locator("#player").get_by_role("button", name="Cancel").click()
    wait_for(page, "asking")
    page.locator("#clip-readout-unit").select_option("find")
    expect(page.locator("#thumbnails li .thumbnail")).to_have_attribute("data-state", "done", timeout=FOUND_MS)
    expect(page.locator("#clip-panel")).to_contain_text("Found: ")


def test_a_clip_that_is_cut_off(page: Page, tmp_path: Path, walk: Path) -> None:
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(walk.read_bytes()[: walk.stat().st_size // 2])
    drop(page, cut)
    wait_for(page, "failed")
    text = "Cannot read the clip: no video that can be read; the file may be cut off or damaged."
    next_step = "Close it with ×, and choose a photo or a clip (.mp4, .mov, .mkv …)."
    expect(page.locator("#stage .message")).to_have_text(f"{text} {next_step}")
    expect(page.locator("#zoom")).to_be_hidden()  # there is nothing to look at


def test_without_the_extra(page: Page, server: Server, walk: Path) -> None:
    def without(route: Route) -> None:
        route.fulfill(json={**route.fetch().json(), "clips": False})

    page.route("**/api/about", without)
    with page.expect_response("**/api/about") as answer:
        page.goto(server.link)
    answer.value.finished()
    drop(page, walk)
    expect(page.locator("#notice")).to_contain_text(version.extra("video"))  # from where this one was installed
    expect(page.locator("#empty")).to_be_visible()


def _canvas(page: Page, which: str) -> list[int]:
    """Some pixels of one half of the video."""
    return page.locator(f".layer.{which} canvas").evaluate(
        """canvas => [...canvas.getContext("2d").getImageData(0, canvas.height / 2, canvas.width, 1).data]"""
    )


def test_before_and_after_play_in_step(page: Page, stroll: Path) -> None:
    drop(page, stroll)
    _give_readout(page)
    wait_for(page, "done")
    with page.expect_response("**/film?*readout-ms=20*", timeout=FOUND_MS) as response:
        page.get_by_role("button", name="Play before and after").click()
    assert response.value.headers["content-type"] == "video/webm"
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    page.wait_for_function("() => Number(document.querySelector('#play-at').value) > 0.1")
    expect(page.locator(".layer canvas")).to_have_count(2)
    page.keyboard.press("p")
    expect(page.get_by_role("button", name="Play before and after")).to_be_visible()
    frames: set[tuple[int, ...]] = set()

    def shows_another_frame() -> bool:
        for place in ("0.1", "0.9"):  # as often as it takes: a busy machine draws a frame long after it was asked for
            page.locator("#play-at").fill(place)
            page.wait_for_timeout(300)
            frames.add(tuple(_canvas(page, "before")))
        return len(frames) > 1

    assert becomes(shows_another_frame)
    assert _canvas(page, "before") != _canvas(page, "after")  # the same frame, straightened
    page.locator("#clip-strength").fill("50")  # another wish: the video is gone
    expect(page.locator(".layer canvas")).to_have_count(0)


def test_the_camera_of_a_clip_is_searched_in_the_table_and_its_readout_again_for_another_direction(
    page: Page, stroll: Path
) -> None:
    drop(page, stroll)
    page.locator("#clip-readout-unit").select_option("camera")
    names = page.locator("#clip-camera-known option").evaluate_all("nodes => nodes.map(node => node.value)")
    assert len(names) > 50
    with page.expect_response("**/readout?*camera=*", timeout=FOUND_MS):
        page.get_by_label("Camera (type to search)").fill(names[0])
        page.get_by_label("Camera (type to search)").press("Enter")
    page.locator("#clip-panel").get_by_text("Advanced").click()
    with page.expect_response("**/readout?*readout=bottom-to-top*", timeout=FOUND_MS):
        page.locator("#clip-option-readout").select_option("bottom-to-top")


def test_the_field_for_the_readout_time_shows_where_it_is_asked_for(page: Page, walk: Path) -> None:
    """A clip whose readout time cannot be found asks for it, once, with the field open."""
    refusal = {
        "error": "this clip does not show its readout time",
        "code": "readout-time-unknown",
        "figures": {"why": "x"},
    }
    page.route("**/readout?*", lambda route: route.fulfill(status=422, json=refusal))
    drop(page, walk)
    wait_for(page, "asking")
    expect(page.locator("#clip-readout")).to_be_visible()
    expect(page.get_by_text("does not show its readout time")).to_have_count(1)


def test_what_a_moment_does_not_show_is_said_where_it_is_set(page: Page, stroll: Path) -> None:
    drop(page, stroll)
    _give_readout(page)
    page.locator("#clip-panel").get_by_text("Advanced").click()
    stabilized = page.get_by_text("“Play before and after” shows it; single moments do not.")
    dense = page.get_by_text("Only in the saved clip do near")
    expect(stabilized).to_be_hidden()
    expect(page.locator("#clip-option-zoom-limit")).to_be_disabled()  # which needs it
    page.get_by_label("Steady the camera").check()
    expect(stabilized).to_be_visible()
    page.locator("#clip-option-model").select_option("dense")
    expect(dense).to_be_visible()


def test_a_steadied_clip_is_the_one_of_the_command_line(page: Page, tmp_path: Path) -> None:
    video = clips.write(tmp_path / "walk.mkv", GREYS[:14], "ffv1")
    drop(page, video)
    _give_readout(page)
    wait_for(page, "done")
    page.get_by_label("Steady the camera").check()
    strengths = page.get_by_label("How steady")
    expect(strengths).to_have_value("2")
    assert strengths.locator("option").evaluate_all("nodes => nodes.map(node => node.value)") == ["1", "2", "4"]
    strengths.select_option("4")
    wait_for(page, "done")
    save = page.get_by_role("button", name="Save this clip")
    place = save.bounding_box()
    steadied = saved(page, "Save this clip")
    expect(page.locator(".thumbnail .state")).to_have_text("saved")
    assert save.bounding_box() == place
    by_command = tmp_path / "steady.mkv"
    run_command("video", video, "-o", by_command, "--readout-ms", "20", "--stabilize", "4")
    assert steadied == by_command.read_bytes()


def test_leaving_asks_only_for_a_clip_that_was_worked_on(page: Page, stroll: Path) -> None:
    leaves = "() => dispatchEvent(new Event('beforeunload', { cancelable: true }))"
    drop(page, stroll)
    wait_for(page, "done", timeout=FOUND_MS)
    assert page.evaluate(leaves)  # it was only looked at
    page.get_by_label("Steady the camera").check()
    assert not page.evaluate(leaves)
    page.get_by_label("Steady the camera").uncheck()
    assert page.evaluate(leaves)


def test_encoders_are_those_of_this_machine(page: Page, stroll: Path, tmp_path: Path) -> None:
    """The lists hold what can be written for the clip; what only another encoder takes is forgotten with it."""
    video = clips.write(tmp_path / "walk.mkv", GREYS[:14], "ffv1")
    drop(page, stroll, video)
    values = "nodes => nodes.map(node => node.value)"
    codec, quality, speed = (page.locator(f"#clip-{name}") for name in ("option-codec", "crf", "option-preset"))
    expect(quality.locator("option")).to_have_text(["visually lossless", "smaller"])
    expect(page.locator("#clip-option-bitrate")).to_be_enabled()
    here = {name for name in ("libx264", "libx265", "libsvtav1", "libvpx-vp9", "ffv1") if _is_here(name)}
    assert set(codec.locator("option").evaluate_all(values)) == {"", *here}  # ProRes takes no 4:2:0
    assert "veryslow" in speed.locator("option").evaluate_all(values)
    page.get_by_title("walk.mkv").click()
    expect(quality).to_be_disabled()  # FFV1 has but one
    expect(page.locator("#clip-option-bitrate")).to_be_disabled()
    expect(speed).to_be_disabled()
    assert set(codec.locator("option").evaluate_all(values)) == {"", *here}
    page.locator("#clip-panel").get_by_text("Advanced").click()
    codec.select_option("libx264")
    expect(quality.locator("option")).to_have_text(["visually lossless", "smaller"])
    quality.select_option("20")
    speed.select_option("ultrafast")
    codec.select_option("ffv1")
    expect(quality).to_have_value("")
    expect(speed).to_have_value("")


def test_lists_of_encoders_follow_frames_and_format(client: httpx.Client, tmp_path: Path) -> None:
    usual = {}
    for ending in (".mov", ".mkv", ".mp4"):
        video = clips.write(tmp_path / f"deep{ending}", GREYS[:3], "libx264", "yuv422p10le")
        told = facts(client.get(f"/api/clips/{opened(client, video, 'clips')}/before"))
        usual[ending] = set(told["encoders"]["usual"])
    deep = {name for name in ("libx264", "prores_ks", "ffv1") if _is_here(name)}
    places = {".mov": {"libx264", "prores_ks"}, ".mkv": deep, ".mp4": {"libx264", "ffv1"}}
    for ending, names in places.items():
        assert usual[ending] & {"libx264", "prores_ks", "ffv1"} == names & deep, ending


def _is_here(encoder: str) -> bool:
    return encoder in av.codecs_available
