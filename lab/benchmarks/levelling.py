"""Measures how well photos show the roll of a camera at rest, and how often levelling is offered rightly.

    python lab/benchmarks/levelling.py FOLDER [--views 12] [--seed 20261128]

Each place of the folder (a cube map) is seen in drawn directions, 50 to 75 degrees across, rolled by up to 6 degrees;
half of the cameras are tilted by 8 degrees (standard deviation), and half are stated. Places may be off level
themselves: then their views are rolled by a sinusoid of the direction. It is fitted to the other views of the place
that show their roll, robustly, and added to the true roll; places with fewer than six others are passed over.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from unshutter.motion.verdict import judge
from unshutter.options import Camera, Find, Undo
from unshutter.photo import Photo
from unshutter.rectification.find import find
from unshutter_lab.synthesis import panorama

_MOST_ROLL_DEG, _TILT_DEG = 6.0, 8.0
_PLACE_DEG = 1.5  # standard deviation of the tilt of a place
_MIN_OTHERS = 6


class _View(NamedTuple):
    yaw_deg: float
    roll_deg: float  # against the axes of the cube map
    found_deg: float
    error_deg: float  # as stated; 0: the photo does not show its roll
    offered: bool


def main() -> None:
    """Prints a row for the views as they are, and one that allows for each place's tilt."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--views", type=int, default=12, help="of each place")
    parser.add_argument("--seed", type=int, default=20261128)
    arguments = parser.parse_args()
    as_they_are, allowed_for = [], []
    for number, path in enumerate(panorama.places_in(arguments.folder)):
        place = panorama.Place.load(path)
        views = [_seen(place, k, [arguments.seed, number, k]) for k in range(arguments.views)]
        as_they_are += [(view, view.roll_deg) for view in views]
        allowed_for += _levelled(views)
    print("| truth | views | off level | offered | nearer | error kept | twice |")
    for name, views in (("cube maps", as_they_are), ("cube maps made level", allowed_for)):
        off = sum(abs(true) >= 1 for _, true in views)
        offers = [abs(view.found_deg - true) < abs(true) for view, true in views if view.offered]
        ratios = np.array([abs(view.found_deg - true) / view.error_deg for view, true in views if view.error_deg])
        kept = f"{np.mean(ratios < 1):.2f} | {np.mean(ratios < 2):.2f}"
        print(f"| {name} | {len(views)} | {off} | {len(offers)} | {sum(offers)} | {kept} |")


def _seen(place: panorama.Place, number: int, seed: list[int]) -> _View:
    rng = np.random.default_rng(seed)
    yaw, roll = rng.uniform(0, 360), rng.uniform(-_MOST_ROLL_DEG, _MOST_ROLL_DEG)
    tilt = rng.normal(0, _TILT_DEG) if number % 2 else 0.0
    height, width = (640, 480) if number % 3 == 2 else (480, 640)
    camera = panorama.Camera.of_view(height, width, rng.uniform(50, 75), yaw=yaw, tilt=tilt, roll=roll)
    stated = Camera(focal_px=camera.focal_px) if number // 2 % 2 else Camera()
    found = find(Photo.from_array(np.ascontiguousarray(place.seen(camera))), Find(camera=stated))
    pose = found.held_at_rest
    if pose is None or pose.roll_error_deg is None:
        return _View(yaw, roll, 0.0, 0.0, False)
    return _View(yaw, roll, pose.roll_deg, pose.roll_error_deg, judge(found, Undo()).lean is not None)


def _levelled(views: list[_View]) -> Iterator[tuple[_View, float]]:
    """Yields the views with their true roll [degrees], as the other ones show the tilt of the place."""
    for view in views:
        others = [other for other in views if other is not view and other.error_deg]
        if len(others) < _MIN_OTHERS:
            continue
        waves = np.array([_wave(other) for other in others])
        errors = np.array([other.found_deg - other.roll_deg for other in others])
        deviations = np.array([other.error_deg for other in others])
        weight, tilt = 1 / deviations, np.zeros(2)
        for _ in range(20):
            sides = np.vstack([waves * weight[:, None], np.eye(2) / _PLACE_DEG])
            tilt = np.linalg.lstsq(sides, np.append(errors * weight, [0, 0]), rcond=None)[0]
            weight = 1 / deviations / np.sqrt(1 + ((errors - waves @ tilt) / deviations) ** 2)
        yield view, view.roll_deg + float(tilt @ _wave(view))


def _wave(view: _View) -> tuple[float, float]:
    return math.cos(math.radians(view.yaw_deg)), math.sin(math.radians(view.yaw_deg))


if __name__ == "__main__":
    main()
