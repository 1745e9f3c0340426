"""Scenes of straight lines as a turning camera would see them, with the motion known."""

import json
from collections.abc import Iterable

import numpy as np

from unshutter.motion import Motion, RotationMotion
from unshutter.single.drawn_lines import FORMAT, DrawnLine
from unshutter_lab.evaluation.metrics import motion_error

HEIGHT, WIDTH, FOCAL = 400, 500, 450.0
U = (np.arange(HEIGHT) + 0.5) / HEIGHT
QUADRATIC = ((1, 4, 3), (-2, 2, 2))  # degrees about x, y, z


def turning(*degrees: tuple[float, float, float]) -> RotationMotion:
    """Rotations of so many degrees of u, u^2 ... about x, y and z over 400 rows."""
    u = np.arange(HEIGHT)[:, None] / (HEIGHT - 1)
    rotations = sum(np.radians(d) * u ** (k + 1) for k, d in enumerate(degrees))
    return RotationMotion(width=WIDTH, rotations=rotations, focal_px=FOCAL)


def seen_curves(motion: RotationMotion, seed: int, count: int = 100, noise: float = 0.0, clutter: float = 0.0):
    """[count, 10, 2] curves (col, row) [px]: verticals, horizontals and others (2 : 2 : 1) through the motion.

    Args:
        motion: of the camera.
        seed: of the draw.
        count: curves.
        noise: standard deviation of every coordinate [px].
        clutter: share of the curves that are bent in the scene and run anywhere.
    """
    rng = np.random.default_rng(seed)
    curves = []
    while len(curves) < count:
        angle = (0.0, np.pi / 2, rng.uniform(0, np.pi))[rng.choice(3, p=(0.4, 0.4, 0.2))]
        bent = rng.uniform() < clutter
        angle = rng.uniform(0, np.pi) if bent else angle
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        t, length = np.linspace(-1, 1, 10)[:, None], rng.uniform(0.15, 0.6) * HEIGHT
        gs = rng.uniform([0, 0], [WIDTH, HEIGHT]) + t * along * length / 2
        gs = gs + bent * rng.normal(0, 0.05) * length * t**2 * across
        rs = np.stack(motion.gs_to_rs(gs[:, 0], gs[:, 1]), axis=-1)
        if (rs >= 0).all() and (rs <= [WIDTH - 1, HEIGHT - 1]).all():
            curves.append(rs + rng.normal(0, noise, rs.shape))
    return np.stack(curves)


def manhattan_segments(rate: float, seed: int, count: int = 120, noise: float = 0.0, clutter: float = 0.0):
    """[count, 4] segments over the focal length, of a world with three directions, as p = p' - rate y [0,0,1] x p.

    p' is where a global shutter sees the point. Each p is solved for by repeating that line.
    """
    rng = np.random.default_rng(seed)
    directions, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    segments = []
    while len(segments) < count:
        direction, middle = directions[:, rng.integers(3)], rng.uniform(-0.5, 0.5, 2)
        along = direction[:2] - middle * direction[2]  # towards the vanishing point
        if rng.uniform() < clutter:
            along = rng.normal(size=2)
        ends = middle + rng.uniform(0.05, 0.2) * np.array([[-1], [1]]) * along / np.hypot(*along)
        p = ends
        for _ in range(100):
            p = ends - rate * p[:, 1:] * np.stack([-p[:, 1], p[:, 0]], axis=1)
        segments.append((p + rng.normal(0, noise, p.shape)).ravel())
    return np.stack(segments)


def drawn_picture(motion: RotationMotion) -> np.ndarray:
    """uint8 grey: frames seen straight on, through the motion; each pixel is the mean of four points in it."""
    row, col = np.mgrid[0 : HEIGHT : 1 / 2, 0 : WIDTH : 1 / 2] + 1 / 4 - 0.5
    x, y = motion.rs_to_gs(col, row)
    grey = np.full(x.shape, 200.0)
    for left in range(-130, 640, 160):
        for top in range(-120, 520, 150):
            grey[(x > left) & (x < left + 125) & (y > top) & (y < top + 120)] = 60.0
            grey[(x > left + 12) & (x < left + 113) & (y > top + 12) & (y < top + 108)] = 130.0
    small = grey.reshape(HEIGHT, 2, WIDTH, 2).mean(axis=(1, 3))
    return np.clip(small + np.random.default_rng(0).normal(0, 1.5, small.shape), 0, 255).astype(np.uint8)


def motion_of(rotations: np.ndarray) -> RotationMotion:
    """Of such a scene, seen from the first row."""
    return RotationMotion(width=WIDTH, rotations=rotations, focal_px=FOCAL).rereferenced("first")


def share_left(found: Motion, truth: Motion) -> float:
    """EPE as a share of that of doing nothing."""
    return motion_error(found, truth).epe / motion_error(truth.scaled(0), truth).epe


def check_exact(found: RotationMotion, truth: RotationMotion) -> None:
    """Within 0.1 degrees about each axis and half a pixel everywhere."""
    assert np.degrees(np.abs(found.rotations - truth.rotations)).max() < 0.1
    col, row = np.meshgrid(np.linspace(0, WIDTH - 1, 20), np.linspace(0, HEIGHT - 1, 20))
    apart = np.hypot(*(np.stack(found.gs_to_rs(col, row)) - truth.gs_to_rs(col, row)))
    assert apart.max() < 0.5


def lines_as_text(lines: Iterable[DrawnLine]) -> str:
    """The text of a file of lines that a person drew."""
    listed = [{"kind": line.kind, "points": line.points} for line in lines]
    return json.dumps({"format": FORMAT, "lines": listed})
