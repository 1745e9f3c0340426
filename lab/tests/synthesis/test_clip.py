"""``unshutter synthesize --video``: both videos, and what is told where they cannot be."""

import cv2
import numpy as np
import pytest

from support import clips
from unshutter.cli import main


@pytest.fixture
def given(tmp_path):
    photo, log = tmp_path / "photo.png", tmp_path / "log.npz"
    cv2.imwrite(str(photo), np.repeat(clips.wall()[..., None], 3, axis=2))
    times = np.arange(0, 3, 0.01)
    gyro = np.stack([np.sin(9 * times), np.cos(7 * times), 0.5 * np.sin(11 * times)], axis=-1)
    np.savez(log, t_s=times, gyro_rad_s=gyro)
    words = ["synthesize", str(photo), "-o", str(tmp_path / "made"), "--video", "--motion", "trajectory"]
    return [*words, "--trajectory", str(log), "--focal-px", "165", "--frame", "192x144", "--seconds", "0.5"]


def test_undoing_what_was_made_leads_to_the_truth(tmp_path, given):
    assert main([*given, "--readout-ms", "20"]) == 0
    made, out = tmp_path / "made", tmp_path / "out.mp4"
    assert [s["type"] for s in clips.facts(made / "rs.mp4")["streams"]] == ["video", "audio"]
    flags = ["--readout-ms", "20", "--crf", "2", "--edges", "fill"]  # the truth is not enlarged
    assert main(["video", str(made / "rs.mp4"), "-o", str(out), *flags]) == 0
    was, now, seen = (clips.luma(path) for path in (made / "rs.mp4", out, made / "gs.mp4"))
    assert clips.psnr(now, seen) > clips.psnr(was, seen) + 4


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        (["--readout-ms", "40"], "longer than a frame"),
        (["--readout-ms", "20", "--frame", "tiny"], "1920x1080"),
        (["--readout-ms", "20", "--frame", "191x144"], "even"),
    ],
)
def test_what_cannot_be(tmp_path, given, capsys, flags, told):
    assert main([*given, *flags]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "made").exists()
