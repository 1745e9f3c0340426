#!/bin/sh
# OpenTimelineIO 0.18.1: a non-drop timecode at 29.97 or 59.94 frames a second does not survive reading and writing.
#
# Behaviour: from_timecode("01:00:00:00", 30000/1001) is read as non-drop, by its colon: frame 108000. to_timecode()
# of that value writes "01:00:03;18": the time object forgets which count it came from, and the writer takes
# drop-frame for these rates. 3 s 18 frames of difference per hour. At 23.976 the text comes back as it was.
# One would guess otherwise because reader and writer are a pair, and the reader shows that the library knows both.
# Whom it hurts: who carries a camera's start timecode of 29.97 non-drop through it: clips land
# seconds away from their sound or their motion log, the more the later in the day.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check opentimelineio==0.18.1
"$work/venv/bin/python" - "$work" > "$work/seen.txt" <<'PYTHON'
from opentimelineio.opentime import from_timecode

for frames in (24000, 30000, 60000):
    for text in ("00:01:00:00", "01:00:00:00", "10:00:00:00"):
        time = from_timecode(text, frames / 1001)
        print(f"{frames}/1001: {text} is frame {time.value:.0f}, written {time.to_timecode()}")
PYTHON
sed -n 's/^#> //p' "$0" | diff - "$work/seen.txt"
cat "$work/seen.txt"

# Output seen (on a change, diff shows it and the script ends with 1):
#> 24000/1001: 00:01:00:00 is frame 1440, written 00:01:00:00
#> 24000/1001: 01:00:00:00 is frame 86400, written 01:00:00:00
#> 24000/1001: 10:00:00:00 is frame 864000, written 10:00:00:00
#> 30000/1001: 00:01:00:00 is frame 1800, written 00:01:00;02
#> 30000/1001: 01:00:00:00 is frame 108000, written 01:00:03;18
#> 30000/1001: 10:00:00:00 is frame 1080000, written 10:00:36;00
#> 60000/1001: 00:01:00:00 is frame 3600, written 00:01:00;04
#> 60000/1001: 01:00:00:00 is frame 216000, written 01:00:03;36
#> 60000/1001: 10:00:00:00 is frame 2160000, written 10:00:36;00
