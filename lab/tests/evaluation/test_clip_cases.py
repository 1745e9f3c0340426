"""The protocol ``sequences``: frames-camera is judged with the ratio given and without, beside methods on one photo."""

import numpy as np
import pytest

from support.drawn_photos import textured
from support.hand_held import hand
from unshutter import Photo
from unshutter.single.register import load
from unshutter_lab.evaluation import clip_cases
from unshutter_lab.evaluation.clip_cases import RATIO_ESTIMATED, RATIO_KNOWN, RATIOS
from unshutter_lab.evaluation.protocols import PROTOCOLS, Request


@pytest.fixture
def cases(tmp_path, monkeypatch):
    """Of one photo and one log; shorter and smaller than the protocol's own."""
    for name, value in {"_FRAMES": 16, "_HEIGHT": 180, "_WIDTH": 320, "_FOCAL": 275.0, "_EVERY": 8}.items():
        monkeypatch.setattr(clip_cases, name, value)
    (tmp_path / "photos").mkdir()
    Photo.from_array(textured(240, 400)).save(tmp_path / "photos" / "wall.png")
    log = hand(4)
    gyro = np.stack([log.yaw_rad_s, -log.pitch_rad_s, log.roll_rad_s], axis=1)  # up is x, back is z, right is -y
    np.savez(tmp_path / "log.npz", t_s=log.t_s, gyro_rad_s=gyro)
    request = Request("sequences", (tmp_path / "photos",), trajectory=tmp_path / "log.npz")
    return PROTOCOLS["sequences"].cases(request)


def test_each_ratio_is_a_case(cases):
    assert [case.ratio for case in cases] == list(RATIOS)
    assert len({case.key for case in cases}) == len(RATIOS)


def test_frames_beat_a_photo_that_is_left_alone(cases):
    records = {record["estimator"]: record for record in cases[2].judge(["none", RATIO_ESTIMATED, RATIO_KNOWN], load)}
    assert records["none"]["epe"] == pytest.approx(records["none"]["epe_nothing"])
    assert records[RATIO_KNOWN]["epe"] < 0.3 < records[RATIO_KNOWN]["epe_nothing"]
    assert "ratio_error" not in records[RATIO_KNOWN] and "ratio_told" in records[RATIO_ESTIMATED]
    if records[RATIO_ESTIMATED]["ratio_told"]:
        assert records[RATIO_ESTIMATED]["ratio_error"] < 0.1


def test_a_sequence_is_shown(cases):
    example = cases[2].show(["none"], load)
    assert list(example.curves) == ["truth", "none", RATIO_ESTIMATED]
    assert len({picture.shape for _, picture in example.pictures}) == 1
