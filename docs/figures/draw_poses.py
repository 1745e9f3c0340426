"""Draws which pose each row of a picture has: ``python docs/figures/draw_poses.py`` (needs the extra ``plot``)."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

HERE = Path(__file__).parent
plt.rcParams["svg.hashsalt"] = "unshutter"  # same drawing, same bytes
ROWS = {"first row": (0.0, "#c62828"), "middle row": (0.5, "#1565c0"), "last row": (1.0, "#2e7d32")}


def place(share: float) -> tuple[np.ndarray, float]:
    """Position and direction [rad] of the drawn camera at a share of the readout."""
    return np.array([2.2 * share, 0.5 * share * (1 - share)]), np.radians(96 - 26 * share)


def row_poses() -> None:
    """A picture with its rows, and the camera's path while they are read."""
    figure, (picture, path) = plt.subplots(1, 2, figsize=(10, 3.8), width_ratios=[1, 1.7])
    for line in np.linspace(0, 1, 25):
        picture.plot([0, 4 / 3], [line, line], color="0.88", lw=1)
    for name, (share, colour) in ROWS.items():
        picture.plot([0, 4 / 3], [share, share], color=colour, lw=2.5)
        picture.text(4 / 3 + 0.04, share, name, color=colour, va="center")
    picture.annotate("", (-0.08, 1), (-0.08, 0), arrowprops={"arrowstyle": "->"})
    picture.text(-0.14, 0.5, "readout", rotation=90, ha="right", va="center")
    picture.set(xlim=(-0.3, 2.0), ylim=(1.08, -0.08), title="the picture", aspect="equal")

    shares = np.linspace(-0.35, 1.35, 60)
    path.plot(*np.array([place(share)[0] for share in shares]).T, color="0.6", lw=1, ls="--")
    texts = {
        "first row": "viewmats\ntransform_matrix_first_row",
        "middle row": "COLMAP's pose of a straightened\npicture, transform_matrix",
        "last row": "viewmats_rs\ntransform_matrix_last_row",
    }
    for name, (share, colour) in ROWS.items():
        at, angle = place(share)
        for side in (-0.35, 0.35):
            end = at + 0.75 * np.array([np.cos(angle + side), np.sin(angle + side)])
            path.plot(*np.stack([at, end]).T, color=colour, lw=1.5)
        path.plot(*at, "o", color=colour)
        path.text(at[0], at[1] - 0.16, texts[name], color=colour, ha="center", va="top", fontsize=8)
    path.set(xlim=(-1.0, 3.3), ylim=(-0.65, 1.05), title="the camera while it is read, from above", aspect="equal")
    for axis in (picture, path):
        axis.axis("off")
    figure.tight_layout()
    figure.savefig(HERE / "row_poses.svg", metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    row_poses()
