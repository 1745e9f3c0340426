"""Sequences of a camera that is held by hand, or is not, before a drawn wall; with the true motion of every frame."""

import numpy as np

from support.drawn_photos import textured
from unshutter.frames.tracks import Tracks
from unshutter_lab.synthesis.rotation_log import RotationLog
from unshutter_lab.synthesis.sequences import RotatingCamera

HEIGHT, WIDTH, FOCAL = 180, 320, 275.0
_STEP = 1 / 250  # s


def log_of(*rates_deg_s, seconds=4.0):
    """A log of (yaw, roll, pitch) rates, each a function of the time [s], in degrees per second."""
    times = np.arange(0, seconds, _STEP)
    return RotationLog(times, *(np.radians(np.broadcast_to(rate(times), times.shape)) for rate in rates_deg_s))


def hand(seed=0, seconds=4.0):
    """What a hand does: all three axes, between half a cycle and four cycles a second."""
    rng = np.random.default_rng(seed)

    def rate(strength):
        waves = [(rng.uniform(0.5, 4), rng.uniform(0, 6), rng.normal()) for _ in range(6)]
        return lambda t: strength * sum(a * np.sin(2 * np.pi * f * t + p) for f, p, a in waves)

    return log_of(rate(9), rate(5), rate(9), seconds=seconds)


def still(seconds=4.0):
    return log_of(*[lambda t: 0 * t] * 3, seconds=seconds)


def pan(deg_s=12.0, seconds=4.0):
    """Evenly to the left."""
    return log_of(lambda t: 0 * t + deg_s, lambda t: 0 * t, lambda t: 0 * t, seconds=seconds)


def shaking(hertz, deg_s=10.0, seconds=4.0):
    """A pan on something that vibrates."""
    return log_of(lambda t: 12 + deg_s * np.sin(2 * np.pi * hertz * t), lambda t: 0 * t, lambda t: 0 * t)


def camera(log, ratio=0.6, frames=45, **more):
    """At 30 frames per second, unless ``more`` says otherwise."""
    usual = {"fps": 30.0, "height": HEIGHT, "width": WIDTH, "focal_px": FOCAL}
    return RotatingCamera(log, 0.05, frames, readout_ratio=ratio, **{**usual, **more})


def clip(log, ratio=0.6, frames=45, noise=2.0, **more):
    """(camera, its frames: grey, uint8)."""
    made = camera(log, ratio, frames, **more)
    return made, list(made.rendered(textured(2 * HEIGHT, 2 * WIDTH, bands=1)[..., 0], noise))


def exact_tracks(moving, count=80, noise=0.0, strays=0.0, seed=0):
    """Tracks from each frame to the next as the camera's geometry has them."""
    rng = np.random.default_rng(seed)
    about, pairs = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2]), []
    for k in range(moving.frames - 1):
        start = rng.uniform((20, 20), (WIDTH - 20, HEIGHT - 20), (count, 2))
        before = moving.rotations(k + moving.readout_ratio * (start[:, 1] + 0.5) / HEIGHT)
        ray = np.concatenate([start - about, np.full((count, 1), moving.focal_px)], axis=1)
        end = start.copy()
        for _ in range(8):  # the row that sees it is the row where it is seen
            after = moving.rotations(k + 1 + moving.readout_ratio * (end[:, 1] + 0.5) / HEIGHT)
            seen = np.einsum("nij,nkj,nk->ni", after, before, ray)
            end = seen[:, :2] / seen[:, 2:] * moving.focal_px + about
        end += rng.normal(0, noise, end.shape) + (rng.random((count, 1)) < strays) * rng.normal(0, 15, end.shape)
        pairs.append(Tracks(start, end, HEIGHT, WIDTH, count))
    return pairs
