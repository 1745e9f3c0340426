#!/bin/sh
# imufusion 1.3.3: without a magnetometer the first three seconds of turning are thrown away.
#
# Behaviour: 30 degrees a second about the vertical for 5 s: the heading is exactly 0 up to the third second, and 60
# degrees at the end instead of 150. After skip_startup() it is 150. (While starting, the filter raises its gain to
# find gravity, and holds the heading at zero.)
# One would guess otherwise because finding gravity is a matter of tilt; without a magnetometer the heading comes from
# the gyro alone, which is there from the first sample.
# Whom it hurts: who integrates the gyro log of a short clip: a clip of 3 s has no pan in it, though roll and pitch look
# right, and in longer ones the beginning does not fit the frames.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check imufusion==1.3.3 numpy==2.4.6
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import imufusion
import numpy as np

for skip in (False, True):
    fusion = imufusion.Ahrs()
    fusion.set_settings(imufusion.AhrsSettings(sample_rate=200))
    if skip:
        fusion.skip_startup()
    headings = []
    for _ in range(1000):
        fusion.update_no_magnetometer(np.array([0.0, 0.0, 30.0]), np.array([0.0, 0.0, 1.0]))
        headings.append(imufusion.quaternion_to_euler(fusion.get_quaternion())[2])
    print("skip_startup" if skip else "as it starts", "heading after 1 to 5 s:", [round(float(h)) for h in headings[199::200]])
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> as it starts heading after 1 to 5 s: [0, 0, 0, 30, 60]
#> skip_startup heading after 1 to 5 s: [30, 60, 90, 120, 150]
