#!/bin/sh
# ahrs 0.4.0: AngularRate integrates a gyro log one sample ahead; the first sample is not used at all.
#
# Behaviour: of rates of 10, 20 ... 60 degrees a second at 1 Hz the attitudes are 0, 20, 50, 90, 140 and 200 degrees:
# the attitude at a sample already holds the rate that begins there. Holding each rate until the next sample gives
# 0, 10, 30, 60, 100, 150; the trapezoidal rule, 0, 15, 40, 75, 120, 175.
# One would guess otherwise because the first attitude is the given start, and what leads from it to the second is
# the rate that was measured there.
# Whom it hurts: who compares these attitudes with frames by time: against the trapezoidal rule they are half a sample
# early, which at 200 Hz is 2.5 ms: a tenth of a telephone's readout, and the same in every clip.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check ahrs==0.4.0 numpy==2.4.6
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import numpy as np
from ahrs.filters import AngularRate

rates = np.zeros((6, 3))
rates[:, 2] = np.deg2rad([10, 20, 30, 40, 50, 60])
for first in (10, 0):
    rates[0, 2] = np.deg2rad(first)
    found = AngularRate(gyr=rates, frequency=1.0).Q
    angles = np.rad2deg(2 * np.arctan2(found[:, 3], found[:, 0]))
    print(f"first rate {first}:", [round(float(angle)) for angle in angles])
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> first rate 10: [0, 20, 50, 90, 140, 200]
#> first rate 0: [0, 20, 50, 90, 140, 200]
