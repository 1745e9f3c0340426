"""Pictures of motions (extra ``plot``)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion import Motion
from unshutter.motion.speed import Speed
from unshutter.motion.verdict import Verdict
from unshutter.options import Undo
from unshutter.storage.files import written_whole


def plot_motion(motion: Motion, path: str | os.PathLike[str], title: str = "", readout_ms: float | None = None) -> None:
    """Draws t_x [px] and r_z [deg] over the rows, first row on top, into a PNG, SVG or PDF file.

    Above stands how far it moves the photo, or why the photo would be left as it is.
    With the time of the readout, the speed, too: across and along the rows [px/s], and angular [deg/s].

    Raises:
        UnshutterError: matplotlib is not installed, or the file cannot be written.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise UnshutterError("plots need the extra: pip install 'unshutter[plot]'") from None
    curves = {"t_x [px]": motion.tx_px, "r_z [deg]": np.degrees(motion.rz_rad)}
    if readout_ms is not None:
        speed = Speed.of(motion, readout_ms)
        curves |= {
            "velocity: columns, rows [px/s]": speed.velocity_px_s,
            "angular velocity [deg/s]": speed.angular_deg_s,
        }
    figure = Figure(figsize=(3.5 * len(curves), 4), layout="constrained")
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
    about = verdict.told() if verdict.changes else f"left as it is ({verdict.told()})"
    figure.suptitle(f"{name}\n{about}", fontsize=10)
    try:
        with written_whole(Path(path)) as part:
            figure.savefig(part, dpi=150)
    except ValueError as error:  # an ending that matplotlib does not know
        raise UnshutterError(f"cannot write {path}: {str(error).splitlines()[0]}") from None
