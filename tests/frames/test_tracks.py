"""Corners followed between frames, and which of them belong to the background."""

import cv2
import numpy as np
import pytest

from support.drawn_photos import textured
from support.hand_held import clip, hand
from unshutter.frames.tracks import Tracks, background, follow


def wall(height=180, width=320):
    return textured(height, width, bands=1)[..., 0]


@pytest.mark.parametrize("shift", [(0, 0), (3.4, -2.6), (70, 9), (-95, -20)])
def test_a_shift_is_found_however_large(shift):
    big = wall(400, 640)
    at = np.float32([[1, 0, -150], [0, 1, -100]])
    earlier = cv2.warpAffine(big, at, (320, 180), flags=cv2.INTER_CUBIC)
    at[:, 2] += shift
    later = cv2.warpAffine(big, at, (320, 180), flags=cv2.INTER_CUBIC)
    tracks = follow(earlier, later)
    assert len(tracks) > 30
    assert np.median(tracks.end - tracks.start, axis=0) == pytest.approx(shift, abs=0.05)


@pytest.mark.parametrize("size", [(64, 16_384), (9_000, 64)])
def test_strips_are_no_error(size):
    tracks = follow(wall(*size), wall(*size))
    assert (tracks.height, tracks.width) == size


def test_tracks_end_where_the_camera_says():
    moving, frames = clip(hand(), ratio=0.9, frames=6)
    tracks = follow(frames[3], frames[4])
    camera_tracks = background(tracks, 0.9)
    assert camera_tracks.joined and not camera_tracks.still and len(camera_tracks.tracks) > 0.8 * len(tracks)
    # where each corner stood when its first row was read, then seen by a frame later
    pose = [moving.rotations(np.array([k + 0.45 / 180])) for k in (3, 4)]
    col, row = moving.motion(3).rs_to_gs(*camera_tracks.tracks.start.T)
    about = np.stack([col - 159.5, row - 89.5, np.full_like(col, 275.0)], axis=-1)
    turned = np.einsum("ij,kj,nk->ni", pose[1][0], pose[0][0].T, about)
    there = moving.motion(4).gs_to_rs(*(turned[:, :2] / turned[:, 2:] * 275 + [159.5, 89.5]).T)
    assert np.median(np.hypot(*(np.stack(there, axis=-1) - camera_tracks.tracks.end).T)) < 0.1


def test_frames_of_two_scenes_are_not_joined():
    other = np.ascontiguousarray(wall()[::-1, ::-1])
    assert not background(follow(wall(), other)).joined


def test_a_picture_without_texture_has_no_tracks():
    grey = np.full((180, 320), 90, np.uint8)
    tracks = follow(grey, grey)
    assert len(tracks) == tracks.looked_for == 0
    assert not background(tracks).joined


def random_tracks(rng, count, move, noise=0.03, area=((0, 0), (320, 180))):
    start = rng.uniform(*area, (count, 2))
    return start, start + move + rng.normal(0, noise, (count, 2))


def test_people_who_walk_by_are_not_the_background():
    rng = np.random.default_rng(1)
    behind, moving = random_tracks(rng, 80, (0, 0)), random_tracks(rng, 150, (4, 0.5), area=((60, 40), (260, 180)))
    tracks = Tracks(*(np.concatenate(both) for both in zip(behind, moving, strict=True)), 180, 320, 260)
    camera_tracks = background(tracks)
    assert camera_tracks.joined and camera_tracks.still
    assert np.abs(camera_tracks.tracks.end - camera_tracks.tracks.start).max() < 0.2


def test_something_near_that_stands_still_in_the_picture_is_not_the_background():
    """A pan that follows somebody: the person stays where they are, the scene moves."""
    rng = np.random.default_rng(2)
    person, behind = random_tracks(rng, 50, (0, 0), area=((130, 60), (190, 180))), random_tracks(rng, 120, (7, 0))
    tracks = Tracks(*(np.concatenate(both) for both in zip(person, behind, strict=True)), 180, 320, 200)
    camera_tracks = background(tracks)
    assert camera_tracks.joined and not camera_tracks.still
    assert np.median((camera_tracks.tracks.end - camera_tracks.tracks.start)[:, 0]) == pytest.approx(7, abs=0.1)


def test_slow_turning_is_no_standing_still():
    rng = np.random.default_rng(3)
    start = rng.uniform((0, 0), (320, 180), (200, 2))
    turned = start + (start - [160, 90])[:, ::-1] * [-0.004, 0.004]
    camera_tracks = background(Tracks(start, turned, 180, 320, 200))
    assert camera_tracks.joined and not camera_tracks.still and len(camera_tracks.tracks) > 180


def test_of_two_planes_the_one_that_was_the_background_stays_it():
    """A board that shows a few more corners than the wall behind it does not become the background."""
    rng = np.random.default_rng(3)
    before = background(Tracks(*random_tracks(rng, 60, (5.0, 1.0)), 180, 320, 80))
    assert len(before.tracks) > 50
    start = before.tracks.end
    wall_tracks = start, start + rng.normal([4.0, 3.0], 0.03, start.shape)
    board = random_tracks(rng, 70, (-4.0, 0.0))
    both = Tracks(*(np.concatenate(each) for each in zip(wall_tracks, board, strict=True)), 180, 320, 200)
    alone = background(both)
    assert alone.joined and np.median(alone.tracks.end - alone.tracks.start, axis=0) == pytest.approx((-4, 0), abs=0.1)
    goes_on = background(both, before=before)
    moved = np.median(goes_on.tracks.end - goes_on.tracks.start, axis=0)
    assert goes_on.joined and moved == pytest.approx((4, 3), abs=0.1) and len(goes_on.tracks) > 50
