"""What the page shows: positions, compared with pictures that are turned upright, and the video of a clip."""

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from unshutter.orientation import Orientation, ScanDirection
from unshutter.page import clip_jobs
from unshutter.page.screen import arrows, corners_of, shares


@pytest.mark.parametrize("orientation", list(Orientation))
def test_positions_go_with_their_pixels(orientation: Orientation) -> None:
    pixels = np.zeros((30, 50, 3), np.uint8)
    pixels[7, 12] = 255
    row, col, _ = np.argwhere(orientation.upright(pixels))[0]
    height, width = orientation.upright(pixels).shape[:2]
    ((across, down),) = shares([12], [7], (50, 30), orientation)
    assert (across, down) == pytest.approx(((col + 0.5) / width, (row + 0.5) / height))


@pytest.mark.parametrize("orientation", list(Orientation))
def test_windows_go_with_their_pixels(orientation: Orientation) -> None:
    pixels = np.zeros((30, 50, 3), np.uint8)
    pixels[3:20, 10:45] = 255
    turned = orientation.upright(pixels)
    rows, cols, _ = np.nonzero(turned)
    height, width = turned.shape[:2]
    expected = [cols.min() / width, rows.min() / height, (cols.max() + 1) / width, (rows.max() + 1) / height]
    assert corners_of((10 / 50, 3 / 30, 45 / 50, 20 / 30), orientation) == pytest.approx(expected)


def test_arrows() -> None:
    assert arrows(1) == {
        ScanDirection.TOP_TO_BOTTOM: "down",
        ScanDirection.BOTTOM_TO_TOP: "up",
        ScanDirection.LEFT_TO_RIGHT: "right",
        ScanDirection.RIGHT_TO_LEFT: "left",
    }
    assert (
        arrows(6)[ScanDirection.TOP_TO_BOTTOM] == "left"
    )  # a phone held upright: stored rows stand, the first on the right
    for orientation in Orientation:
        assert sorted(arrows(orientation).values()) == ["down", "left", "right", "up"]


def test_the_video_of_a_clip_shows_no_blocks(tmp_path: Path) -> None:
    """A constant quality: at a fixed bit rate, fine detail that turned came out in blocks (32 dB)."""
    leaves = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (360, 640)).astype(np.uint8), (0, 0), 1)
    leaves = cv2.cvtColor(leaves, cv2.COLOR_GRAY2RGB).astype(float)
    leaves = np.clip(128 + 4 * (leaves - leaves.mean()), 0, 255).astype(np.uint8)
    turns = [cv2.getRotationMatrix2D((320, 180), 2.0 * k, 1.0) for k in range(16)]
    frames = [cv2.warpAffine(leaves, turn, (640, 360), borderMode=cv2.BORDER_REFLECT) for turn in turns]
    pairs = [np.concatenate([frame, frame], axis=1) for frame in frames]
    clip_jobs._write(tmp_path / "video.webm", iter(pairs), 1 / 30)
    with av.open(str(tmp_path / "video.webm")) as video:
        shown = [frame.to_ndarray(format="rgb24")[:, :640] for frame in video.decode(video=0)]
    assert min(cv2.PSNR(one, other) for one, other in zip(frames, shown, strict=True)) > 34
