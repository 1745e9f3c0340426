"""Plots motions (extra ``plot``)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from unshutter import installation
from unshutter.errors import UnshutterError, UsageError
from unshutter.motion import Motion
from unshutter.motion.speed import Speed
from unshutter.motion.verdict import Verdict
from unshutter.options import Undo
from unshutter.storage.files import written_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from unshutter.geometry.shapes import Float64


def plot_motion(motion: Motion, path: str | os.PathLike[str], title: str = "", readout_ms: float | None = None) -> None:
    """Plots t_x [px] and r_z [deg] against the row, top row first, into a PNG, SVG or PDF file.

    The title states how far the motion moves the photo, or why the photo would be left unchanged.
    With the readout time, speeds are also plotted: across and along the rows [px/s], and angular [deg/s].

    Raises:
        UnshutterError: matplotlib is not installed, or the file cannot be written.
    """
    curves = {"t_x [px]": motion.tx_px, "r_z [deg]": np.degrees(motion.rz_rad)}
    if readout_ms is not None:
        speed = Speed.of(motion, readout_ms)
        curves |= {
            "velocity: columns, rows [px/s]": speed.velocity_px_s,
            "angular velocity [deg/s]": speed.angular_deg_s,
        }
    figure = _figure(3.5 * len(curves))
    axes = figure.subplots(1, len(curves), sharey=True)
    rows = np.arange(motion.height)
    for axis, (label, values) in zip(axes, curves.items(), strict=True):
        axis.plot(values, rows)
        axis.axhline(motion.reference_row, color="grey", lw=0.6, ls=":")
        axis.set_xlabel(label)
    axes[0].set_ylabel("row")
    axes[0].invert_yaxis()
    name = f"{title} ({motion.estimator})" if title else motion.estimator
    verdict = Verdict.of(motion, Undo())
    about = verdict.described() if verdict.changes else f"left unchanged ({verdict.described()})"
    figure.suptitle(f"{name}\n{about}", fontsize=10)
    _save(figure, Path(path))


def plot_turns(
    times_s: Float64[np.ndarray, "frames"],
    rates_deg_s: Float64[np.ndarray, "frames 3"],
    cuts_s: Sequence[float],
    path: Path,
    title: str = "",
    overwrite: bool = True,
) -> None:
    """Plots how fast the camera turned during a clip, into a PNG, SVG or PDF file.

    Args:
        times_s: time at which each frame is shown [s].
        rates_deg_s: angular velocity about x (pitch), y (yaw) and z (roll) [deg/s]; NaN where unknown.
        cuts_s: times of scene changes [s].
        path: file to write.
        title: title of the plot.
        overwrite: whether an existing file may be replaced.

    Raises:
        UnshutterError: matplotlib is not installed, or the file cannot be written.
    """
    figure = _figure(10)
    axes = figure.subplots()
    for name, values in zip(("r_x (pitch)", "r_y (yaw)", "r_z (roll)"), rates_deg_s.T, strict=True):
        axes.plot(times_s, values, label=name, lw=1)
    for cut in cuts_s:
        axes.axvline(cut, color="grey", lw=0.6, ls=":")
    axes.axhline(0, color="grey", lw=0.6)
    axes.set(xlabel="time [s]", ylabel="angular velocity [deg/s]")
    axes.legend(loc="upper right")
    figure.suptitle(title, fontsize=10)
    _save(figure, path, overwrite)


def check_plot(path: Path) -> None:
    """Checks that a plot can be written, before any work is done.

    Raises:
        UnshutterError: matplotlib is not installed.
        UsageError: matplotlib does not support the file type.
    """
    known = _figure(1).canvas.get_supported_filetypes()
    if path.suffix.lower().removeprefix(".") not in known:
        raise UsageError(f"a plot is a .png, .svg or .pdf file, not {path.name}")


def _figure(width: float) -> Figure:
    """Creates an empty figure of this width [inches]."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise UnshutterError(f"plots need the extra: {installation.extra('plot')}") from None
    return Figure(figsize=(width, 4), layout="constrained")


def _save(figure: Figure, path: Path, overwrite: bool = True) -> None:
    try:
        with written_whole(path, overwrite) as part:
            figure.savefig(part, dpi=150)
    except ValueError as error:  # an extension that matplotlib does not support
        raise UnshutterError(f"cannot write {path}: {str(error).splitlines()[0]}") from None
