"""What is done by hand: lines and numbers through the API, and the motion that is saved."""

import json
import math
from pathlib import Path

import httpx
import numpy as np
import pytest

from support.batches import rectified
from support.page_server import facts, opened
from unshutter import RowMotion
from unshutter.motion.finding import Finding
from unshutter.motion.lean import Lean
from unshutter.orientation import Orientation
from unshutter.page.screen import pixels_of, shares
from unshutter.photo import Photo

UPRIGHTS = json.dumps([["upright", 0.2, 0.1, 0.2, 0.9], ["upright", 0.8, 0.1, 0.8, 0.9]])


def _after(client: httpx.Client, id: str, **options: str) -> dict:
    return facts(client.get(f"/api/photos/{id}/after", params={"longest": "320", **options}))


@pytest.mark.parametrize("orientation", list(Orientation))
def test_positions_on_the_page_and_pixels(orientation: Orientation) -> None:
    col, row = np.array([0.0, 12.5, 49]), np.array([0.0, 7, 29])
    across, down = shares(col, row, (50, 30), orientation).T
    assert pixels_of(across, down, (50, 30), orientation) == pytest.approx(np.stack([col, row], axis=1))


def test_numbers_start_at_the_estimate_and_change_it(client: httpx.Client, photo: Path) -> None:
    id = opened(client, photo)
    shape = _after(client, id)["shape"]
    assert abs(shape["lean_deg"]) > 1
    changed = _after(client, id, **{"lean-deg": "2.5"})
    assert changed["changed"] and changed["confidence"] is None
    assert changed["shape"] == pytest.approx(shape | {"lean_deg": 2.5}, abs=0.01)
    found = Finding.from_json(client.get(f"/api/photos/{id}/motion", params={"lean-deg": "2.5"}).text)
    motion = found.motion
    assert found.estimator == "by-hand"
    assert motion.tx_px[-1] - motion.tx_px[0] == pytest.approx(math.tan(math.radians(2.5)) * motion.height)
    assert _after(client, id, **{"lean-deg": "2.5", "strength": "2"})["shape"] == changed["shape"]


def test_what_is_saved_is_what_the_motion_file_says(
    client: httpx.Client, server_home: Path, photo: Path, tmp_path: Path
) -> None:
    id = opened(client, photo)
    wishes = {"lean-deg": "-3", "bend-percent": "1", "turn-deg": "1.5", "edges": "keep", "strength": "1.5"}
    (tmp_path / "motion.json").write_text(client.get(f"/api/photos/{id}/motion", params=wishes).text)
    expected = rectified(photo, "--motion", tmp_path / "motion.json", "--edges", "keep", "--strength", "1.5")
    assert client.get(f"/api/photos/{id}/picture", params=wishes).content == expected
    assert not list(server_home.rglob("hand-*.json"))  # a file that nothing would read


def test_lines_straighten_a_photo_that_shows_nothing(client: httpx.Client, tmp_path: Path) -> None:
    Photo.from_array(np.full((300, 400, 3), 128, np.uint8)).save(tmp_path / "grey.png")
    id = opened(client, tmp_path / "grey.png")
    assert not _after(client, id)["changed"]
    leaning = json.dumps(
        [["upright", 0.2, 0.1, 0.25, 0.9], ["upright", 0.7, 0.1, 0.75, 0.9], ["level", 0.1, 0.5, 0.9, 0.5]]
    )
    result = _after(client, id, lines=leaning)
    assert result["changed"]
    assert result["shape"]["lean_deg"] == pytest.approx(math.degrees(math.atan(0.05 * 400 / (0.8 * 300))), abs=1)
    assert not _after(client, id, lines=UPRIGHTS)["changed"]


def test_a_draft_is_the_same_picture_sooner(client: httpx.Client, photo: Path) -> None:
    id = opened(client, photo)
    draft = _after(client, id, **{"lean-deg": "2", "draft": "1", "edges": "keep"})
    whole = _after(client, id, **{"lean-deg": "2", "edges": "keep"})
    assert draft["shape"] == whole["shape"] and draft["edges"] is None
    assert draft["largest_px"] == pytest.approx(whole["largest_px"], rel=0.02)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lines": "upright"}, "'lines' takes JSON"),
        ({"lines": '[["upright", 0.1, 0.2, 0.3]]'}, "two numbers"),
        ({"lines": '[["askew", 0.1, 0.2, 0.3, 0.4]]'}, "unknown kind of line"),
        ({"lines": "[]"}, "at least one line"),
        ({"lean-deg": "31"}, "lean-deg must lie between"),
        ({"turn-deg": "nan"}, "turn-deg must lie between"),
    ],
)
def test_what_is_refused(client: httpx.Client, photo: Path, options: dict[str, str], message: str) -> None:
    answer = client.get(f"/api/photos/{opened(client, photo)}/after", params=options)
    assert answer.status_code == 400 and message in answer.json()["error"]


def test_a_lean_counts_from_the_first_row_wherever_that_is_put() -> None:
    motion = RowMotion(300, np.linspace(20, 60, 400), np.zeros(400))
    assert vars(Lean.of(motion)) == pytest.approx(
        {"lean_deg": math.degrees(math.atan(0.1)), "bend_percent": 0, "turn_deg": 0}
    )
