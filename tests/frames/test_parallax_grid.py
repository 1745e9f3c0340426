"""The velocity that depth adds, found in drawn tracks of a camera that walks and shakes past near ground and a wall."""

from dataclasses import replace

import numpy as np
import pytest

from unshutter.frames.camera import Problem, rotation_jacobian
from unshutter.frames.parallax import DEPTH
from unshutter.frames.tracks import Tracks
from unshutter.motion.parallax_field import node_weights

HEIGHT, WIDTH, FOCAL, RATIO, PAIRS = 256, 340, 280.0, 0.7, 40
SPEED = 3.0  # px per frame of the nearest row


def _seen(at, time, walks):
    """Returns positions at the times of their rows: turned by a hand, and moved across by the depth of their row."""
    across, down = at.T
    turn = 0.02 * np.sin(0.6 * time + 1) + 0.01 * np.sin(1.1 * time), 0.015 * np.sin(0.8 * time)
    depth = np.clip(at[:, 1] / HEIGHT, 0, 1) ** 2 + 0.5 * (at[:, 0] > WIDTH / 2)
    x, y = (across - WIDTH / 2) / FOCAL, (down - HEIGHT / 2) / FOCAL
    moved = np.stack([(1 + x * x) * turn[0] - x * y * turn[1], x * y * turn[0] - (1 + y * y) * turn[1]], axis=-1)
    return at + FOCAL * moved + walks * SPEED * depth[:, None] * (1.0, 0.1)


@pytest.fixture(scope="module")
def walk():
    rng = np.random.default_rng(0)

    def pairs(walks):
        drawn = []
        for k in range(PAIRS):
            at = rng.uniform((10, 10), (WIDTH - 10, HEIGHT - 10), (90, 2))  # where they are half way between
            ends = []
            for frame in (k, k + 1):
                end = at
                for _ in range(4):
                    time = frame + RATIO * end[:, 1] / HEIGHT
                    end = _seen(at, time, 0.0) - _seen(at, np.full(90, k + 0.5 + RATIO / 2), 0.0) + at
                    end = end + walks * (_seen(at, time, 1.0) - _seen(at, time, 0.0)) * (time - k - 0.85)[:, None]
                ends.append(end + rng.normal(0, 0.05, end.shape) - 0.5)
            drawn.append(Tracks(*ends, HEIGHT, WIDTH, 90))
        return drawn

    return pairs


def _off(fit):
    """Returns how far the picture's velocity in frame 20 is off, at places spread over it [px per frame]."""
    col, row = (each.ravel() for each in np.meshgrid(np.linspace(20, WIDTH - 20, 9), np.linspace(20, HEIGHT - 20, 7)))
    at, time = np.stack([col, row], axis=-1), np.full(63, 20 + RATIO / 2)
    truth = (
        (_seen(at, time + 0.1, 0.0) - _seen(at, time - 0.1, 0.0)) / 0.2 + _seen(at, time, 1.0) - _seen(at, time, 0.0)
    )
    turn = (fit.rotation(time + 0.1) - fit.rotation(time - 0.1)) / 0.2 * FOCAL
    found = np.einsum("nij,nj->ni", rotation_jacobian(at, WIDTH, FOCAL)[..., :3], turn)
    if fit.parallax is not None:
        found = found + node_weights(col / WIDTH, row / HEIGHT) @ fit.parallax.at(20.0)
    return float(np.sqrt(np.square(found - truth).sum(axis=-1).mean()))


def test_a_walk_is_told_from_a_camera_that_only_turns(walk):
    for walks in (0.0, 1.0):
        problem = Problem(walk(walks), FOCAL, depth=DEPTH)
        fit = problem.fit(RATIO)
        assert problem.shows_parallax(fit, RATIO) == bool(walks)
    found = replace(problem, has_parallax=True).fit(RATIO)
    assert found.noise_px < 0.7 * fit.noise_px
    assert _off(found) < 0.5 and _off(fit) > 2.0
