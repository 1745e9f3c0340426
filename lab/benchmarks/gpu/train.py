"""Trains the networks one after another on a machine that is lent for minutes; the next run goes on where it stopped.

    python lab/benchmarks/gpu/train.py BUNDLE PARCELS --from PARCELS-OF-THE-RUN-BEFORE --minutes 9

BUNDLE is what bundle.py wrote. PARCELS gets a parcel for each network (parcels.py), those that were not touched
included: carry the whole folder to the next run. Needs torch, NumPy and OpenCV. At home again,
``python lab/benchmarks/gpu/unpack.py PARCELS RUNS`` makes runs of the parcels.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import parcels
from bundle_names import PHOTOS, SOURCES

NETWORKS = ("kandula2020-gpu", "rengarajan2017-rowcol-gpu", "rengarajan2017-vanilla-gpu", "segment-transformer")
_MARGIN = 0.5  # minutes kept for the last validation and for packing


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("parcels", type=Path)
    parser.add_argument("--from", dest="before", type=Path, help="the parcels of the run before")
    parser.add_argument("--minutes", type=float, default=9.0)
    parser.add_argument("--configs", nargs="+", default=list(NETWORKS))
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
    for config in given.configs:
        left = given.minutes - _MARGIN - (time.monotonic() - started) / 60
        if left > 0:
            train(config, given, left)
    print(f"{(time.monotonic() - started) / 60:.1f} minutes in all", flush=True)


def train(config: str, given: argparse.Namespace, minutes: float) -> None:
    """Trains one network for so many minutes at most, and packs it."""
    import torch

    from unshutter_lab.training.config import load_config
    from unshutter_lab.training.train import Trainer

    device = given.device if given.device != "auto" else "cuda" if torch.cuda.is_available() else "cpu"
    settings = load_config(config)
    settings = replace(settings, steps=given.steps or settings.steps, batch=given.batch or settings.batch)
    if "folder" in settings.data:
        fewer = {} if given.held_out is None else {"held_out": given.held_out}
        settings = replace(settings, data={**settings.data, **fewer, "folder": str(given.bundle / PHOTOS)})
    name = Path(config).stem
    torch.set_num_threads(settings.threads)
    torch.set_float32_matmul_precision("high")
    torch.backends.cudnn.benchmark = True
    with tempfile.TemporaryDirectory() as runs:
        folder = Path(runs, name)
        folder.mkdir()
        parcels.unpack(name, given.parcels, Path(runs))
        trainer = Trainer(settings, folder, torch.device(device))
        before, since = trainer.step, time.monotonic()
        if before >= settings.steps:
            return
        finished = trainer.train(minutes)
        done, seconds = trainer.step - before, time.monotonic() - since
        print(f"{name}: {done} steps, {done * settings.batch / max(seconds, 1e-9):.0f} samples/s", flush=True)
        if not parcels.pack(folder, given.parcels, finished):
            print(f"{name}: not finished, and too large to travel: the next run begins anew", flush=True)


if __name__ == "__main__":
    main()
