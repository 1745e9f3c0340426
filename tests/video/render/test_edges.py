"""The edges of clips: nothing is mirrored unless asked for, and one enlargement hides the borders of all frames."""

import numpy as np
import pytest

import unshutter
from support import clips
from support.hand_held import pan
from unshutter.motion import RowMotion
from unshutter.motion.edges import EdgePolicy
from unshutter.motion.finding import Finding
from unshutter.motion.grid import SamplingGrid
from unshutter.motion.warp import warp_plane
from unshutter.options.clip_options import ClipUndo
from unshutter.orientation import ScanDirection
from unshutter.video.file.row_samples import ROWS
from unshutter.video.render.enlargement import LARGEST, Enlargement
from unshutter.video.render.stabilisation import CameraPath
from unshutter.video.render.views import grid_of_motion

CAMERA, GREYS = clips.moving(16)


def path_of(*shares):
    """The path of frames that lean to one side by shares of their width."""
    path = CameraPath(ClipUndo(), ScanDirection.TOP_TO_BOTTOM, clips.WIDTH / clips.HEIGHT)
    width = round(ROWS * clips.WIDTH / clips.HEIGHT)
    for number, share in enumerate(shares):
        motion = RowMotion.from_polynomials([0, share * width], [0], ROWS, width)
        path.add(Finding(motion), None, False, number / clips.FPS)
    return path


@pytest.mark.parametrize(
    ("shares", "zooms", "frames"),
    [
        ([0.0, 0.0], (1.0, 1.0), 0),
        ([0.005, 0.018], (1.0, 1.0), 1),  # at the middle row as the reference, half of it is missing on either side
        ([0.005, 0.04], (1.04, 1.045), 0),
        ([0.005, 0.2, 0.3], (LARGEST, LARGEST), 2),
    ],
)
def test_the_least_enlargement(shares, zooms, frames):
    enlargement = Enlargement.least(path_of(*shares), clips.HEIGHT, clips.WIDTH)
    assert zooms[0] <= enlargement.zoom <= zooms[1] and enlargement.frames == frames


def test_an_enlarged_frame_shows_no_border():
    path = path_of(0.04)
    view = Enlargement.least(path, clips.HEIGHT, clips.WIDTH).of(None)
    width = round(ROWS * clips.WIDTH / clips.HEIGHT)
    motion = RowMotion.from_polynomials([0, 0.04 * width], [0], ROWS, width).rereferenced("middle")
    grid = grid_of_motion(motion, clips.HEIGHT, clips.WIDTH, view)
    for _, (col, row) in grid.bands(1, 1):
        assert col.min() > -0.6 and col.max() < clips.WIDTH - 0.4
        assert row.min() > -0.6 and row.max() < clips.HEIGHT - 0.4


def test_the_border_has_no_hairline():
    plane = np.full((8, 8), 200, np.uint8)
    for shift, last in ((0.5, 200), (1.5, 16)):  # half a pixel outside, and one and a half
        out = np.empty_like(plane)
        grid = SamplingGrid.of_cells(lambda col, row, shift=shift: (col + shift, row), 8, 8, 8)
        warp_plane(plane, grid, out, black_beyond=EdgePolicy("keep").black_beyond, black=16)
        assert (out[:, :-2] == 200).all() and (out[:, -1] == last).all()


def test_a_file_and_its_frames_are_enlarged_alike(tmp_path, straighten):
    clip = clips.write(tmp_path / "in.mkv", GREYS, "ffv1", "gray")
    after, record, said = straighten(clip, *clips.KNOWN)
    zoom = record["enlarged"]["zoom"]
    assert 1 < zoom <= LARGEST and f"all frames enlarged by {100 * (zoom - 1):.1f} %" in said
    options = {"readout_ratio": clips.RATIO, "focal_px": clips.FOCAL}
    frames = list(unshutter.rectify_clip_frames(GREYS, **options))
    assert np.array_equal(clips.luma(after), np.stack(frames))
    streamed = list(unshutter.rectify_clip_frames(iter(GREYS), **options))
    assert np.array_equal(np.stack(streamed), np.stack(frames))


def still_then(frames, still=24):
    """A camera that rests before it moves."""
    return [frames[0]] * still + frames


@pytest.mark.parametrize(
    ("greys", "flags", "kept"),
    [
        (GREYS, [*clips.KNOWN], []),
        (GREYS, [*clips.KNOWN, "--stabilize"], ["--stabilize"]),
        (GREYS, [*clips.KNOWN, "--strength", "0.5", "--edges", "crop"], ["--strength", "0.5", "--edges", "crop"]),
        (still_then(GREYS), ["--readout-ratio", "0.6"], []),
        (clips.standing(20), [], []),
    ],
)
def test_a_video_is_the_same_whether_its_motion_is_saved_or_was(tmp_path, straighten, greys, flags, kept):
    clip = clips.write(tmp_path / "in.mkv", greys, "ffv1", "gray")
    saved = tmp_path / "motion.json"
    videos = []
    for more in (flags, [*flags, "--save-motion", saved], [*kept, "--motion", saved]):
        out, _, said = straighten(clip, *more)
        videos.append((out.read_bytes(), "enlarged" in said))
    assert videos[0] == videos[1] == videos[2]
    assert (videos[0][0] == clip.read_bytes()) == (not flags)


def test_a_clip_in_which_little_is_missing_is_not_enlarged(tmp_path, straighten):
    slow = clips.write(tmp_path / "slow.mkv", clips.moving(16, pan(4))[1], "ffv1", "gray")
    _, record, said = straighten(slow, *clips.KNOWN)
    assert record["enlarged"]["zoom"] == 1 and "enlarged" not in said
