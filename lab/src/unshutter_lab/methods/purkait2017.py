"""purkait2017: estimates one rate of rotation about the viewing direction from segments of a Manhattan world.

After Purkait, Zach, Leonardis, "Rolling Shutter Correction in Manhattan World" (ICCV 2017): with positions relative to
the picture's centre and divided by the focal length, p' = p + y [0, 0, c]_x p undoes a rotation of rate c, to first
order. Segments then point to three orthogonal vanishing points; four segments determine these and c. Solver and
refinement are our own; the constants are those of the authors' demo.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from unshutter.motion.finding import Finding
from unshutter.motion.rotations import rotation_matrix
from unshutter.single.estimator import Estimator, View
from unshutter.single.likelihood import find_segments
from unshutter_lab.methods.curves import geman_mcclure, minimise

SHORT_SIDE = 512  # of the grey copy in which segments are detected [px]
SHORTEST_PX = 15.0
MIN_SEGMENTS = 8  # twice the number the solver needs
INLIER = 0.005  # of (vanishing point . normal)^2
MIN_INLIERS = 0.75  # share of the segments; with fewer, nothing is undone
LARGEST_RATE = 1.0
SAMPLES = 500
BATCH = 50  # samples between checks of whether enough were drawn
CONFIDENCE = 0.999
SEED = 0


class Purkait2017(Estimator):
    """MSAC over samples of four segments, followed by a refinement on all inliers."""

    def estimate(self, view: View) -> Finding:
        """Returns uniform rotation about z; zero motion with a reason below eight segments or 75 % inliers."""
        grey = view.grey(SHORT_SIDE)
        height, width = grey.shape
        segments = find_segments(grey)
        segments = segments[np.hypot(*(segments[:, 2:] - segments[:, :2]).T) >= SHORTEST_PX]
        if len(segments) < MIN_SEGMENTS:
            return view.no_motion(self.name, f"only {len(segments)} segments of {SHORTEST_PX:g} px found")
        focal_px = view.focal_px() * height / view.height
        center = np.array([(width - 1) / 2, (height - 1) / 2] * 2)
        fits = fit_rate((segments - center) / focal_px)
        if fits is None:
            return view.no_motion(self.name, "no four segments fit three orthogonal vanishing points")
        rate, share = fits
        if share < MIN_INLIERS:
            return view.no_motion(self.name, f"only {share:.0%} of the segments fit a Manhattan world")
        y = (np.arange(view.height) - (view.height - 1) / 2) / view.focal_px()
        return view.rotation_motion(np.stack([0 * y, 0 * y, -rate * y], axis=1), self.name)


def fit_rate(segments: np.ndarray) -> tuple[float, float] | None:
    """Returns the rate c [rad per focal length of rows] and the share of segments that fit it, if a sample has any.

    Segments [N, 4] are end points (x1, y1, x2, y2), divided by the focal length, from the picture's centre.
    """
    normals = line_polynomials(segments)
    rng = np.random.default_rng(SEED)
    best, least = None, np.inf
    drawn, needed = 0, SAMPLES
    while drawn < needed:
        samples = np.stack([rng.permutation(len(segments))[:4] for _ in range(BATCH)])
        drawn += BATCH
        rates, frames = solve_four(normals[samples])
        if not len(rates):
            continue
        costs = _costs(normals, rates, frames)
        if costs.min() < least:
            best, least = (rates[costs.argmin()], frames[costs.argmin()]), costs.min()
            share = float((_squared_sines(normals, *best) < INLIER).mean())
            all_good = min(share**4, 1 - 1e-12)
            needed = min(SAMPLES, np.log(1 - CONFIDENCE) / np.log1p(-all_good) if all_good > 0 else SAMPLES)
    if best is None:
        return None
    rate, frame = _refined(normals, *best)
    return rate, float((_squared_sines(normals, rate, frame) < INLIER).mean())


def line_polynomials(segments: np.ndarray) -> np.ndarray:
    """Normals of the segments' planes after rectification with c: coefficients [N, 3 (c^0, c^1, c^2), 3 (x, y, z)].

    The end points are p + c y (-y, x, 0); the normal is the cross product of the two.
    """
    one, two = (np.stack([x, y, np.ones_like(x)], axis=-1) for x, y in (segments[:, :2].T, segments[:, 2:].T))
    turn_one, turn_two = (p[:, 1:2] * np.stack([-p[:, 1], p[:, 0], 0 * p[:, 0]], axis=-1) for p in (one, two))
    linear = np.cross(turn_one, two) + np.cross(one, turn_two)
    return np.stack([np.cross(one, two), linear, np.cross(turn_one, turn_two)], axis=1)


def solve_four(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns rates and vanishing points that four segments fit exactly, for two ways of assigning the segments.

    With v1 the cross product of the first two normals: two, one, one, where the other vanishing points n3 x v1 and
    n4 x v1 must be orthogonal: (n3 . n4)(v1 . v1) = (n3 . v1)(n4 . v1), degree 12 in c; and two, two, where v1 and
    n3 x n4 must be orthogonal: degree 8.

    Args:
        normals: [S, 4, 3, 3] of :func:`line_polynomials`.

    Returns:
        Rates c [M], |c| < 1, and vanishing points as the rows of matrices [M, 3, 3].
    """
    n = [normals[:, k] for k in range(4)]
    v1 = _cross(n[0], n[1])
    one_each = _dot(n[2], n[3], v1, v1) - _times(_dot(n[2], v1), _dot(n[3], v1))
    two_each = _dot(v1, _cross(n[2], n[3]))
    fits = [
        _at_roots(one_each, normals, lambda n, v: np.cross(n[:, 2], v)),
        _at_roots(two_each, normals, lambda n, v: np.cross(n[:, 2], n[:, 3])),
    ]
    rates, frames = (np.concatenate(parts) for parts in zip(*fits, strict=True))
    return rates, frames


def _at_roots(polynomials: np.ndarray, normals: np.ndarray, second: Callable) -> tuple[np.ndarray, np.ndarray]:
    """Returns rates and vanishing points at the roots; ``second`` computes the second point from normals and first."""
    sample, c = _real_roots(polynomials)
    at_c = np.einsum("snkx,sk->snx", normals[sample], c[:, None] ** np.arange(3))
    first = _unit(np.cross(at_c[:, 0], at_c[:, 1]))
    other = _unit(second(at_c, first))
    frames = np.stack([first, other, np.cross(first, other)], axis=1)
    sound = np.isfinite(frames).all(axis=(1, 2))
    return c[sound], frames[sound]


def _real_roots(polynomials: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the real roots below LARGEST_RATE of polynomials [S, D + 1] (c^0 first): polynomial index and root."""
    scale = np.abs(polynomials).max(axis=1, keepdims=True)
    p = polynomials / np.where(scale > 0, scale, 1.0)
    degree = p.shape[1] - 1
    # in 1 / c: the constant term leads, which vanishes only if c = 0 is a root
    lead = np.where(np.abs(p[:, :1]) > 1e-14, p[:, :1], 1e-14)
    companion = np.zeros((len(p), degree, degree))
    companion[:, 0] = -p[:, 1:] / lead
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    inverse = np.linalg.eigvals(companion)  # 1 / c
    with np.errstate(divide="ignore", invalid="ignore"):
        c = 1 / inverse
    real = (np.abs(c.imag) < 1e-6 * (1 + np.abs(c))) & (np.abs(c) < LARGEST_RATE)
    sample, which = np.nonzero(real)
    root = c.real[sample, which]
    for _ in range(3):  # Newton's method, to full precision
        powers = root[:, None] ** np.arange(degree + 1)
        value = (p[sample] * powers).sum(axis=1)
        slope = (p[sample, 1:] * powers[:, :-1] * np.arange(1, degree + 1)).sum(axis=1)
        root = root - np.where(np.abs(slope) > 1e-12, value / np.where(slope == 0, 1.0, slope), 0.0)
    near = np.abs(root) < LARGEST_RATE
    return sample[near], root[near]


def _squared_sines(normals: np.ndarray, rate: np.ndarray | float, frame: np.ndarray) -> np.ndarray:
    """(v . n)^2 of each segment with its nearest vanishing point: rates [...], frames [..., 3, 3] -> [..., N]."""
    c = np.asarray(rate)[..., None, None]
    at_c = _unit(normals[:, 0] + c * (normals[:, 1] + c * normals[:, 2]))
    return ((at_c @ np.swapaxes(frame, -1, -2)) ** 2).min(axis=-1)


def _costs(normals: np.ndarray, rates: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """MSAC cost of each hypothesis [M]."""
    return np.minimum(_squared_sines(normals, rates, frames), INLIER).mean(axis=-1)


def _refined(normals: np.ndarray, rate: float, frame: np.ndarray) -> tuple[float, np.ndarray]:
    """Refines rate and vanishing points with all segments, each assigned to its nearest point; robust to outliers."""
    scale = np.sqrt(INLIER)

    def turned(x: np.ndarray) -> np.ndarray:
        return frame @ rotation_matrix(x[1:])

    def residuals(x: np.ndarray) -> np.ndarray:
        return np.sqrt(_squared_sines(normals, x[0], turned(x))) / scale

    x, _ = minimise(residuals, np.array([rate, 0.0, 0.0, 0.0]), geman_mcclure)
    return (float(x[0]), turned(x)) if abs(x[0]) < LARGEST_RATE else (rate, frame)


# ---- vectors of polynomials in c: [S, D + 1, 3], polynomials: [S, D + 1], lowest power first ----------------


def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of two polynomials."""
    product = np.zeros((len(a), a.shape[1] + b.shape[1] - 1, *a.shape[2:]))
    for k in range(a.shape[1]):
        product[:, k : k + b.shape[1]] += a[:, k : k + 1] * b
    return product


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product of two vectors of polynomials."""
    following = ((1, 2), (2, 0), (0, 1))
    return np.stack([_times(a[..., i], b[..., j]) - _times(a[..., j], b[..., i]) for i, j in following], axis=-1)


def _dot(a: np.ndarray, b: np.ndarray, *and_times: np.ndarray) -> np.ndarray:
    """Scalar product of two vectors of polynomials, optionally times that of two more."""
    product = _times(a, b).sum(axis=-1)
    return _times(product, _dot(*and_times)) if and_times else product


def _unit(vectors: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
