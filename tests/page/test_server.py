"""The server as a process: what it gives programs."""

import json
from pathlib import Path

import httpx
import numpy as np
import pytest

from support import clips
from support.batches import rectified
from support.camera_files import heic
from support.covering import thorough
from support.frame_pairs import Scene
from support.page_server import events, facts, opened, run_command, saving, sent, zipped
from unshutter.photo import Photo

# ---- what it gives ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        thorough({}),
        {"strength": "0.5", "edges": "crop"},
        {"format": "png", "roll-deg": "1"},
        thorough({"strength": "0"}),
    ],
)
def test_a_picture_is_the_command_lines_to_the_byte(
    client: httpx.Client, photo: Path, tmp_path: Path, options: dict[str, str]
) -> None:
    flags = [word for name, value in options.items() if name != "format" for word in (f"--{name}", value)]
    expected = tmp_path / f"expected.{options.get('format', 'jpg')}"
    run_command("rectify", photo, "-o", expected, *flags)
    id = opened(client, photo)
    for _ in range(2):
        saved = client.get(f"/api/photos/{id}/picture", params=options)
        assert saved.content == expected.read_bytes()
        client.get(f"/api/photos/{id}/after", params=options)  # whose motion is then used again
    assert facts(saved)["changed"] == (options.get("strength") != "0")
    changed_name = "street.jpg.rectified.png" if "format" in options else "street.rectified.jpg"
    name = "street.jpg" if options.get("strength") == "0" else changed_name
    assert json.loads(saved.headers["unshutter-name"]) == name


def test_a_motion_is_the_command_lines(client: httpx.Client, photo: Path, tmp_path: Path) -> None:
    run_command("estimate", photo, "-o", tmp_path / "motion.json", "--reference", "last")
    answer = client.get(f"/api/photos/{opened(client, photo)}/motion", params={"reference": "last"})
    assert answer.text == (tmp_path / "motion.json").read_text()


def test_candidates_are_the_command_lines(client: httpx.Client, photo: Path, tmp_path: Path) -> None:
    run_command("estimate", photo, "-o", tmp_path / "candidates.json", "--candidates")
    id = opened(client, photo)
    listed = client.get(f"/api/photos/{id}/candidates").json()
    kinds = [each["kind"] for each in json.loads((tmp_path / "candidates.json").read_text())["candidates"]]
    assert [each["kind"] for each in listed] == kinds and listed[0]["taken"]
    run_command("rectify", photo, "-o", tmp_path / "expected.jpg", "--candidate", "2")
    picture = client.get(f"/api/photos/{id}/picture", params={"candidate": "2"})
    assert picture.content == (tmp_path / "expected.jpg").read_bytes()
    few = client.get(f"/api/photos/{id}/after", params={"candidate": "9"})
    assert few.status_code == 422 and "there is no candidate 9" in few.json()["error"]


def test_neighbours_are_open_photos(client: httpx.Client, tmp_path: Path) -> None:
    frames = [tmp_path / f"frame{number}.png" for number in range(2)]
    for number, frame in enumerate(frames):
        Photo.from_array(Scene().frame(number, 0.8)).save(frame)
    id, after = (opened(client, frame) for frame in frames)
    answer = client.get(f"/api/photos/{id}/picture", params={"after": after, "readout-ratio": "0.8"})
    run_command("rectify", frames[0], "-o", tmp_path / "out.png", "--after", frames[1], "--readout-ratio", "0.8")
    assert answer.content == (tmp_path / "out.png").read_bytes()
    Photo.from_array(Scene().frame(1, 0.8)[:100]).save(tmp_path / "smaller.png")
    smaller = {"after": opened(client, tmp_path / "smaller.png"), "readout-ratio": "0.8"}
    refused = client.get(f"/api/photos/{id}/picture", params=smaller)
    assert refused.status_code == 422 and "its neighbour has 240x100 px" in refused.json()["error"]
    assert client.get(f"/api/photos/{id}/after", params={"before": "x", "readout-ratio": "0.8"}).status_code == 404


def test_what_the_page_is_told(client: httpx.Client, photo: Path) -> None:
    id = opened(client, photo)
    size = facts(client.get(f"/api/photos/{id}/before", params={"longest": "320"}))
    assert (size["width"], size["height"]) == (560, 420)
    told = facts(client.get(f"/api/photos/{id}/after", params={"longest": "320", "edges": "crop"}))
    assert told["changed"] and told["edges"] == "crop" and len(told["tx_px"]) == len(told["rz_deg"])
    left, top, right, bottom = told["crop"]
    assert (right - left) * (bottom - top) == pytest.approx(told["area_left"], abs=1e-6)
    lines = client.get(f"/api/photos/{id}/segments").json()
    assert len(lines["before"]) == len(lines["after"]) > 20
    assert all(-0.5 < share < 1.5 for line in lines["after"] for share in line)


# ---- saving many ---------------------------------------------------------------------------------------


def test_a_zip_file_of_all(client: httpx.Client, photo: Path) -> None:
    """One that cannot be saved does not spoil the others."""
    broken = sent(client, "../../broken.jpg", b"no photo")
    photos = [{"id": opened(client, photo)}, {"id": opened(client, photo), "options": {"strength": "0.5"}}]
    done, packed = zipped(client, [{"id": broken}, *photos])
    assert "is not a JPEG" in done[0]["error"] and "/" not in done[0]["error"]
    assert [one["changed"] for one in done[1:]] == [True, True]
    assert packed.namelist() == ["street.rectified.jpg", "street.rectified-2.jpg"]
    assert packed.read("street.rectified-2.jpg") == rectified(photo, "--strength", "0.5")


@pytest.mark.parametrize("only_changed", [True, False])
def test_unchanged_ones_keep_their_names_or_are_left_out(
    client: httpx.Client, photo: Path, tmp_path: Path, only_changed: bool
) -> None:
    still = clips.write(tmp_path / "still.mp4", [clips.moving(2)[1][0]] * 8)
    grey = heic(np.full((300, 400, 3), 128, np.uint8))
    photos = [{"id": each} for each in (*(sent(client, "IMG_1.HEIC", grey) for _ in range(2)), opened(client, photo))]
    items = [*photos, {"id": opened(client, still, "clips"), "options": {"readout-ratio": "0.6"}}]
    done, packed = zipped(client, items, only_changed=only_changed)
    unchanged = [] if only_changed else ["IMG_1.HEIC", "IMG_1-2.HEIC"]
    assert packed.namelist() == [*unchanged, "street.rectified.jpg", *([] if only_changed else ["still.mp4"])]
    assert [each.get("result") for each in done].count(None) == (3 if only_changed else 0)
    assert all(packed.read(name) == grey for name in unchanged)
    assert only_changed or packed.read("still.mp4") == still.read_bytes()


def test_saving_is_cancelled(client: httpx.Client, photo: Path) -> None:
    id = opened(client, photo)
    hanging = {"id": id, "options": {"estimator": "hanging"}}
    task = saving(client, [{"id": id}, hanging])
    next(told for told in events(client, task) if len(told["done"]) == 1)
    assert client.delete(f"/api/saves/{task}").json()["state"] == "cancelled"
    assert client.get(f"/api/saves/{task}/file").status_code == 404
    assert client.get(f"/api/photos/{id}/after").status_code == 200


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (b"nonsense", "send JSON"),
        (b'{"to": "mail", "photos": []}', "'to' takes file or zip"),
        (b'{"to": "zip", "photos": []}', "at least one"),
        (b'{"to": "zip", "photos": ["x"]}', "each photo is"),
        (b'{"to": "zip", "photos": [{"id": "x", "options": {"strength": 1}}]}', "each photo is"),
        (b"[" * 100_000, "send JSON"),
        (b'{"to": "zip", "photos": ' + b'[{"a":' * 30_000, "send JSON"),
        (b'{"to": "zip", "photos": [{"id": ' + b"[" * 900 + b"]" * 900 + b"}]}", "each photo is"),
    ],
)
def test_savings_that_are_refused(client: httpx.Client, body: bytes, told: str) -> None:
    answer = client.post("/api/saves", content=body)
    assert answer.status_code == 400 and told in answer.json()["error"]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (b'{"\\ud800": "x"}', "each photo is"),  # half a character is no text
        (b'{"estimator": "\\ud800"}', "each photo is"),
        (b'{"a\\nb\\u001b": "x"}', "unknown field 'a\\nb\\x1b'"),
    ],
)
def test_refusals_are_one_line(client: httpx.Client, photo: Path, options: bytes, told: str) -> None:
    body = b'{"to": "zip", "photos": [{"id": "%s", "options": %s}]}' % (opened(client, photo).encode(), options)
    answer = client.post("/api/saves", content=body)
    assert answer.status_code == 400 and answer.json()["error"].startswith(told)
