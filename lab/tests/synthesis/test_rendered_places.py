"""Clips of places: what a rolling shutter shows of what a global one sees is known for each pixel."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import cv2
import numpy as np
import pytest

from unshutter_lab.synthesis.panorama import Place, shipped_places
from unshutter_lab.synthesis.rendered_places import ClipSettings, RenderedPlace

SMALL = ClipSettings("small", 30, 20, 4, 6, height=109, width=192)
BENT = {"degrees": 122, "k": (0.15, -0.12, 0.04, -0.006)}


@cache
def place() -> Place:
    return Place.load(shipped_places()["potsdamer_platz"])


def filmed(**more: object) -> RenderedPlace:
    return RenderedPlace(replace(SMALL, **more), place(), np.random.default_rng(2))


@pytest.mark.parametrize("more", [{}, BENT])
def test_without_near_surfaces_the_exact_map_is_that_of_the_true_rotation(more: dict[str, object]) -> None:
    scene = filmed(**more)
    at, still = scene.exact_map(3)
    col, row = np.meshgrid(np.arange(SMALL.width, dtype=float), np.arange(SMALL.height, dtype=float))
    expected = np.stack(scene.camera.motion(3, "middle").gs_to_rs(col, row), axis=-1)
    inner = (slice(10, -10), slice(10, -10))
    assert np.abs(at - expected)[inner].max() < 0.02 and still[inner].all()
    assert np.abs(expected - np.stack([col, row], axis=-1)).max() > 0.5


def test_the_exact_map_undoes_a_walk_past_a_fence_and_people() -> None:
    scene = filmed(walks=True, figures=3)
    rolling, at_once = (list(scene.pictures(is_global))[3].astype(float) for is_global in (False, True))
    at, still = scene.exact_map(3)
    undone = cv2.remap(rolling, at[..., 0], at[..., 1], cv2.INTER_CUBIC)
    surface = scene.seen(np.full(SMALL.height, 3 + scene.camera.readout_ratio / 2)).surface
    assert {0, 1, 3} <= set(surface.ravel().tolist()) and not still[surface > 1].any()
    for number in (0, 1):  # the place, and the fence
        here = still & (surface == number)
        before, after = (np.abs(picture - at_once)[here].mean() for picture in (rolling, undone))
        assert here.sum() > 1000 and after < before / 2


def test_near_surfaces_pass_in_front_of_far_ones() -> None:
    """A fence is displaced by the walk in addition to the turn, by what the camera has moved meanwhile."""
    walking, standing = (filmed(walks=walks, shift_px=0.01) for walks in (True, False))
    at, still = walking.exact_map(2)
    own = np.stack(np.meshgrid(np.arange(SMALL.width), np.arange(SMALL.height)), axis=-1)
    surface = walking.seen(np.full(SMALL.height, 2 + walking.camera.readout_ratio / 2)).surface
    seconds = (2 + walking.camera.readout_ratio * (own[..., 1] + 0.5) / SMALL.height) / SMALL.fps
    middle = (2 + walking.camera.readout_ratio / 2) / SMALL.fps
    moved = 0.05 * (np.sin(2 * np.pi * 0.9 * middle) - np.sin(2 * np.pi * 0.9 * seconds)) * walking.focal_px
    fence = still & (surface == 1)
    assert np.abs((at - own)[fence, 0] - moved[fence]).max() < 0.06 and np.abs(moved[fence]).max() > 0.2
    assert np.abs((at - own)[still & (surface == 0)]).max() < 0.05
    assert not standing.seen(np.full(SMALL.height, 2.0)).surface.any()


def test_a_clip_shifts_as_much_as_it_should() -> None:
    assert filmed(shift_px=8).shift_px == pytest.approx(8, rel=0.1)


def test_vibration_is_added_to_the_turn() -> None:
    seconds = np.arange(0.2, 0.3, 0.005)
    turned, vibrated = (
        filmed(shift_px=0.01, vibration=vibration).camera.log.rotations(seconds) for vibration in (None, (20.0, 0.5))
    )
    swing = np.degrees(np.arcsin((vibrated @ turned.transpose(0, 2, 1))[:, 0, 2]))  # about the vertical
    assert np.ptp(swing) == pytest.approx(2 * 0.5, rel=0.1)


def test_a_repeated_frame_shows_its_predecessor_in_both_shutters() -> None:
    scene = filmed(repeated=3)
    assert [scene.shown(frame) for frame in range(6)] == [0, 1, 1, 3, 4, 4]
    for is_global in (False, True):
        frames = list(scene.pictures(is_global))
        same = [np.array_equal(a, b) for a, b in pairwise(frames)]
        assert same == [False, True, False, False, True]


def test_little_light_is_dark_and_blurred() -> None:
    bright, dark = (next(filmed(dark=is_dark, shift_px=8).pictures(True)) for is_dark in (False, True))
    assert dark.mean() == pytest.approx(0.4 * bright.mean(), rel=0.05)
    sharpness = [cv2.Laplacian(picture.astype(np.float32), cv2.CV_32F).var() for picture in (0.4 * bright, dark)]
    assert sharpness[1] < 0.8 * sharpness[0]
