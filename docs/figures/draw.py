"""Draws the figures of the docs: ``python docs/figures/draw.py`` (needs the extra ``plot``)."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from unshutter import RowMotion

HERE = Path(__file__).parent
plt.rcParams["svg.hashsalt"] = "unshutter"  # same drawing, same bytes


def conventions() -> None:
    """A house under a global and a rolling shutter, with the axes and signs of Eq. 1."""
    size = 256
    motion = RowMotion.from_polynomials([0, 60, -20], [0, 0.12], size, size)
    across, tall = np.meshgrid(np.linspace(60, 195, 6), np.linspace(40, 225, 5))
    lines = [np.stack([np.full(80, c), np.linspace(40, 225, 80)]) for c in across[0]]
    lines += [np.stack([np.linspace(60, 195, 80), np.full(80, r)]) for r in tall[:, 0]]

    figure, axes = plt.subplots(1, 3, figsize=(11, 4), width_ratios=[1, 1, 0.8])
    for axis, title, move in zip(axes, ("global shutter (GS)", "rolling shutter (RS)"), (None, motion), strict=False):
        for col, row in lines:
            axis.plot(*(move.gs_to_rs(col, row) if move else (col, row)), color="#1565c0", lw=1.2)
        axis.plot(127.5, 127.5, "+", color="black")
        axis.annotate("centre", (127.5, 127.5), xytext=(4, -4), textcoords="offset points", fontsize=8)
        axis.set(xlim=(0, 255), ylim=(255, 0), title=title, xlabel="column →", aspect="equal")
        axis.set_ylabel("row ↓  (row 0 is read first)")
    row = np.arange(size)
    axes[2].plot(motion.tx_px, row, color="#c62828", label="t  [px], + moves right")
    axes[2].plot(np.degrees(motion.rz_rad) * 5, row, color="#2e7d32", label="r  [deg × 5], + turns clockwise")
    axes[2].set(ylim=(255, 0), title="motion of each RS row", ylabel="row ↓")
    axes[2].legend(fontsize=8, loc="upper right")
    figure.tight_layout()
    figure.savefig(HERE / "conventions.svg", metadata={"Date": None})


def before_after() -> None:
    """The demo photo, what the default estimator makes of it, and the original side by side."""
    import pyvips

    import unshutter
    from unshutter.photo import Photo

    examples = HERE.parent.parent / "examples"
    rectified = unshutter.rectify(examples / "demo.jpg").photo.image
    original = Photo.open(examples / "original" / "basilica.webp").image
    size, top, left = 490, (original.height - 490) // 2, (original.width - 490) // 2
    panels = [Photo.open(examples / "demo.jpg").image, rectified, original.crop(left, top, size, size)]
    pyvips.Image.arrayjoin(panels, shim=6, background=255).jpegsave(str(HERE / "before_after.jpg"), Q=88)


def what_goes_wrong() -> None:
    """Two photos without rolling shutter that the default estimator changes: as they are, and what it makes of them."""
    import cv2
    import skimage.data

    import unshutter
    from unshutter.photo import Photo

    basilica = Photo.open(HERE.parent.parent / "examples" / "original" / "basilica.webp").to_array()
    rows = []
    for picture, known in ((askew(basilica, 3.0), {"roll_deg": 3.0}), (skimage.data.chelsea(), None)):
        found = unshutter.estimate(picture)
        share = 256 / found.height
        print(f"max|t_x| {np.abs(found.tx_px).max() * share:.1f} px of 256 rows, confidence {found.confidence:.2f}")
        panels = [picture, unshutter.rectify(picture, motion=found)]
        panels.append(unshutter.rectify(picture, **known) if known else np.full_like(picture, 255))
        height = round(420 * picture.shape[0] / picture.shape[1])
        small = [cv2.resize(panel, (420, height), interpolation=cv2.INTER_AREA) for panel in panels]
        rows.append(cv2.hconcat(small))
    sheet = np.ascontiguousarray(cv2.vconcat(rows))
    Photo.from_array(sheet).save(HERE / "what_goes_wrong.jpg", overwrite=True, quality=86)


def askew(picture: np.ndarray, roll_deg: float) -> np.ndarray:
    """What a camera sees that is turned clockwise: the middle of the picture, turned the other way."""
    import cv2

    height, width = picture.shape[:2]
    turn = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), roll_deg, 1)
    turned = cv2.warpAffine(picture, turn, (width, height), flags=cv2.INTER_CUBIC)
    top, left = round(0.09 * height), round(0.09 * width)
    return np.ascontiguousarray(turned[top : height - top, left : width - left])


if __name__ == "__main__":
    plt.switch_backend("svg")
    conventions()
    before_after()
    what_goes_wrong()
