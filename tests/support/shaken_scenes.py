"""A drawn scene, a shake to distort it with, and which positions lie in the picture."""

import numpy as np

from unshutter.motion import RowMotion


def drawn_scene(height, width, bands=3, dtype: type = np.uint8, finest=24.0):
    """A smooth picture: waves of at least ``finest`` px in several directions."""
    rng = np.random.default_rng(7)
    row, col = np.mgrid[:height, :width]
    out = np.zeros((height, width, bands))
    for band in range(bands):
        for _ in range(6):
            angle, length, phase = rng.uniform(0, np.pi), rng.uniform(finest, 4 * finest), rng.uniform(0, 6)
            out[..., band] += np.sin((np.cos(angle) * col + np.sin(angle) * row) * 2 * np.pi / length + phase)
    top = np.iinfo(dtype).max
    return np.clip(np.rint((0.5 + out / 13) * top), 0, top).astype(dtype)


def shake(height, width, share=1.0, **about):
    """Motion with t_x up to 6 % of the width and r_z up to 3 degrees, times a share."""
    tx, rz = (0, 0.09 * width * share, -0.03 * width * share), (0, -0.02 * share, 0.07 * share)
    return RowMotion.from_polynomials(tx, rz, height, width, **about)


def inside(col, row, height, width, margin=0.0):
    return (col >= margin) & (col <= width - 1 - margin) & (row >= margin) & (row <= height - 1 - margin)
