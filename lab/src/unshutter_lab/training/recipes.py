"""Recipes: a network's training data, loss, validation and export, and the errors of a batch of motions.

To add a network, implement :class:`Recipe`, or :class:`PixelRecipe` if it reads pictures, in a file of its own, and add
its line to ``RECIPES``. Such a file never imports that of another network.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import torch
from torch import Tensor, nn

from unshutter.errors import UsageError
from unshutter.motion import geometry
from unshutter_lab.training.config import TrainConfig, from_table
from unshutter_lab.training.pixels import PixelConfig, PixelData, Samples, pixel_grid
from unshutter_lab.training.weights import load_exported, start_from_checkpoint

TX_UNIT = 100.0  # px: with it t_x and r_z [rad] move a picture of 256 px by similar amounts (Rengarajan 2017)
_START_PICTURES, _START_SEED = 128, 2**40  # for the input statistics of an exported network's layers


def motion_mse(tx: Tensor, rz: Tensor, true_tx: Tensor, true_rz: Tensor) -> Tensor:
    """MSE of (t_x / 100 px, r_z / 1 rad) over rows and batch, each [B, rows]."""
    return 0.5 * _squared(tx - true_tx, rz - true_rz).mean()


def motion_distance(tx: Tensor, rz: Tensor, true_tx: Tensor, true_rz: Tensor) -> Tensor:
    """Mean distance in (t_x / 100 px, r_z / 1 rad) over rows and batch, each [B, rows].

    Smoothed at about a hundredth of a pixel, so that its gradient is continuous at zero.
    """
    return (_squared(tx - true_tx, rz - true_rz) + 1e-8).sqrt().mean()


def motion_size(motion: Tensor) -> Tensor:
    """Returns the root mean square over rows of (t_x / 100 px, r_z / 1 rad) of motions [B, 2, rows], [B]."""
    return _squared(motion[:, 0], motion[:, 1]).mean(1).sqrt()


def _squared(tx: Tensor, rz: Tensor) -> Tensor:
    return (tx / TX_UNIT).square() + rz.square()


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


def validation_figures(error: Tensor, nothing: Tensor) -> dict[str, float]:
    """Figures for the log, from the EPE [N] of the network and of the unchanged pictures [px]."""
    return {
        "val_epe_median": error.median().item(),
        "val_epe_nothing": nothing.median().item(),
        "val_improved": (error < nothing).float().mean().item(),
    }


# model of the configuration -> module:class, imported only when trained
RECIPES = {
    "kandula2020": "unshutter_lab.training.kandula2020_recipe:KandulaRecipe",
    "rengarajan2017": "unshutter_lab.training.rengarajan2017:RengarajanRecipe",
    "segment-transformer": "unshutter_lab.training.segment_transformer:SegmentRecipe",
}


class Recipe(ABC):
    """The model-specific part of training."""

    model_file: str  # name of the exported network in the run's folder

    def __init__(self, config: TrainConfig, device: torch.device):
        self.config, self.device = config, device

    @abstractmethod
    def build(self) -> nn.Module:
        """Returns a new network, initialised from torch's global generator."""

    @abstractmethod
    def loss(self, network: nn.Module, step: int, generator: torch.Generator) -> tuple[Tensor, dict[str, float]]:
        """Returns the loss on a new batch drawn with ``generator``, and figures for the log."""

    @abstractmethod
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Returns figures on data not used in training, the same at each call."""

    @abstractmethod
    def export(self, network: nn.Module, path: Path) -> None:
        """Writes the network in the form in which estimators run it."""

    @abstractmethod
    def load_model(self, network: nn.Module, path: Path) -> None:
        """Copies the weights of an exported network of this kind into one in training.

        Raises:
            UnshutterError: the file cannot be read, or is of another network.
        """

    def start(self, network: nn.Module, path: Path) -> None:
        """Copies the weights of a checkpoint or of an exported network into a new one."""
        if path.suffix not in (".npz", ".onnx"):
            start_from_checkpoint(network, path)
        elif path.suffix == Path(self.model_file).suffix:
            self.load_model(network, path)
        else:
            kind = f"weights of {self.config.model} are not stored as {path.suffix}"
            raise UsageError(f"cannot start from {path}: {kind}")


class PixelRecipe(Recipe):
    """A network that reads pictures [B, 3, r, r], is exported as ONNX, and is judged by its sampling positions."""

    model_file = "model.onnx"
    more_figures: tuple[str, ...] = ()  # names of the median EPE of all ``positions`` but the first

    def __init__(self, config: TrainConfig, device: torch.device):
        super().__init__(config, device)
        self.data = PixelData(from_table(PixelConfig, config.data, "[data]"), device)

    @abstractmethod
    def positions(self, network: nn.Module, samples: Samples) -> Iterator[tuple[Tensor, Tensor]]:
        """Yields estimated RS positions (col, row) [B, r, r] [px]; first those that count."""

    def pictures(self, count: int, generator: torch.Generator) -> Tensor:
        """Returns training pictures as the network reads them, [count, 3, r, r] in 0 ... 1."""
        return self.data.batch(count, generator).rs

    def load_model(self, network: nn.Module, path: Path) -> None:
        """See :class:`Recipe`."""
        generator = torch.Generator(self.device).manual_seed(_START_SEED)
        load_exported(network, path, self.pictures(_START_PICTURES, generator))

    @torch.no_grad()
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Returns the EPE on held-out photos, for other kinds of motion, and on training photos."""
        held_out = []
        for samples in self.data.validation():
            col, row = pixel_grid(samples.size, samples.rs)
            held_out.append([epe(*at, samples) for at in (*self.positions(network, samples), (col, row))])
        system, *more, nothing = (torch.cat(errors) for errors in zip(*held_out, strict=True))
        figures = validation_figures(system, nothing)
        figures |= {name: errors.median().item() for name, errors in zip(self.more_figures, more, strict=True)}
        for name, batches in self.data.other_checks().items():
            errors = [epe(*next(self.positions(network, samples)), samples) for samples in batches]
            figures[name] = torch.cat(errors).median().item()
        return figures


def make_recipe(config: TrainConfig, device: torch.device) -> Recipe:
    """Returns the recipe named in the configuration."""
    if config.model not in RECIPES:
        raise UsageError(f"unknown model '{config.model}': choose one of {', '.join(RECIPES)}")
    module, _, name = RECIPES[config.model].partition(":")
    return getattr(import_module(module), name)(config, device)
