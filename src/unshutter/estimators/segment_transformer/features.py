"""The network's input features for each segment, written once for NumPy (inference) and torch (training)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from unshutter.geometry import rows as geometry

if TYPE_CHECKING:
    from unshutter.geometry.shapes import Float

Array = Any
FEATURES = 39  # numbers per segment
_OCTAVES = 4  # of the sine waves that encode a position
_SHARPNESS = (6.0, 25.0)  # of the two scales that encode a segment's deviation from vertical and from horizontal


def moved(tokens: Float[Array, "batch segments 6"], motion: Float[Array, "batch 2 3"]) -> Array:
    """Returns the end points as a global shutter would have seen them, given the motion (Eq. 1).

    Args:
        tokens: end points x1, y1, x2, y2 [rows, centred], and the unit vector towards the top of the scene.
        motion: coefficients of u, u^2, u^3 with u = y + 1/2: t_x [rows], r_z [rad].

    Returns:
        x and y of both ends [batch, 2 (x, y), segments, 2 (ends)].
    """
    xp = geometry.namespace(tokens)
    x, y = tokens[..., 0:4:2], tokens[..., 1:4:2]  # [B, N, 2 ends]
    u = y + 0.5
    tx, rz = (_cubic(motion[:, k, :, None, None], u) for k in (0, 1))
    return xp.stack(geometry.rs_to_gs(x, y, tx, rz), axis=1)


def _cubic(coefficients: Array, u: Array) -> Array:
    """Evaluates the polynomial with coefficients [B, 3, 1, 1] of u, u^2, u^3 at u [B, N, 2]."""
    return u * (coefficients[:, 0] + u * (coefficients[:, 1] + u * coefficients[:, 2]))


def features(tokens: Float[Array, "batch segments 6"], ends: Float[Array, "batch 2 segments 2"]) -> Array:
    """Returns features [batch, segments, FEATURES]; they do not depend on the order of the ends.

    Args:
        tokens: the segments, as in :func:`moved`.
        ends: their end points, moved.
    """
    xp = geometry.namespace(tokens)
    x, y = ends[:, 0], ends[:, 1]  # [B, N, 2 ends]
    middle_x, middle_y = (x[..., 0] + x[..., 1]) / 2, (y[..., 0] + y[..., 1]) / 2  # [B, N] from here on
    step_x, step_y = x[..., 1] - x[..., 0], y[..., 1] - y[..., 0]
    length = xp.sqrt(xp.clip(step_x * step_x + step_y * step_y, 1e-12, None))
    cos, sin = step_x / length, step_y / length
    # double angles and deviations from vertical and horizontal do not change when the ends are swapped
    angles = [cos * cos - sin * sin, 2 * sin * cos]
    for _ in range(4):  # 4, 8, 16, 32 times the angle
        c, s = angles[-2], angles[-1]
        angles += [c * c - s * s, 2 * s * c]
    lean = cos * xp.sign(sin + 1e-9)
    rise = sin * xp.sign(cos + 1e-9)
    fine = [xp.tanh(k * deviation) for deviation in (lean, rise) for k in _SHARPNESS]
    waves = []
    for k in range(_OCTAVES):
        for position in (middle_x, middle_y):
            phase = (2 * math.pi * 2.0**k / 4) * position
            waves += [xp.sin(phase), xp.cos(phase)]
    size = length + 0.02
    first, second = tokens[..., 1], tokens[..., 3]  # the rows of both ends, i.e. the times at which they were read
    columns = [
        *(middle_x, middle_y, xp.abs(step_x) / size, xp.abs(step_y) / size, xp.log(length) + 3),
        *angles,
        *fine,
        *waves,
        *(xp.minimum(first, second), xp.maximum(first, second), tokens[..., 4], tokens[..., 5]),
    ]
    return xp.stack(columns, axis=-1)
