"""Plots of results, based on the records alone, and contact sheets: input, results and truth side by side."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyvips

from unshutter import version
from unshutter.errors import UnshutterError
from unshutter.photo import Photo
from unshutter.storage.files import written_whole
from unshutter_lab.evaluation.case import NOTHING, Example
from unshutter_lab.evaluation.protocols import PROTOCOLS
from unshutter_lab.evaluation.results import Results

_QUANTILES = np.linspace(0, 1, 41)
_BINS = 6
_LONGEST = 30  # characters of a name in a plot
_STYLE: dict[Any, Any] = {"font.size": 9}
_DPI = 110


def check_matplotlib() -> None:
    """Checks that plots can be drawn."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise UnshutterError(f"evaluate draws plots and needs the extra: {version.extra('plot')}") from None


def draw_plots(results: Results, folder: Path, prefix: str = "") -> list[tuple[str, str]]:
    """Draws the plots of the protocol; returns (file name, caption) of each."""
    check_matplotlib()
    kind = PROTOCOLS[results.request.protocol].kind
    plots: list[tuple[str, str, Callable[[Results], Any]]] = []
    if kind in ("motion", "still", "sequences"):
        plots.append(("epe", "Share of pictures with an EPE up to that on the axis.", _distributions))
    if kind == "motion":
        caption = "Median EPE against the size of the motion. On the grey line nothing is gained."
        plots.append(("size", caption, _against_size))
    if kind in ("pairs", "video"):
        plots.append(("bars", "Each picture is a dot, the mean of a method a line.", _dots))
    if results.curves and kind == "motion":
        plots.append(("curves", "Motions found (coloured) and true (black) of some pictures.", _curves))
    drawn = []
    for name, caption, draw in plots:
        file = f"{prefix}{name}.png"
        save_figure(draw(results), folder / file)
        drawn.append((file, caption))
    return drawn


def new_figure(panels: int, height: float = 3.0, rows: int = 1):
    """Returns a figure and its axes [rows, panels]; the height is in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(min(3.2 * panels + 2, 13), height), layout="constrained")
    return figure, figure.subplots(rows, panels, squeeze=False)


def save_figure(figure: Any, path: Path) -> None:
    """Writes a PNG with a palette: a third of the size, and unlike SVG independent of the number of methods."""
    import matplotlib

    stream = io.BytesIO()
    with matplotlib.rc_context(_STYLE):
        figure.savefig(stream, format="png", dpi=_DPI)
    image = pyvips.Image.new_from_buffer(stream.getvalue(), "").flatten(background=[255])
    with written_whole(path) as part:
        image.pngsave(str(part), palette=True, Q=80, dither=0, effort=7)


def _panels(results: Results) -> list[tuple[str, dict[str, str]]]:
    """Returns (title, criteria for the records) of each panel: a folder, or a suite if folders are pooled."""
    key = PROTOCOLS[results.request.protocol].rows
    return [(value, {key: value}) for value in results.distinct(key)]


def _distributions(results: Results):
    panels = _panels(results)
    rows = -(-len(panels) // 5)
    figure, axes = new_figure(min(len(panels), 5), 3.0 * rows, rows)
    for axis, (title, criteria) in zip(axes.flat, panels, strict=False):
        for name, colour, dashes in styles_of(results):
            axis.plot(
                np.quantile(results.values("epe", estimator=name, **criteria), _QUANTILES),
                _QUANTILES, color=colour, ls=dashes, lw=1.4, label=_short(name),
            )  # fmt: skip
        axis.set(title=title, xlabel="EPE [px at 256 rows]", xscale="symlog", xlim=(0, 60), ylim=(0, 1))
        axis.set_xticks([0, 1, 3, 10, 30], ["0", "1", "3", "10", "30"])
    finish_figure(figure, axes, len(panels), "share of pictures")
    return figure


def _against_size(results: Results):
    panels = _panels(results)
    rows = -(-len(panels) // 5)
    figure, axes = new_figure(min(len(panels), 5), 3.0 * rows, rows)
    for axis, (title, criteria) in zip(axes.flat, panels, strict=False):
        size = results.values("epe_nothing", estimator=results.estimators[0], **criteria)
        edges = np.unique(np.quantile(size, np.linspace(0, 1, min(_BINS, max(len(size) // 3, 1)) + 1)))
        for name, colour, dashes in styles_of(results):
            epe = results.values("epe", estimator=name, **criteria)
            own = results.values("epe_nothing", estimator=name, **criteria)
            within = np.clip(np.searchsorted(edges, own, side="right") - 1, 0, max(len(edges) - 2, 0))
            points = [(np.median(own[within == k]), np.median(epe[within == k])) for k in np.unique(within)]
            axis.plot(*np.transpose(points), color=colour, ls=dashes, lw=1.4, marker=".", label=_short(name))
        axis.axline((0, 0), slope=1, color="0.8", lw=0.8, zorder=0)
        axis.set(title=title, xlabel="EPE of doing nothing [px]", xlim=(0, None), ylim=(0, None))
    finish_figure(figure, axes, len(panels), "median EPE [px]")
    return figure


def _dots(results: Results):
    kind = PROTOCOLS[results.request.protocol].kind
    key, label = ("psnr", "PSNR less the input's [dB]") if kind == "pairs" else ("inliers", "|R_F| less the input's")
    figure, axes = new_figure(len(_panels(results)), 0.32 * len(results.names) + 1)
    for axis, (title, criteria) in zip(axes.flat, _panels(results), strict=True):
        for place, name in enumerate(results.names):
            both = results.chosen(estimator=name, **criteria)[[key, f"{key}_input"]].astype(float)
            gains = (both[key] - both[f"{key}_input"]).dropna()
            axis.plot(gains, [place] * len(gains), ".", color="tab:blue", ms=5, alpha=0.6)
            if len(gains):
                axis.plot([gains.mean()] * 2, [place - 0.35, place + 0.35], color="black", lw=1.5)
        axis.axvline(0, color="0.7", lw=0.8, zorder=0)
        axis.set(title=title, xlabel=label, yticks=range(len(results.names)), ylim=(len(results.names) - 0.5, -0.5))
        axis.set_yticklabels(list(map(_short, results.names)) if axis is axes[0, 0] else [])
    return figure


def _curves(results: Results):
    figure, axes = new_figure(len(results.curves), 5.4, 2)
    styles = {name: (colour, dashes) for name, colour, dashes in styles_of(results)}
    for column, (title, curves) in enumerate(results.curves.items()):
        for axis, key in zip(axes[:, column], ("tx", "rz"), strict=True):
            for name, curve in curves.items():
                colour, dashes = styles.get(name, ("black", "-"))
                wide = 2.2 if name == "truth" else 1.2
                axis.plot(curve["row"], curve[key], color=colour, ls=dashes, lw=wide, label=_short(name))
            axis.set_ylim(*_limits(curves, key))
        axes[0, column].set_title(title.replace(", ", "\n", 1), fontsize=8)
        axes[1, column].set_xlabel("row (first to last)")
    axes[0, 0].set_ylabel("t_x [px at 256 rows]")
    axes[1, 0].set_ylabel("r_z [deg]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right", frameon=False)
    return figure


def _limits(curves: dict[str, dict[str, list[float]]], key: str) -> tuple[float, float]:
    """Returns axis limits from the truth alone, so that one wild estimate does not compress the plot."""
    truth = np.array(curves["truth"][key])
    room = 1.2 * max(np.ptp(truth), 4.0 if key == "tx" else 1.0)
    return float(truth.min() - room), float(truth.max() + room)


def _short(name: str) -> str:
    """Returns the end of a long name, such as that of a folder of answers."""
    return name if len(name) <= _LONGEST else f"…{name[-_LONGEST:]}"


def styles_of(results: Results) -> list[tuple[str, Any, str]]:
    """Returns (name, colour, dashes) of each estimator, consistent across plots; grey for no correction."""
    import matplotlib

    colours = [matplotlib.colormaps["tab10"](k) for k in range(10)]
    others = [name for name in results.estimators if name != NOTHING]
    styles: dict[str, tuple[Any, str]] = {
        name: (colours[k % 10], "-" if k < 10 else "--") for k, name in enumerate(others)
    }
    styles[NOTHING] = ("0.5", ":")
    return [(name, *styles[name]) for name in results.estimators]


def finish_figure(figure: Any, axes: Any, used: int, label: str) -> None:
    """Adds the legend and the label of each row, and hides unused axes."""
    for axis in axes.flat[used:]:
        axis.set_visible(False)
    for row in axes:
        row[0].set_ylabel(label)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside right", frameon=False)


_SIDE = 200  # px of the pictures' longer side
_ACROSS = 5
_GAP = 6
_CAPTION = 18  # px above each picture


def write_sheet(example: Example, path: Path) -> None:
    """Writes a JPEG with all pictures of an example, captioned, in rows."""
    tiles = [pyvips.Image.new_from_array(_tile(*each)) for each in example.pictures]
    whole = pyvips.Image.arrayjoin(tiles, across=min(_ACROSS, len(tiles)), shim=_GAP, background=[255])
    Photo.from_array(whole.numpy()).save(path, quality=82, overwrite=True)


def _tile(caption: str, picture: np.ndarray) -> np.ndarray:
    scale = _SIDE / max(picture.shape[:2])
    size = (round(picture.shape[1] * scale), round(picture.shape[0] * scale))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = cv2.resize(np.ascontiguousarray(picture), size, interpolation=method).reshape(size[1], size[0], -1)
    tile = np.full((size[1] + _CAPTION, size[0], 3), 255, np.uint8)
    tile[_CAPTION:] = small
    font, fit = cv2.FONT_HERSHEY_SIMPLEX, 0.42
    (wide, _), _ = cv2.getTextSize(caption, font, fit, 1)
    fit *= min(1.0, (size[0] - 4) / max(wide, 1))
    return cv2.putText(tile, caption, (2, _CAPTION - 6), font, fit, (0, 0, 0), 1, cv2.LINE_AA)
