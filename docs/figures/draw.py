"""Draws the figures of the docs: ``python docs/figures/draw.py`` (needs the extra ``plot``)."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from unshutter import RowMotion
from unshutter_lab.synthesis.rotation_log import RotationLog

HERE = Path(__file__).parent
ROOT = HERE.parent.parent
WEB = ROOT / "src" / "unshutter" / "page" / "web"
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
    """The sample of the page and what `make demo` makes of it; and the first photo of the tutorial."""
    import unshutter

    photos = {"before_after": WEB / "sample.jpg", "first_photo": ROOT / "examples" / "demo.jpg"}
    for name, photo in photos.items():
        result = unshutter.rectify(photo, edges="keep")
        side_by_side(name, result.original.to_array(), result.array, result.valid)


def side_by_side(name: str, before: np.ndarray, after: np.ndarray, valid: np.ndarray) -> None:
    """Saves two pictures of one size: both in the frame of what the second one shows."""
    from unshutter.motion.edges import valid_window
    from unshutter.photo import Photo

    window = valid_window(valid, any_shape=True)
    parts = [each[window.top : window.bottom, window.left : window.right] for each in (before, after)]
    one, other = (Photo.from_array(np.ascontiguousarray(part)).image for part in parts)
    both = one.join(other, "horizontal", expand=True, shim=10, background=255)
    both.resize(min(1, 1200 / both.width)).jpegsave(str(HERE / f"{name}.jpg"), Q=85)


def burst() -> None:
    """The middle one of the example's three frames of a swinging camera, and what its neighbours make of it."""
    import unshutter
    from unshutter.photo import Photo

    frames = [Photo.open(ROOT / "examples" / "burst" / f"{name}.jpg").to_array() for name in "abc"]
    straight = list(unshutter.rectify_frames(frames, readout_ratio=0.7, edges="keep"))[1]
    side_by_side("burst", frames[1], straight.array, straight.valid)


def clip() -> None:
    """The example's clip and what unshutter makes of it: two seconds as an animation, and its most distorted frame."""
    import runpy
    import tempfile

    import cv2
    from PIL import Image

    import unshutter
    from unshutter.motion.edges import valid_window

    walk = ROOT / "examples" / "walk.mp4"
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "straight.mp4"
        unshutter.rectify_clip(walk, output, readout_ms=20)
        frames, straight = frames_of(walk), frames_of(output)
    smaller = {"dsize": None, "fx": 2 / 3, "fy": 2 / 3, "interpolation": cv2.INTER_AREA}
    pairs = [cv2.resize(np.hstack(pair), **smaller) for pair in zip(frames, straight, strict=True)]
    first, *others = [Image.fromarray(pair) for pair in pairs[6:66:2]]
    first.save(HERE / "clip.webp", save_all=True, append_images=others, duration=67, loop=0, quality=60, method=6)

    render = runpy.run_path(str(ROOT / "examples" / "render.py"))
    truths = list(render["seen"](render["walk"](), 0.0, is_global=True))
    options = {"readout_ms": 20, "fps": 30, "model": "camera", "edges": "keep", "reference": "middle"}
    results = list(unshutter.rectify_frames(frames, **options))
    windows = [valid_window(result.valid, any_shape=True) for result in results]
    shown = [
        [each[w.top : w.bottom, w.left : w.right] for each in (before, result.array, truth)]
        for before, result, truth, w in zip(frames, results, truths, windows, strict=True)
    ]
    gains = np.array([[cv2.PSNR(panel, panels[-1]) for panel in panels[:-1]] for panels in shown])
    worst = int(gains[:, 0].argmin())
    print("PSNR [dB] before and after: the worst frame", gains[worst].round(1), "the clip", gains.mean(axis=0).round(1))
    panels = [np.pad(panel, ((0, 0), (0, 6), (0, 0)), constant_values=255) for panel in shown[worst]]
    Image.fromarray(np.hstack(panels)[:, :-6]).save(HERE / "clip.jpg", quality=86)


def frames_of(clip: Path) -> list[np.ndarray]:
    """Returns the frames [H, W, 3] of a clip."""
    import av

    with av.open(str(clip)) as video:
        return [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]


def time_against_rows() -> None:
    """When the rows of two frames are exposed, and what that does to a pole that moves evenly."""
    ratio, speed = 0.7, 0.3  # of a frame interval; frame widths per frame interval
    blue, red, grey = "#1565c0", "#c62828", "#777777"
    figure, (clock, scene) = plt.subplots(1, 2, figsize=(11, 4.2), width_ratios=[1.35, 1])
    for frame in (0, 1):
        clock.plot([frame, frame + ratio], [0, 1], color=blue, lw=2.5)
        clock.text(frame, -0.04, f"frame {frame}", color=blue, fontsize=9, ha="center")
    clock.plot([ratio, 1], [1, 0], color=grey, lw=0.8, ls=":")
    rows = np.array([0.45, 0.6])  # of one thing, in both frames
    times = np.array([0, 1]) + ratio * rows
    first, second = zip(times, rows, strict=True)
    clock.annotate("", second, first, arrowprops={"arrowstyle": "->", "color": red, "lw": 1.6})
    clock.plot(times, rows, "o", color=red, ms=5)
    clock.text(times.mean(), rows.mean() - 0.05, "one thing, seen twice", color=red, fontsize=9, ha="center")
    clock.annotate("", (times[1], 0.86), (times[0], 0.86), arrowprops={"arrowstyle": "<->", "color": red})
    clock.text(times.mean() + 0.06, 0.83, r"$\Delta = 1 + \gamma\,F_y / H$", color=red, fontsize=9, ha="center")
    clock.axvline(ratio / 2, color="#2e7d32", ls="--", lw=1.2)
    clock.text(ratio / 2 + 0.02, 1.1, "moment of the picture", color="#2e7d32", fontsize=9)
    clock.annotate("", (ratio, 0.98), (0, 0.98), arrowprops={"arrowstyle": "<->", "color": "black"})
    clock.text(0.12, 0.95, r"readout $\gamma$", fontsize=9, ha="center")
    clock.set(xlim=(-0.15, 1.85), ylim=(1.13, -0.12), xlabel="time in frame intervals →", ylabel="row ↓")
    clock.set(yticks=[0, 0.5, 1], yticklabels=["0", "H/2", "H"], xticks=[0, 1], title="when each row is exposed")
    down = np.array([0.0, 1.0])
    for frame in (0, 1):
        scene.plot(0.25 + speed * (frame + ratio * down), down, color=blue, lw=4)
        scene.text(0.25 + speed * frame, -0.03, f"frame {frame}", color=blue, fontsize=9, ha="center")
    scene.plot([0.25 + speed * ratio / 2] * 2, down, color="#2e7d32", ls="--", lw=1.5)
    scene.text(0.235 + speed * ratio / 2, 0.8, "as a global\nshutter sees it", color="#2e7d32", fontsize=9, ha="right")
    scene.annotate("", (0.25 + speed, 0.03), (0.25, 0.03), arrowprops={"arrowstyle": "->", "color": red})
    scene.text(0.25 + 0.69 * speed, 0.09, "moved by $v$", color=red, fontsize=9, ha="center")
    scene.annotate("", (0.25 + speed * ratio, 1.04), (0.25, 1.04), arrowprops={"arrowstyle": "->", "color": red})
    scene.text(0.25 + speed * ratio / 2, 1.1, r"sheared by $\gamma\,v$", color=red, fontsize=9, ha="center")
    scene.set(xlim=(0, 1), ylim=(1.13, -0.12), xticks=[], yticks=[], title="a pole that moves evenly to the right")
    figure.tight_layout()
    figure.savefig(HERE / "time_against_rows.svg", metadata={"Date": None})


def two_frames() -> None:
    """A cup and a basilica, filmed by a camera that swings: a frame, what one frame tells, what two tell, the truth."""
    import cv2
    import skimage.data

    import unshutter
    from unshutter.photo import Photo
    from unshutter_lab.synthesis.sequences import RotatingCamera

    basilica = Photo.open(ROOT / "examples" / "original" / "basilica.webp").to_array()
    rows = []
    for picture, start in ((basilica, 0.8), (skimage.data.coffee(), 0.8)):
        camera = RotatingCamera(hand(), start, 2, 30.0, 0.75, 360, 480, 480.0)
        frames = list(camera.rendered(picture, noise=2.0))
        one = unshutter.rectify(frames[0], reference="middle", edges="keep")
        two = next(unshutter.rectify_frames(frames, readout_ratio=camera.readout_ratio, reference="middle"))
        true = unshutter.rectify(frames[0], motion=camera.motion(0, "middle"), edges="keep")
        shown = [panel[30:330, 60:420] for panel in (frames[0], one.array, two.array, true.array)]  # without the edges
        panels = [np.pad(panel, ((0, 6), (0, 6), (0, 0)), constant_values=255) for panel in shown]
        print("PSNR [dB]:", *(round(cv2.PSNR(panel, shown[-1]), 1) for panel in shown[:-1]))
        rows.append(cv2.hconcat(panels))
    Photo.from_array(np.ascontiguousarray(cv2.vconcat(rows))).save(HERE / "two_frames.jpg", overwrite=True, quality=86)


def hand() -> RotationLog:
    """Three seconds of a hand that swings a camera about: sums of sines of 0.6 to 2.9 Hz."""
    rng = np.random.default_rng(7)
    times = np.arange(0, 3, 0.005)
    rates = np.zeros((3, len(times)))
    for hertz in (0.6, 1.3, 2.9):
        strength, phase = rng.uniform(0.5, 1, (3, 1)) * [[170], [50], [40]], rng.uniform(0, 2 * np.pi, (3, 1))
        rates += strength * np.sin(2 * np.pi * hertz * times + phase)
    return RotationLog(times, *np.radians(rates))


if __name__ == "__main__":
    plt.switch_backend("svg")
    conventions()
    before_after()
    burst()
    clip()
    time_against_rows()
    two_frames()
