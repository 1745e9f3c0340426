"""Rendered clips: the exact map is the bound, and shares are of its gain."""

import pytest

from unshutter.single import register
from unshutter_lab.evaluation.case import Record
from unshutter_lab.evaluation.clip_tables import rendered_clip_tables
from unshutter_lab.evaluation.protocols import PROTOCOLS, Request
from unshutter_lab.evaluation.rendered_clips import CLIPS, EXACT, GIVEN, RenderedClipCase
from unshutter_lab.evaluation.results import Results
from unshutter_lab.evaluation.tables import tables
from unshutter_lab.synthesis.panorama import shipped_places
from unshutter_lab.synthesis.rendered_places import ClipSettings

SMALL = ClipSettings("small", 30, 20, 6, 20, height=144, width=256)


def test_the_true_motion_gains_nearly_what_the_exact_map_does() -> None:
    case = RenderedClipCase(SMALL, shipped_places()["potsdamer_platz"], 0)
    before, given, exact = case.judge(["none", GIVEN, EXACT], register.load)
    assert before["psnr"] == before["psnr_input"] == exact["psnr_input"] and before["share"] == before["least"] == 0
    assert exact["share"] == exact["share_whole"] == 1 and exact["psnr"] > before["psnr"] + 5
    assert 0.8 < given["share"] < 1.1 and given["straightened"] > 0.9
    assert given["share"] == pytest.approx((given["psnr"] - before["psnr"]) / (exact["psnr"] - before["psnr"]))
    assert given["shift_px"] == pytest.approx(6, rel=0.1)


def test_the_protocol_needs_no_data() -> None:
    cases = PROTOCOLS["rendered-clips"].cases(Request("rendered-clips", ()))
    assert [case.place["photo"] for case in cases] == [clip.name for clip in CLIPS]
    assert len({case.place["group"] for case in cases}) == len(CLIPS)  # each in a place of its own


def record(name: str, psnr: float, **more: object) -> Record:
    place = {"suite": "rendered", "group": "square", "photo": "walk", "draw": 0, "estimator": name}
    figures = {"psnr": psnr, "psnr_input": 30.0, "least": -0.5, "share": (psnr - 30) / 8, "shift_px": 6.0}
    return place | figures | {"psnr_whole": 29.0, "share_whole": 0.5, "true_ms": 20.0} | more


def test_the_page_says_what_each_way_gains_and_what_was_found() -> None:
    found = {
        "frames": 60,
        "straightened": 0.9,
        "readout_ms": 21.0,
        "readout_error_ms": 0.4,
        "corner_px": 4.25,
        "left": "",
    }
    names = ["none", "unshutter", GIVEN, EXACT]
    records = [record("none", 30.0), record("unshutter", 36.0, **found), record(GIVEN, 29.0, **found)]
    results = Results(Request("rendered-clips", ()), names, [], [*records, record(EXACT, 38.0)])
    page = rendered_clip_tables(results)
    assert "| walk | 30.00 | 36.00 (0.75) | **29.00 (-0.12)** | 38.00 (1.00) |" in page
    assert "| walk | 6.0 | 20.0, 21.0 ± 0.4 | +4.2 | -0.50 | 0.50 | 54 of 60 frames straightened |" in page
    assert "| walk | unshutter | 6.0 px | 36.00 dB | +6.00 dB | 0.750 |" in tables(results)
