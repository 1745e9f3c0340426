"""The range of a clip's levels: its frames look alike with any encoder, whether that can state full range or not."""

import av
import numpy as np
import pytest

from support import clips
from support.covering import thorough
from unshutter import rectify_clip

FULL, LIMITED = 2, 1


def shown(path):
    """(mean, deviation) of the levels of a clip's first frame, as a screen shows it."""
    with av.open(str(path)) as file:
        frame = next(file.decode(video=0))
        full = frame.color_range == FULL
        levels = frame.reformat(format="gray16le", src_color_range=FULL if full else LIMITED, dst_color_range=FULL)
        grey = levels.to_ndarray() / 257
    return float(np.mean(grey)), float(np.std(grey))


@pytest.mark.parametrize("stated", [FULL, LIMITED])
@pytest.mark.parametrize(
    ("encoder", "ending", "pixel_format", "is_kept"),
    [
        ("prores_ks", ".mov", "yuv422p10le", False),
        thorough("prores_ks", ".mkv", "yuv422p10le", False),
        thorough("mpeg4", ".mp4", "yuv420p", False),
        ("mpeg2video", ".mkv", "yuv420p", False),
        thorough("mpeg1video", ".mpg", "yuv420p", False),
        thorough("libvpx-vp9", ".mkv", "yuv420p", True),
        ("libx264", ".mp4", "yuv420p", True),
        thorough("libx265", ".mkv", "yuv420p", True),
        thorough("libsvtav1", ".mkv", "yuv420p", True),
        thorough("mjpeg", ".avi", "yuv420p", True),
        thorough("ffv1", ".mkv", "yuv422p10le", True),
        ("ffv1", ".avi", "yuv420p", False),
    ],
)
def test_frames_look_alike_with_any_encoder(tmp_path, stated, encoder, ending, pixel_format, is_kept):
    clip = clips.write(tmp_path / "in.mkv", clips.standing(4), "ffv1", pixel_format, colours=(stated,))
    out = tmp_path / f"out{ending}"
    outcome = rectify_clip(clip, out, readout_ratio=clips.RATIO, focal_px=clips.FOCAL, codec=encoder)
    assert shown(out) == pytest.approx(shown(clip), abs=0.6)
    assert any("full range" in each for each in outcome.left_out) == (stated == FULL and not is_kept)
