"""Errors of a batch of motions against the true ones, for losses and for figures in the log."""

from __future__ import annotations

import torch
from torch import Tensor

from unshutter.geometry import rows as geometry
from unshutter_lab.training.data.pixels import Samples
from unshutter_lab.training.warping import pixel_grid

TX_UNIT = 100.0  # px: with it t_x and r_z [rad] move a picture of 256 px by similar amounts (Rengarajan 2017)


def motion_mse(tx: Tensor, rz: Tensor, true_tx: Tensor, true_rz: Tensor) -> Tensor:
    """MSE of (t_x / 100 px, r_z / 1 rad) over rows and batch, each [B, rows]."""
    return 0.5 * (((tx - true_tx) / TX_UNIT).square().mean() + (rz - true_rz).square().mean())


def motion_distance(tx: Tensor, rz: Tensor, true_tx: Tensor, true_rz: Tensor) -> Tensor:
    """Mean distance in (t_x / 100 px, r_z / 1 rad) over rows and batch, each [B, rows].

    Smoothed at about a hundredth of a pixel, so that its gradient is continuous at zero.
    """
    squared = ((tx - true_tx) / TX_UNIT).square() + (rz - true_rz).square()
    return (squared + 1e-8).sqrt().mean()


def epe(col: Tensor, row: Tensor, samples: Samples) -> Tensor:
    """[B] mean distance [px] of estimated RS positions [B, r, r] from the true ones.

    Taken over the GS pixels whose true RS position lies inside the RS picture.
    """
    x, y = pixel_grid(samples.size, samples.rs)
    true_col, true_row = geometry.gs_to_rs(x, y + 0 * x, samples.motion, samples.center)
    last = samples.size - 1
    visible = (true_col >= 0) & (true_col <= last) & (true_row >= 0) & (true_row <= last)
    distance = torch.hypot(col - true_col, row - true_row)
    return (distance * visible).sum((1, 2)) / visible.sum((1, 2)).clamp(min=1)


def epe_of_nothing(samples: Samples) -> Tensor:
    """[B] EPE [px] without correction."""
    col, row = pixel_grid(samples.size, samples.rs)
    return epe(col, row, samples)


def validation_figures(error: Tensor, nothing: Tensor) -> dict[str, float]:
    """Returns figures for the log: median EPE [px], that without correction, and the share of improved pictures.

    Args:
        error: [N] EPE of the network.
        nothing: [N] EPE of the unchanged pictures.
    """
    return {
        "val_epe_median": error.median().item(),
        "val_epe_nothing": nothing.median().item(),
        "val_improved": (error < nothing).float().mean().item(),
    }
