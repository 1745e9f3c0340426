"""Collects what a bare GPU machine lacks in one folder: small photos, and the sources that training imports.

    python lab/benchmarks/gpu/bundle.py PHOTOS BUNDLE
    python lab/benchmarks/gpu/bundle.py PHOTOS BUNDLE --validation PHOTOS --places PLACES

Photos are scaled to the canvas of the networks' windows and stored as WebP: 1,647 of them take 26 MiB. With the folder
BUNDLE, lab/benchmarks/gpu/train.py needs a Python with torch, NumPy and OpenCV, and nothing installed besides.
"""

from __future__ import annotations

import argparse
import importlib
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
from bundle_names import PHOTOS, PLACES, SOURCES, VALIDATION

from unshutter_lab.synthesis.panorama import FACES, places_in, shipped_places
from unshutter_lab.training.pixels import PixelConfig, load_photos
from unshutter_lab.training.recipes import RECIPES

PACKAGES = ("unshutter", "unshutter_lab", "array_api_compat")  # of which training imports modules; pure Python
TRAINING = (
    "unshutter_lab.training.train",
    *(recipe.partition(":")[0] for recipe in RECIPES.values()),
    "array_api_compat.torch",
)
_FACE = 512  # px, the largest side of a place's faces


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", type=Path)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--validation", type=Path, help="photos to validate on")
    parser.add_argument("--places", type=Path, help="cube maps; those of the benchmark are left out")
    parser.add_argument("--quality", type=int, default=50)
    given = parser.parse_args()
    count = add_photos(given.photos, given.bundle / PHOTOS, given.quality)
    if given.validation is not None:
        count += add_photos(given.validation, given.bundle / VALIDATION, given.quality)
    if given.places is not None:
        add_places(given.places, given.bundle / PLACES, given.quality)
    add_sources(given.bundle / SOURCES)
    size = sum(file.stat().st_size for file in given.bundle.rglob("*") if file.is_file())
    print(f"{given.bundle}: {count} photos, {size / 2**20:.1f} MiB in all")


def add_photos(source: Path, target: Path, quality: int) -> int:
    """Writes every photo of a folder, scaled; returns how many. Their order stays."""
    photos = load_photos(source, PixelConfig().canvas)
    for number, photo in enumerate(photos):
        _write(target / f"{number:05}.webp", photo.transpose(1, 2, 0)[..., ::-1], quality)
    return len(photos)


def add_places(source: Path, target: Path, quality: int) -> None:
    """Writes the faces of places, reduced."""
    kept = set(shipped_places())
    for folder in places_in(source):
        if folder.name in kept:
            continue
        for face in FACES:
            picture = cv2.imdecode(np.fromfile(next(folder.glob(f"{face}.*")), np.uint8), cv2.IMREAD_COLOR)
            if len(picture) > _FACE:
                picture = cv2.resize(picture, (_FACE, _FACE), interpolation=cv2.INTER_AREA)
            _write(target / folder.name / f"{face}.webp", picture, quality)


def _write(file: Path, bgr: np.ndarray, quality: int) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), bgr, [cv2.IMWRITE_WEBP_QUALITY, quality])


def add_sources(target: Path) -> None:
    """Copies the modules that training imports, the benchmark's places by name, and the configurations."""
    for name in TRAINING:
        importlib.import_module(name)
    files = [Path(str(module.__file__)) for name, module in sys.modules.items() if name.partition(".")[0] in PACKAGES]
    files += Path(str(sys.modules["unshutter_lab.training"].__file__)).parent.rglob("*.toml")
    for file in files:
        package = next(parent for parent in file.parents if parent.name in PACKAGES)
        copy = target / file.relative_to(package.parent)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    for name in shipped_places():
        face = target / "unshutter_lab" / "places" / name / "posx.jpg"  # empty: only their names are asked for
        face.parent.mkdir(parents=True)
        face.touch()


if __name__ == "__main__":
    main()
