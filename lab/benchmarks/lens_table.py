"""Writes the table of lenses, ``video/calibrate/lenses.csv``, from lens profiles of Gyroflow's collection (CC0).

    python lab/benchmarks/lens_table.py lens_profiles.csv

Kept are cameras whose lens is fixed: action cameras, drones and phones. Profiles of one camera, lens and frame size
that agree are one line, the one in their middle; those that disagree are separate lines, and then none is used.
"""

from __future__ import annotations

import csv
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from unshutter.errors import UnshutterError
from unshutter.motion.lens import Lens
from unshutter.video.calibrate.cameras import _KINDS

TARGET = Path(__file__).parents[2] / "src" / "unshutter" / "video" / "calibrate" / "lenses.csv"
K = ["k1", "k2", "k3", "k4"]
COLUMNS = f"brand model lens width height focal axis_x axis_y {' '.join(K)} profiles"
ALIKE, MOST_RMS = 0.03, 3.0  # share of the corner's angle; px
HEAD = """\
# Lenses of cameras, by frame size.
# Source: {count:,} lens profiles of Gyroflow's collection, https://github.com/gyroflow/lens_profiles
# Licence: CC0-1.0 (public domain), as that collection. Users of Gyroflow measured these lenses; unshutter has not.
# focal is in widths of a frame, the axis in widths and heights; k1 to k4 are those of OpenCV's fisheye model. Left out:
# cameras whose lens can be changed, and profiles that do not fit their own pictures.
"""


def angle(row: dict) -> float | None:
    """Angle of the corner from the axis [rad]; None if this cannot be a lens."""
    try:
        lens = Lens(float(row["fx_per_width"]), tuple(float(row[name]) for name in K))
    except (UnshutterError, ValueError):
        return None
    corner = np.hypot(1, int(row["height"]) / int(row["width"])) / 2 / lens.focal
    square = abs(float(row["fx_per_width"]) / float(row["fy_per_width"]) - 1) < 0.02
    middle = max(abs(float(row["cx_per_width"]) - 0.5), abs(float(row["cy_per_height"]) - 0.5)) < 0.05
    if corner > lens._distances[-1] or not square or not middle or row["digital"]:
        return None
    return float(lens.angle(corner)) if float(row["rms_px"] or 0) <= MOST_RMS else None


def main() -> None:
    brands = {brand for kind in ("phones", "action cameras and drones") for brand in _KINDS[kind].split()}
    rows = list(csv.DictReader(Path(sys.argv[1]).read_text(encoding="utf-8").splitlines()))
    groups, used = defaultdict(list), 0
    for row in rows:
        if row["brand"].lower().split()[0] in brands and (seen := angle(row)) is not None:
            lens = row["lens"] or row["setting"]
            groups[row["brand"], row["model"], lens, int(row["width"]), int(row["height"])].append((seen, row))
            used += 1
    lines = []
    for (brand, model, lens, width, height), profiles in sorted(groups.items()):
        profiles.sort(key=lambda each: each[0])
        while profiles:
            alike = [each for each in profiles if each[0] <= (1 + ALIKE) * profiles[0][0]]
            del profiles[: len(alike)]
            row = alike[len(alike) // 2][1]
            numbers = [float(row[name]) for name in ("fx_per_width", "cx_per_width", "cy_per_height")]
            k = [float(row[name]) for name in K]
            shown = [f"{each:.4g}" for each in (*numbers, *k)]
            lines.append([brand, model, lens, width, height, *shown, len(alike)])
    with TARGET.open("w", encoding="utf-8", newline="") as out:
        out.write(HEAD.format(count=used))
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(COLUMNS.split())
        writer.writerows(lines)
    print(len(lines), "lines,", TARGET.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
