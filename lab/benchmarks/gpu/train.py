"""Trains the networks one after another on a machine that is lent for minutes; the next run goes on where it stopped.

    python lab/benchmarks/gpu/train.py BUNDLE PARCELS --from PARCELS-OF-THE-RUN-BEFORE --minutes 9
    python lab/benchmarks/gpu/train.py BUNDLE PARCELS --configs kandula2020-free-gpu:6 kandula2020-free-gpu-again:3

BUNDLE is what bundle.py wrote. PARCELS gets a parcel for each network (parcels.py), those that were not touched
included: carry the whole folder to the next run. A network that is given minutes takes as many steps as these allow,
and ends with its rate at zero. Needs torch, NumPy and OpenCV. At home again, ``python lab/benchmarks/gpu/unpack.py
PARCELS RUNS`` makes runs of the parcels.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import parcels
from bundle_names import PHOTOS, PLACES, SOURCES, VALIDATION

if TYPE_CHECKING:
    from drawing import Drawing

    from unshutter_lab.training.config import TrainConfig
    from unshutter_lab.training.train import Trainer

NETWORKS = ("kandula2020-gpu", "rengarajan2017-rowcol-gpu", "rengarajan2017-vanilla-gpu", "segment-transformer")
_MARGIN = 0.5  # minutes kept for the last validation and for packing
_TRIED = 0.08  # share of a network's minutes after which its speed is measured; as much again measures it


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("parcels", type=Path)
    parser.add_argument("--from", dest="before", type=Path, help="the parcels of the run before")
    parser.add_argument("--minutes", type=float, default=9.0)
    parser.add_argument("--configs", nargs="+", default=list(NETWORKS), metavar="NAME[:MINUTES]")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--steps", type=int, help="instead of the configurations': to try it out")
    parser.add_argument("--batch", type=int, help="likewise")
    parser.add_argument("--held-out", type=int, help="photos for validation, likewise")
    given = parser.parse_args()
    started = time.monotonic()
    sys.path.insert(0, str(given.bundle / SOURCES))
    given.parcels.mkdir(parents=True, exist_ok=True)
    if given.before is not None and given.before.resolve() != given.parcels.resolve():
        for part in given.before.iterdir():
            shutil.copyfile(part, given.parcels / part.name)
    drawing = start_drawing(given)
    with tempfile.TemporaryDirectory() as runs:
        for config in given.configs:
            left = given.minutes - _MARGIN - (time.monotonic() - started) / 60
            if left > 0:
                train(config, given, left, Path(runs), drawing)
    if drawing is not None:
        drawing.stop()
    print(f"{(time.monotonic() - started) / 60:.1f} minutes in all", flush=True)


def name_and_minutes(wanted: str) -> tuple[str, float | None]:
    """Returns a configuration, and its minutes if any are stated."""
    name, _, minutes = wanted.rpartition(":")
    try:
        return (name, float(minutes)) if name else (wanted, None)
    except ValueError:
        return wanted, None


def start_drawing(given: argparse.Namespace) -> Drawing | None:
    """Starts to draw for the networks that have minutes, if there are any."""
    names = [name for name, minutes in map(name_and_minutes, given.configs) if minutes is not None]
    if not names:
        return None
    from drawing import Drawing

    sizes = {
        (data["canvas"], data["places"]["drawn_side"]) for data in (settings_of(name, given).data for name in names)
    }
    if len(sizes) > 1:
        sys.exit(f"{', '.join(names)}: networks that are given minutes share what is drawn, so their sizes must agree")
    return Drawing(*sizes.pop())


def train(wanted: str, given: argparse.Namespace, minutes: float, runs: Path, drawing: Drawing | None) -> None:
    """Trains one network for at most this many minutes, and packs it."""
    import torch

    from unshutter_lab.training.train import CHECKPOINT, Trainer

    began = time.monotonic()
    config, own_minutes = name_and_minutes(wanted)
    settings = settings_of(config, given)
    device = given.device if given.device != "auto" else "cuda" if torch.cuda.is_available() else "cpu"
    name = Path(config).stem
    torch.set_num_threads(settings.threads)
    torch.set_float32_matmul_precision("high")
    torch.backends.cudnn.benchmark = True
    folder = runs / name
    folder.mkdir()
    parcels.unpack(name, given.parcels, runs)
    if settings.continues and not (runs / settings.continues).exists():
        parcels.unpack(settings.continues, given.parcels, runs)
    start = runs / settings.continues / CHECKPOINT if settings.continues else None
    begun_with = settings
    if own_minutes is not None:  # few are drawn here, since others draw all the while
        fewer = {"drawn": 1, "places": {**settings.data["places"], "drawn": 1}}
        begun_with = replace(settings, data={**settings.data, **fewer})
    trainer = Trainer(begun_with, folder, torch.device(device), start)
    trainer.config = settings
    before = trainer.step
    since = time.monotonic()
    if before >= settings.steps:
        return
    print(f"{name}: prepared in {since - began:.0f} s", flush=True)
    left = minutes - (since - began) / 60
    if own_minutes is not None and drawing is not None:
        finished = train_for(trainer, drawing, min(own_minutes, left), left)
    else:
        finished = trainer.train(left)
    done = trainer.step - before
    seconds = time.monotonic() - since
    print(f"{name}: {done} steps, {done * settings.batch / max(seconds, 1e-9):.0f} samples/s", flush=True)
    if not parcels.pack(folder, given.parcels, finished):
        print(f"{name}: not finished, and too large to travel: the next run begins anew", flush=True)


def train_for(trainer: Trainer, drawing: Drawing, minutes: float, at_most: float) -> bool:
    """Trains for this many minutes, with a rate that falls to zero, on drawn pictures that keep changing."""
    from unshutter_lab.training.recipes import PixelRecipe

    assert isinstance(trainer.recipe, PixelRecipe)
    data = trainer.recipe.data
    began = time.monotonic()
    drawing.fill(data)
    print(f"{len(data.drawn)} corners after {time.monotonic() - began:.0f} s", flush=True)
    trainer.before_step = lambda: drawing.renew(data)
    trainer.train(_TRIED * minutes)  # chooses kernels
    first = trainer.step
    since = time.monotonic()
    trainer.train(_TRIED * minutes)
    speed = (trainer.step - first) / (time.monotonic() - since)  # steps a second
    left = 60 * minutes - (time.monotonic() - began)
    trainer.config = replace(trainer.config, steps=trainer.step + max(int(speed * left), 1))
    print(f"{speed:.1f} steps a second: {trainer.config.steps} steps; {drawing.count} drawn so far", flush=True)
    finished = trainer.train(at_most - (time.monotonic() - began) / 60)
    print(f"{drawing.count} corners and towns drawn", flush=True)
    return finished


def settings_of(config: str, given: argparse.Namespace) -> TrainConfig:
    """Returns a configuration, with the bundle's folders."""
    from unshutter_lab.training.config import load_config

    settings = load_config(config)
    settings = replace(settings, steps=given.steps or settings.steps, batch=given.batch or settings.batch)
    data = dict(settings.data)
    if "folder" in data:
        data["folder"] = str(given.bundle / PHOTOS)
    if "validation_folder" in data:
        data["validation_folder"] = str(given.bundle / VALIDATION)
    if given.held_out is not None and "folder" in data:
        data["held_out"] = given.held_out
    if data.get("places", {}).get("folder"):
        data["places"] = {**data["places"], "folder": str(given.bundle / PLACES)}
    return replace(settings, data=data)


if __name__ == "__main__":
    main()
