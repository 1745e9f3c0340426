#!/bin/sh
# telemetry-parser 0.3.0 (needs Python 3.12 or older): two of its methods read one log on two clocks.
#
# Behaviour: a Gyroflow text log (.gcsv) whose first sample is at 2.5 s comes out of telemetry() at 2.5 s, but out
# of normalized_imu() at 0 ms: the time of the first sample is subtracted from all of them.
# One would guess otherwise because "normalised" reads as units and axes (degrees a second, m/s2, the camera's
# axes), not as a change of clock; both methods belong to one object, and normalized_imu() does not tell the offset.
# Whom it hurts: who matches samples with frames by time. A logger that starts before or after the picture is
# off by exactly that lead, which looks like a constant fault of synchronisation.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check telemetry-parser==0.3.0
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
import sys
import telemetry_parser

path = sys.argv[1] + "/log.gcsv"
head = ["GYROFLOW IMU LOG", "version,1.3", "id,logger", "orientation,XYZ", "tscale,0.001", "gscale,0.001", "ascale,0.001"]
for first in (0, 2500):
    rows = [f"{first + 5 * n},10,20,30,0,0,1000" for n in range(100)]
    with open(path, "w") as file:
        file.write("\n".join([*head, "t,gx,gy,gz,ax,ay,az", *rows]) + "\n")
    parser = telemetry_parser.Parser(path)
    raw = [sample["t"] for part in parser.telemetry() for sample in part["Gyroscope"]["Data"]]
    normalised = [sample["timestamp_ms"] for sample in parser.normalized_imu()]
    print(f"log from {first} ms: telemetry {raw[0]:.3f} to {raw[-1]:.3f} s,", end=" ")
    print(f"normalized_imu {normalised[0]:.0f} to {normalised[-1]:.0f} ms")
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> log from 0 ms: telemetry 0.000 to 0.495 s, normalized_imu 0 to 495 ms
#> log from 2500 ms: telemetry 2.500 to 2.995 s, normalized_imu 0 to 495 ms
