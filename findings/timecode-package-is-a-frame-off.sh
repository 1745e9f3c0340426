#!/bin/sh
# timecode 1.5.1: seconds into and out of a timecode are one frame off, in opposite directions.
#
# Behaviour: Timecode("25", start_seconds=1) is 00:00:00:24, and Timecode("25", "00:00:01:00").float is 1.04, as is
# to_realtime(). The package counts frames from 1, and uses that count as if it were elapsed time.
# There and back gives the number one began with, so that a round trip as a test does not show it.
# One would guess otherwise because midnight, 00:00:00:00, is zero seconds on every clock; here it is 0.04.
# Whom it hurts: who lays a clip beside a log in seconds (gyro, GPS, sound): everything is a frame off, here 40 ms.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check timecode==1.5.1
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
from timecode import Timecode

for text in ("00:00:00:00", "00:00:01:00", "01:00:00:00"):
    time = Timecode("25", text)
    print(f"{text} is {time.float:.2f} s, {time.to_realtime()}")
for seconds in (1, 3600):
    time = Timecode("25", start_seconds=seconds)
    print(f"{seconds} s is {time}, and that again {time.float:.2f} s")
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> 00:00:00:00 is 0.04 s, 00:00:00.040
#> 00:00:01:00 is 1.04 s, 00:00:01.040
#> 01:00:00:00 is 3600.04 s, 01:00:00.040
#> 1 s is 00:00:00:24, and that again 1.00 s
#> 3600 s is 00:59:59:24, and that again 3600.00 s
